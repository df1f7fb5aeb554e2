"""Balls of the physics `real` as two event cameras and the chain see them: points in space, kept for later trials.

No two balls have the same air and table: their constants are drawn as far about the fitted ones as the filter expects.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.bench_prediction import SPIN_RADPS, spinning_task, truth_of
from benchmarks.prediction.prediction_errors import FlightTruth, PredictionSeries
from core.cameras import stereo_preset
from core.chain.block_windows import block_windows
from core.chain.chain import RallyChain
from core.chain.config import ChainConfig
from core.chain.physics import chain_for_physics
from core.detection.methods import Method
from core.files import replacing
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.physics.config import PhysicsConfig
from core.simulation.episodes import draw_serves, fly_serves
from core.simulation.episodes.closed_form import sample_serves
from core.simulation.event_cameras.event_camera import BLOCK_US
from core.trajectory import FilterConfig, Predictor

Array = NDArray[np.float64]

SEED: Final = 2027
WINDOW_US: Final = 2000
QUIET_BLOCKS: Final = 5
"""Before the serve: the cameras settle."""


@dataclass(frozen=True, slots=True, eq=False)
class PerceivedBall:
    """The chain's points of one flight up to the hitting plane; times count from the serve."""

    when_us: NDArray[np.int64]
    """(N,) ends of the windows: when each point was there."""
    t_us: NDArray[np.int64]
    """(N,) of the points."""
    ps_m: Array
    """(N, 3)."""
    covariances_m2: Array
    """(N, 3, 3)."""
    begins: NDArray[np.bool_]
    """(N,) whether the chain began a new flight with it."""
    errors_m: Array
    """(N,) distance from the ball."""
    truth: FlightTruth

    def predict(self, predictor: Predictor) -> PredictionSeries:
        """What a predictor says while it is told these points."""
        series = PredictionSeries([], [])
        rows = zip(self.when_us, self.t_us, self.ps_m, self.covariances_m2, self.begins, strict=True)
        for when_us, t_us, p, covariance, begins in rows:
            if begins:
                predictor.reset()
            new = predictor.add(int(t_us), p, covariance)
            if new is not None:
                series.when_s.append(1e-6 * float(when_us))
                series.predictions.append(new)
        return series


def perceived_ball(folder: Path, speed_mps: float, number: int, method: Method) -> PerceivedBall:
    """The ball of a speed with a number as a detector sees it: from its file, or seen now and kept."""
    path = folder / f"{method}-{speed_mps:g}mps-{number:03d}.npz"
    if not path.exists():
        columns = asdict(perceive_ball(speed_mps, number, method))
        columns["truth"] = np.hstack(list(columns["truth"].values()))
        with replacing(path, durable=False) as partial, partial.open("wb") as file:
            np.savez(file, **columns)
    with np.load(path) as file:
        columns = {name: file[name] for name in file.files}
    t = columns.pop("truth")
    return PerceivedBall(**columns, truth=FlightTruth(float(t[0]), t[1:4], float(t[4]), t[5:8]))


def chain_of(method: Method) -> ChainConfig:
    """A chain that knows of the physics how these balls are drawn: the fitted constants, and how much serves spin."""
    chain = chain_for_physics(ChainConfig.of_method(method), spinning_task().physics)
    return replace(chain, filter=replace(chain.filter, spin_sigma_radps=SPIN_RADPS / math.sqrt(3.0)))


def draw_physics(physics: PhysicsConfig, rng: np.random.Generator) -> PhysicsConfig:
    """Other air and another table, spread as `FilterConfig` says of what it does not know."""
    spread = FilterConfig()
    air = replace(physics.air, drag_coefficient=physics.air.drag_coefficient + rng.normal(0.0, spread.drag_sigma))
    table = replace(
        physics.table,
        restitution=min(0.995, physics.table.restitution + rng.normal(0.0, spread.restitution_sigma)),
        friction=max(0.05, physics.table.friction + rng.normal(0.0, spread.friction_sigma)),
    )
    return replace(physics, air=air, table=table)


def perceive_ball(speed_mps: float, number: int, method: Method) -> PerceivedBall:
    """Serve the ball in a world of its own and watch it."""
    seed = [SEED, round(1000 * speed_mps), number]
    task, cameras = spinning_task(), stereo_preset()
    task = replace(task, physics=draw_physics(task.physics, np.random.default_rng([*seed, 1])))
    serve = draw_serves(speed_mps, 1, task, np.random.default_rng(seed))
    arrivals = fly_serves(serve, task)
    truth = truth_of(arrivals)
    world = SimulatedWorld(WorldConfig(task=task), cameras, int(np.random.SeedSequence(seed).generate_state(1)[0]))
    chain = RallyChain(cameras, chain_of(method))
    rows: list[tuple[int, int, bool, Array, Array]] = []
    try:
        for _ in range(QUIET_BLOCKS):
            world.advance()
        served_us = round(1e6 * world.serve(serve.ps_m[0], serve.vs_mps[0], serve.spins_radps[0]).t_s)
        while world.now_us < served_us + 1e6 * truth.hit_s + BLOCK_US:
            block = world.advance()
            for windows in block_windows(block.events, block.start_us, block.end_us, WINDOW_US):
                state = chain.step(windows)
                point = state.point
                if point is not None and served_us < point.t_us < served_us + 1e6 * truth.hit_s:
                    begins = state.verdict == "new flight"
                    times_us = state.t_us - served_us, point.t_us - served_us
                    rows.append((*times_us, begins, point.p_world_m, point.covariance_m2))
    finally:
        world.close()
    when_us, t_us, begins, ps, covariances = zip(*rows, strict=True) if rows else ((),) * 5
    t_us, ps_m = np.array(t_us, np.int64), np.array(ps).reshape(-1, 3)
    errors_m = np.linalg.norm(
        ps_m - sample_serves(serve, arrivals, t_us[None].astype(np.float64) * 1e-6, task)[0], axis=1
    )
    covariances_m2 = np.array(covariances).reshape(-1, 3, 3)
    return PerceivedBall(
        np.array(when_us, np.int64), t_us, ps_m, covariances_m2, np.array(begins, np.bool_), errors_m, truth
    )
