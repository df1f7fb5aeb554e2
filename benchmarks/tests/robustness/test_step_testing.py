import numpy as np
import pytest

from benchmarks.robustness.bench_robustness import Cell, WrongWires, measure_steps
from core.cameras import stereo_preset
from core.errors import ConfigError
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.simulation.episodes.racket import RacketTarget


@pytest.mark.parametrize(("latency_ms", "jitter_ms"), [(0.0, 0.0), (10.0, 0.0), (40.0, 5.0)])
def test_the_latency_of_commands_is_found_within_2_ms(latency_ms: float, jitter_ms: float) -> None:
    cell = Cell(name="", words="", latency_ms=latency_ms, jitter_ms=jitter_ms)
    wires = WrongWires(cell, stereo_preset(), np.random.default_rng(5))
    world = SimulatedWorld(WorldConfig(), {}, 0, threads=1)
    try:
        found = measure_steps(world, wires.command)
    finally:
        world.close()
    assert 1e3 * found.mean_s == pytest.approx(latency_ms, abs=2.0)
    assert 1e3 * found.jitter_s == pytest.approx(jitter_ms / np.sqrt(3), abs=1.5)


def test_a_command_that_is_on_its_way_moves_nothing_until_it_is_there_and_is_checked_at_once() -> None:
    world = SimulatedWorld(WorldConfig(), {}, 0, threads=1)
    try:
        home = world.rally.racket.p_m.copy()
        q = world.rally.racket.q_wxyz
        with pytest.raises(ConfigError, match="out of reach"):
            world.aim(RacketTarget(home + np.array([5.0, 0, 0]), q, np.zeros(3), 1.0), after_s=0.05)
        world.aim(RacketTarget(home + np.array([0.0, 0.1, 0]), q, np.zeros(3), 0.4), after_s=0.054)
        rows = np.concatenate([world.advance().racket for _ in range(8)])
    finally:
        world.close()
    moved = np.abs(rows[:, 1] - home[1]) > 1e-9
    assert not moved[: 54 // 2].any() and moved[54 // 2 + 1 :].all()
