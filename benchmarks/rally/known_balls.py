"""What the robot does with balls that it is told exactly at their launch: arm and strokes, perception apart."""

from __future__ import annotations

import numpy as np

from core.live.worlds.simulated_returns import ReturnOutcome, SimulatedReturnsConfig, play_known_balls
from core.physics.task import TaskConfig
from core.simulation.episodes import draw_serves


def measure_known_balls(task: TaskConfig, speed_mps: float, balls: int, seed: int) -> dict[str, object]:
    """A row of the rally's bench for `balls` drawn serves; a ball without a stroke that could return it is missed."""
    serves = draw_serves(speed_mps, balls, task, np.random.default_rng([seed, round(1000 * speed_mps)]))
    found = play_known_balls(serves, SimulatedReturnsConfig(task=task))
    errors_mm = 1e3 * found.error_m[np.isfinite(found.error_m)]
    median, high = np.percentile(errors_mm, (50, 95)).tolist() if len(errors_mm) else (None, None)
    counts = {
        "own_half": found.count(ReturnOutcome.OWN_HALF),
        "net": found.count(ReturnOutcome.NET),
        "out": found.count(ReturnOutcome.LONG) + found.count(ReturnOutcome.WIDE),
    }
    returned = found.count(ReturnOutcome.RETURNED)
    return {
        "sensor": None,
        "speed_mps": speed_mps,
        "balls": balls,
        "seen": None,
        "returned": returned / balls,
        "landing_mm_median": median,
        "landing_mm_p95": high,
        "aim_mm_median": None,
        **counts,
        "missed": balls - returned - sum(counts.values()),
        "points": None,
        "point_mm_median": None,
        "point_mm_p95": None,
        "step_ms_p50": None,
        "step_ms_p99": None,
        "chain_cores": None,
        "wall_s_per_ball": None,
    }
