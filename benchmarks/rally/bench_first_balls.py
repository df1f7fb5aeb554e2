"""First balls of sessions, where the hit is chosen: with the reserve for the correction after the bounce, and without.

Nobody knows air and table yet, so the bounce moves the expected hit most with these. Each ball is the first of a
session of its own, met as chosen by what noisy points show, no cameras; the same sessions are played both ways.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, report_rows_to
from benchmarks.perception.comparisons import interval, mean
from benchmarks.rally.bench_rally import POINT_SIGMA_M
from benchmarks.rally.closed_loop import ClosedLoop
from core.cameras import stereo_preset
from core.chain.control.controller import BuiltInController
from core.chain.control.hit_choice import HitChoiceConfig
from core.chain.control.player import PlayerState
from core.live.worlds.world import Block, WorldConfig
from core.physics.config import Profile
from core.physics.task import task_profile

Array = NDArray[np.float64]
RESERVES: Final = {"none": HitChoiceConfig(reserve=0.0, correct_ms=0.0), "kept": HitChoiceConfig()}
SEED: Final = 462200
"""With 462100 to 462119 the reserve was chosen."""
SPEEDS_MPS: Final = (6.0, 7.0, 8.0, 9.0)
BALLS: Final = 20
ELEVATION_SPREAD_DEG: Final = 8.0
NEARLY: Final = 0.999
"""Of the largest acceleration: a racket that is at its limit has it over a whole step, up to rounding."""


@dataclass(frozen=True, slots=True)
class FirstBall:
    """What came of one ball."""

    error_mm: float
    """From its landing to the goal; nan if it did not come back."""
    at_limit: bool
    """Whether the racket had its largest acceleration on the way to the hit."""


def run(
    progress: Callable[[float], None],
    *,
    balls: int = BALLS,
    speeds: tuple[float, ...] = SPEEDS_MPS,
    physics: Profile = "paper",
    elevation_spread: float = ELEVATION_SPREAD_DEG,
    seed: int = SEED,
) -> dict[str, object]:
    """A row for each speed without and with the reserve, two over all speeds, and how much nearer balls land with it.

    Args:
        progress: gets the share that is done, and rows.
        balls: sessions of each speed.
        speeds: of the serves, m/s.
        physics: of the balls.
        elevation_spread: half the range of the serves' elevation about the standard one, degrees.
        seed: of the first session of each speed; the next ones follow.
    """
    task = task_profile(physics)
    world = WorldConfig(task=replace(task, serve=replace(task.serve, elevation_spread_deg=elevation_spread)))
    played: dict[str, list[FirstBall]] = {name: [] for name in RESERVES}
    rows: list[dict[str, object]] = []
    for number, speed in enumerate(speeds):
        for name, choice in RESERVES.items():
            mine = [play_first_ball(world, speed, seed + session, choice) for session in range(balls)]
            played[name] += mine
            rows.append({"reserve": name, "speed_mps": speed} | _row(mine))
        report_rows_to(progress, rows[-len(RESERVES) :], (number + 1) / len(speeds))
    rows += [{"reserve": name, "speed_mps": "all"} | _row(mine) for name, mine in played.items()]
    gains_mm = [a.error_mm - b.error_mm for a, b in zip(played["none"], played["kept"], strict=True)]
    low, high = interval(gains_mm, gains_mm)
    return {
        "rows": rows,
        "nearer_mm": {"mean": mean(gains_mm), "low": low, "high": high},
        "machine": describe_machine("numba", "numpy", "mujoco"),
    }


def play_first_ball(world: WorldConfig, speed_mps: float, seed: int, choice: HitChoiceConfig) -> FirstBall:
    """Play one ball of a new session, whose chain and controller know no constants."""
    t_s, pushed_mps2 = list[Array](), list[Array]()

    def on_block(block: Block, states: list[PlayerState]) -> None:
        path = block.racket_path
        steps_s = np.diff(path.t_s)
        t_s.append(path.t_s[1:])
        pushed_mps2.append(np.linalg.norm(np.diff(path.vs_mps, axis=0), axis=1) / steps_s)

    loop = ClosedLoop(world, stereo_preset(), seed=seed, hit="chosen", point_sigma_m=POINT_SIGMA_M, choice=choice)
    try:
        ball = loop.play(speed_mps, on_block)
    finally:
        loop.close()
    landing_m, goal_m = ball.judged.outcome.landing_m, BuiltInController(world.task).goal_m
    error_mm = 1e3 * float(np.linalg.norm(landing_m[:2] - goal_m)) if ball.returned else float("nan")
    due_s = ball.decisions[-1].target.t_s if ball.decisions else -np.inf
    on_the_way = np.concatenate(t_s) <= due_s  # after the stroke it may brake as hard as it likes
    hardest_mps2 = np.concatenate(pushed_mps2)[on_the_way].max(initial=0.0)
    return FirstBall(error_mm, bool(hardest_mps2 >= NEARLY * world.racket.max_acceleration_mps2))


def _row(balls: list[FirstBall]) -> dict[str, object]:
    errors_mm = [one.error_mm for one in balls if np.isfinite(one.error_mm)]
    median, p95, worst = np.percentile(errors_mm, (50, 95, 100)).tolist() if errors_mm else (None, None, None)
    return {
        "balls": len(balls),
        "returned": len(errors_mm) / len(balls),
        "landing_mm_median": median,
        "landing_mm_p95": p95,
        "landing_mm_worst": worst,
        "at_limit": sum(one.at_limit for one in balls),
    }
