"""Balls of human play: split by flight, and the same flight is never on two sides."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.config import EnvironmentConfig, RunConfig, environment_profile
from core.learning.task.environment import draw_serve_batch, evaluation_balls, racket_table, validation_balls
from core.learning.task.recorded_balls import BLOCK, PARTS, SHARES, part_of_flights, recorded_balls
from core.physics.ball_states import KEYS
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves

pytestmark = pytest.mark.numeric
REAL = task_profile("real")


def write_states(path: Path, count: int, seed: int = 0) -> Path:
    """Drawn serves with spin, as a file has them: the table along y."""
    task = dataclasses.replace(REAL, serve=dataclasses.replace(REAL.serve, spin_spread_radps=50.0))
    serves = draw_serves(6.0, count, task, np.random.default_rng(seed))
    columns = [serves.ps_m, serves.vs_mps, serves.spins_radps]
    rows = np.concatenate([np.column_stack([-c[:, 1], c[:, 0], c[:, 2]]) for c in columns], axis=1)
    path.write_text(json.dumps([dict(zip(KEYS, map(float, row), strict=True)) for row in rows]))
    return path


def environment(path: Path) -> EnvironmentConfig:
    config = environment_profile("real", state_source="truth")
    return dataclasses.replace(config, state="spin", recorded=str(path))


def flights(rows: np.ndarray) -> set[bytes]:
    return {row.tobytes() for row in rows}


def test_blocks_of_flights_are_dealt_to_the_parts_and_none_twice() -> None:
    parts = part_of_flights(20_007)
    assert len(parts) == 20_007
    shares = np.bincount(parts, minlength=3) / len(parts)
    np.testing.assert_allclose(shares, SHARES, atol=0.01)
    blocks = parts[:20_000].reshape(-1, BLOCK)
    assert (blocks == blocks[:, :1]).all(), "a block stays together"
    np.testing.assert_array_equal(parts, part_of_flights(20_007))
    assert set(part_of_flights(10 * BLOCK)) == {0, 1, 2}


def test_what_is_trained_on_is_never_evaluated_or_chosen_by(tmp_path: Path) -> None:
    config = environment(write_states(tmp_path / "a.json", 700))
    trained = draw_serve_batch(5.0, 8000, config, np.random.default_rng(0))
    tested, chosen = evaluation_balls(5.0, 500, config), validation_balls(5.0, 500, config)
    sides = [flights(balls.serves.states()) for balls in (trained, tested, chosen)]
    assert not sides[0] & sides[1] and not sides[0] & sides[2] and not sides[1] & sides[2]
    assert sum(map(len, sides)) == 700, "every playable flight is on one of the sides"
    assert len(tested) == len(sides[1]), "evaluated once each"


def test_balls_come_with_their_spin_and_a_racket_speed_for_their_own(tmp_path: Path) -> None:
    config = environment(write_states(tmp_path / "a.json", 700))
    balls = draw_serve_batch(5.0, 50, config, np.random.default_rng(0))
    np.testing.assert_array_equal(balls.states[:, :9], balls.arrivals.states)
    assert not balls.states[:, 9:].any(), "known exactly"
    incoming, racket = racket_table(RunConfig(agent="landing-model", environment=config))
    np.testing.assert_allclose(balls.racket_speeds_mps, np.interp(-balls.states[:, 3], incoming, racket))
    assert len(incoming) == 7 and np.ptp(balls.racket_speeds_mps) > 0


def test_a_folder_stands_for_its_files_and_a_changed_file_is_read_again(tmp_path: Path) -> None:
    write_states(tmp_path / "a.json", 600)
    alone = sum(len(recorded_balls(str(tmp_path), part, REAL).serves) for part in PARTS)
    write_states(tmp_path / "b.json", 500, seed=1)
    (tmp_path / "notes.txt").write_text("nothing")
    both = sum(len(recorded_balls(str(tmp_path), part, REAL).serves) for part in PARTS)
    assert (alone, both) == (600, 1100)


def test_no_balls_and_too_few_are_refused_with_a_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no recorded balls"):
        recorded_balls(str(tmp_path), "test", REAL)
    few = write_states(tmp_path / "few.json", 5)
    with pytest.raises(ConfigError, match="no playable ball for"):
        recorded_balls(str(few), "test", REAL)
    with pytest.raises(ConfigError, match="not seen so"):
        dataclasses.replace(environment(few), state="plain", state_source="predicted")


def test_a_small_selection_has_balls_for_every_part_and_none_twice(tmp_path: Path) -> None:
    place = str(write_states(tmp_path / "few.json", 30))
    sides = [flights(recorded_balls(place, part, REAL).serves.states()) for part in PARTS]
    assert all(sides) and sum(map(len, sides)) == 30 and len(set.union(*sides)) == 30
    assert (part_of_flights(700) == part_of_flights(700, BLOCK)).all(), "a file that had all parts keeps its split"


def test_of_human_play_most_balls_are_playable_and_a_fifth_is_kept_for_the_test(shared_data: Path) -> None:
    place = str(shared_data / "trajectories")
    counts = [len(recorded_balls(place, part, REAL).serves) for part in PARTS]
    assert sum(counts) == 13_107  # as docs/measured/ball-states-report.md has it
    np.testing.assert_allclose(np.array(counts) / sum(counts), SHARES, atol=0.02)
