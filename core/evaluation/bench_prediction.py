"""How well the flight is predicted: the filter and the paper's rule on simulated flights with spin, truth plus 1 mm.

Profile `real`, 1 kHz, the serve speeds in turn, each with a random spin. The paper's rule knows
gravity and one factor for the bounce. Errors at the hitting plane are those along the plane; the time's is separate.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.evaluation.machine import describe_machine
from core.simulation.physics import Serves, TaskConfig, draw_serves, fly_serves
from core.simulation.physics.episode import Arrivals
from core.simulation.physics.simulate import sample_serves
from core.simulation.physics.task import STAGE_SPEEDS_MPS, task_profile
from core.trajectory import FilterPredictor, PaperPredictor, Prediction, filter_for, predictor_for

Array = NDArray[np.float64]

PER_SPEED: Final = 30
"""210 flights over the seven speeds."""
SPIN_RADPS: Final = 100.0
"""Half width of the uniform spread about each axis."""
NOISE_M: Final = 0.001
BEFORE_LANDING_S: Final = 0.080
AFTER_BOUNCE_S: Final = 0.030
LEADS_MS: Final = (25, 50, 75, 100, 150, 200, 250, 300, 400)
DIFFERENCE_S: Final = 1e-4


@dataclass(slots=True)
class Errors:
    """What one method was off by; a list entry per flight."""

    landing_mm: list[float] = field(default_factory=list)
    plane_mm: list[float] = field(default_factory=list)
    time_ms: list[float] = field(default_factory=list)
    by_lead_mm: dict[int, list[float]] = field(default_factory=lambda: {lead: [] for lead in LEADS_MS})
    nees: dict[str, list[float]] = field(default_factory=lambda: {"before landing": [], "after bounce": []})
    seconds: list[float] = field(default_factory=list)


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """A row per method, errors by lead time, and the machine."""
    return measure(PER_SPEED, progress) | {"machine": describe_machine()}


def measure(per_speed: int, progress: Callable[[float], None] = lambda share: None) -> dict[str, object]:
    """The rows for so many flights of each speed."""
    task = task_profile("real")
    task = replace(task, serve=replace(task.serve, spin_spread_radps=SPIN_RADPS))
    rng = np.random.default_rng(7)
    found = {"filter": Errors(), "paper": Errors()}
    for number, speed in enumerate(STAGE_SPEEDS_MPS):
        serves = draw_serves(speed, per_speed, task, rng)
        for one in range(per_speed):
            _one_flight(serves[one : one + 1], task, rng, found)
        progress((number + 1) / len(STAGE_SPEEDS_MPS))
    rows = [{"method": name} | _row(errors) for name, errors in found.items()]
    leads = [
        {"method": name, "lead_ms": lead} | _median_and_p95(errors.by_lead_mm[lead], "error")
        for name, errors in found.items()
        for lead in LEADS_MS
    ]
    return {"flights": per_speed * len(STAGE_SPEEDS_MPS), "rows": rows, "leads": leads}


def _one_flight(serve: Serves, task: TaskConfig, rng: np.random.Generator, found: dict[str, Errors]) -> None:
    arrivals = fly_serves(serve, task)
    bounce_s, hit_s = float(arrivals.bounce_t_s[0]), float(arrivals.t_s[0])
    t_s = np.arange(1, int(hit_s * 1000)).astype(np.float64) * 1e-3
    seen = sample_serves(serve, arrivals, t_s[None], task)[0] + rng.normal(0, NOISE_M, (len(t_s), 3))
    landing, hit = arrivals.bounce_states[0, :3], arrivals.states[0, :3]
    at = {"before landing": bounce_s - BEFORE_LANDING_S, "after bounce": bounce_s + AFTER_BOUNCE_S}
    hit_x = float(hit[0])
    predictors = {
        "filter": FilterPredictor(filter_for("real", hit_x_m=hit_x, sigma_point_m=NOISE_M)),
        "paper": PaperPredictor(predictor_for("paper", hit_x_m=hit_x)),
    }
    for name, predictor in predictors.items():
        errors, latest = found[name], None
        asked_s = {hit_s - 1e-3 * lead: lead for lead in LEADS_MS}
        due = dict.fromkeys(at.values(), "")
        for t, p in zip(t_s, seen, strict=True):
            _ask(errors, latest, t, asked_s, due, (landing, hit, hit_s), bounce_s)
            began = time.thread_time()
            latest = predictor.add(round(1e6 * t), p) or latest
            errors.seconds.append(time.thread_time() - began)
            for when, moment in at.items():
                if isinstance(predictor, FilterPredictor) and abs(t - moment) <= 0.0005 and t > 0.02:
                    errors.nees[when].append(_nees(predictor, _truth(serve, arrivals, t, task)))


def _ask(
    errors: Errors,
    latest: Prediction | None,
    t: float,
    leads: dict[float, int],
    moments: dict[float, str],
    truth: tuple[Array, Array, float],
    bounce_s: float,
) -> None:
    """Score the latest prediction at each moment that has come, once."""
    landing, hit, hit_s = truth
    for moment in [moment for moment in leads if moment <= t]:
        lead = leads.pop(moment)
        if latest is not None and latest.hit_plane is not None:
            off = latest.hit_plane.p_world_m - hit
            errors.by_lead_mm[lead].append(1e3 * float(np.hypot(off[1], off[2])))
    for moment in [moment for moment in moments if moment <= t]:
        moments.pop(moment)
        if latest is None:
            continue
        if moment < bounce_s and latest.landing is not None:
            errors.landing_mm.append(1e3 * float(np.linalg.norm(latest.landing.p_world_m - landing)))
        elif moment > bounce_s and latest.hit_plane is not None:
            off = latest.hit_plane.p_world_m - hit
            errors.plane_mm.append(1e3 * float(np.hypot(off[1], off[2])))
            errors.time_ms.append(1e3 * abs(latest.hit_plane.t_s - hit_s))


def _truth(serve: Serves, arrivals: Arrivals, t: float, task: TaskConfig) -> Array:
    """(6,) position and velocity."""
    times = np.array([[t - DIFFERENCE_S, t, t + DIFFERENCE_S]])
    ps = sample_serves(serve, arrivals, times, task)[0]
    return np.concatenate([ps[1], (ps[2] - ps[0]) / (2 * DIFFERENCE_S)])


def _nees(predictor: FilterPredictor, truth: Array) -> float:
    """The squared error of position and velocity in units of its covariance; 1 on average if that is honest."""
    off = predictor.state[:6] - truth
    return float(off @ np.linalg.solve(predictor.covariance[:6, :6], off)) / 6


def _row(errors: Errors) -> dict[str, object]:
    row: dict[str, object] = _median_and_p95(errors.landing_mm, "landing_80ms_ahead")
    row |= _median_and_p95(errors.plane_mm, "hit_plane_30ms_after")
    row["hit_time_median_ms"] = round(float(np.median(errors.time_ms)), 2) if errors.time_ms else None
    row["update_median_ms"] = round(1e3 * float(np.median(errors.seconds)), 4)
    row["update_mean_ms"] = round(1e3 * float(np.mean(errors.seconds)), 4)
    row["update_p99_ms"] = round(1e3 * float(np.percentile(errors.seconds, 99)), 4)
    row["nees"] = {when: round(float(np.mean(values)), 3) for when, values in errors.nees.items() if values}
    return row


def _median_and_p95(values: list[float], name: str) -> dict[str, object]:
    if not values:
        return {f"{name}_median_mm": None, f"{name}_p95_mm": None, f"{name}_flights": 0}
    return {
        f"{name}_median_mm": round(float(np.median(values)), 2),
        f"{name}_p95_mm": round(float(np.percentile(values, 95)), 2),
        f"{name}_flights": len(values),
    }
