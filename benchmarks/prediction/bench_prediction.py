"""How well the flight is predicted: the filter and the paper's rule on simulated flights with spin, truth plus 1 mm.

Profile `real`, 1 kHz, the serve speeds in turn, each with a random spin. The paper's rule knows gravity and, for the
bounce, the medians of recorded ones.
"""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine
from core.physics import Serves, TaskConfig
from core.physics.episode import Arrivals
from core.physics.task import STAGE_SPEEDS_MPS, task_profile
from core.simulation.episodes import draw_serves, fly_serves
from core.simulation.episodes.closed_form import sample_serves
from core.trajectory import FilterPredictor, HitPlane, PaperPredictor, Prediction, filter_for, predictor_for

Array = NDArray[np.float64]

BEFORE_LANDING_S: Final = 0.080
AFTER_BOUNCE_S: Final = 0.030
LEADS_MS: Final = (25, 50, 75, 100, 150, 200, 250, 300, 400)


@dataclass(frozen=True, slots=True, eq=False)
class FlightTruth:
    """Where a ball bounced and crossed the hitting plane."""

    bounce_s: float
    landing_m: Array
    """(3,) its centre then."""
    hit_s: float
    hit_m: Array
    """(3,)."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictionSeries:
    """Predictions of one flight, in order of the times at which they were made."""

    when_s: list[float]
    predictions: list[Prediction]

    def at(self, t_s: float) -> Prediction | None:
        """The newest one that there was at a time."""
        found = bisect_right(self.when_s, t_s) - 1
        return self.predictions[found] if found >= 0 else None


@dataclass(slots=True)
class PredictionErrors:
    """Errors of one method, an entry per flight. At the hitting plane those along it; the time's is separate."""

    landing_mm: list[float] = field(default_factory=list)
    plane_mm: list[float] = field(default_factory=list)
    time_ms: list[float] = field(default_factory=list)
    by_lead_mm: dict[int, list[float]] = field(default_factory=lambda: {lead: [] for lead in LEADS_MS})
    by_lead_ms: dict[int, list[float]] = field(default_factory=lambda: {lead: [] for lead in LEADS_MS})
    normalised: dict[int, list[float]] = field(default_factory=lambda: {lead: [] for lead in LEADS_MS})
    """By lead time: squared error of y, z and time in units of their covariance, over three."""
    nees: dict[str, list[float]] = field(default_factory=lambda: {"before landing": [], "after bounce": []})
    """Of the estimated position and velocity."""
    seconds: list[float] = field(default_factory=list)
    """Of an update that made a prediction."""
    quiet_seconds: list[float] = field(default_factory=list)
    """Of one that did not."""

    def score(self, series: PredictionSeries, truth: FlightTruth) -> None:
        """Compare what was said of a flight with what came of it."""
        before = series.at(truth.bounce_s - BEFORE_LANDING_S)
        if before is not None and before.landing is not None:
            self.landing_mm.append(1e3 * float(np.linalg.norm(before.landing.p_world_m - truth.landing_m)))
        after = series.at(truth.bounce_s + AFTER_BOUNCE_S)
        if truth.bounce_s + AFTER_BOUNCE_S < truth.hit_s and after is not None and after.hit_plane is not None:
            self.plane_mm.append(plane_error_mm(after.hit_plane, truth))
            self.time_ms.append(1e3 * abs(after.hit_plane.t_s - truth.hit_s))
        for lead in LEADS_MS:
            newest = series.at(truth.hit_s - 1e-3 * lead)
            if newest is not None and newest.hit_plane is not None:
                self.by_lead_mm[lead].append(plane_error_mm(newest.hit_plane, truth))
                self.by_lead_ms[lead].append(1e3 * abs(newest.hit_plane.t_s - truth.hit_s))
                self.normalised[lead].append(_normalised(newest.hit_plane, truth))

    def row(self) -> dict[str, object]:
        """The figures by name."""
        row = median_and_p95(self.landing_mm, "landing_80ms_ahead")
        row |= median_and_p95(self.plane_mm, "hit_plane_30ms_after")
        row["hit_time_median_ms"] = rounded(self.time_ms, 50)
        row["hit_time_p95_ms"] = rounded(self.time_ms, 95)
        if self.seconds:
            milliseconds = 1e3 * np.array(self.seconds)
            row["update_ms"] = rounded(1e3 * np.array(self.quiet_seconds), 50, 4)
            row["update_with_prediction_p50_ms"] = rounded(milliseconds, 50, 4)
            row["update_with_prediction_p99_ms"] = rounded(milliseconds, 99, 4)
        row["nees"] = {when: round(float(np.mean(values)), 3) for when, values in self.nees.items() if values}
        return row

    def leads(self) -> list[dict[str, object]]:
        """The errors at the plane by lead time."""
        return [
            {
                "lead_ms": lead,
                **median_and_p95(self.by_lead_mm[lead], "error"),
                "time_median_ms": rounded(self.by_lead_ms[lead], 50),
                "normalised": round(float(np.mean(self.normalised[lead])), 2) if self.normalised[lead] else None,
            }
            for lead in LEADS_MS
        ]


def plane_error_mm(hit: HitPlane, truth: FlightTruth) -> float:
    """How far off along the plane."""
    off = hit.p_world_m - truth.hit_m
    return 1e3 * float(np.hypot(off[1], off[2]))


def _normalised(hit: HitPlane, truth: FlightTruth) -> float:
    off = (hit.p_world_m - truth.hit_m)[1:]
    # Time and place are correlated, but only their standard deviations are said.
    across = float(off @ np.linalg.solve(hit.covariance[1:3, 1:3] + 1e-14 * np.eye(2), off))
    return (across + ((hit.t_s - truth.hit_s) / max(hit.sigma_t_s, 1e-9)) ** 2) / 3


def rounded(values: Sequence[float] | Array, percent: float, digits: int = 2) -> float | None:
    """A percentile; None of nothing."""
    return round(float(np.percentile(values, percent)), digits) if len(values) else None


def median_and_p95(values: Sequence[float], name: str) -> dict[str, object]:
    """Median and 95th percentile of errors in metres, in millimetres, and their number."""
    return {
        f"{name}_median_mm": rounded(values, 50),
        f"{name}_p95_mm": rounded(values, 95),
        f"{name}_flights": len(values),
    }


PER_SPEED: Final = 30
"""210 flights over the seven speeds."""
SPIN_RADPS: Final = 100.0
"""Half width of the uniform spread about each axis."""
NOISE_M: Final = 0.001
SEED: Final = 7
DIFFERENCE_S: Final = 1e-4


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """A row per method, errors by lead time, and the machine."""
    clock = "processor time of one thread, after the first flight"
    return measure_prediction(PER_SPEED, progress) | {"machine": describe_machine("numpy", "numba", clock=clock)}


def measure_prediction(per_speed: int, progress: Callable[[float], None] = lambda share: None) -> dict[str, object]:
    """The rows for so many flights of each speed."""
    task = spinning_task()
    rng = np.random.default_rng(SEED)
    found = {"filter": PredictionErrors(), "paper": PredictionErrors()}
    for number, speed in enumerate(STAGE_SPEEDS_MPS):
        serves = draw_serves(speed, per_speed, task, rng)
        for one in range(per_speed):
            _one_flight(serves[one : one + 1], task, rng, found)
            if number == one == 0:
                for errors in found.values():  # the first loads the kernels
                    errors.seconds.clear()
                    errors.quiet_seconds.clear()
        progress((number + 1) / len(STAGE_SPEEDS_MPS))
    rows = [{"method": name} | errors.row() for name, errors in found.items()]
    leads = [{"method": name} | lead for name, errors in found.items() for lead in errors.leads()]
    return {"flights": per_speed * len(STAGE_SPEEDS_MPS), "rows": rows, "leads": leads}


def spinning_task() -> TaskConfig:
    """The physics `real` with serves that spin."""
    task = task_profile("real")
    return replace(task, serve=replace(task.serve, spin_spread_radps=SPIN_RADPS))


def truth_of(arrivals: Arrivals) -> FlightTruth:
    """What came of the first of these serves."""
    hit = arrivals.states[0, :3]
    return FlightTruth(float(arrivals.bounce_t_s[0]), arrivals.bounce_states[0, :3], float(arrivals.t_s[0]), hit)


def _one_flight(serve: Serves, task: TaskConfig, rng: np.random.Generator, found: dict[str, PredictionErrors]) -> None:
    arrivals = fly_serves(serve, task)
    truth = truth_of(arrivals)
    t_s = np.arange(1, int(truth.hit_s * 1000)).astype(np.float64) * 1e-3
    seen = sample_serves(serve, arrivals, t_s[None], task)[0] + rng.normal(0, NOISE_M, (len(t_s), 3))
    hit_x_m = float(truth.hit_m[0])
    flown = FilterPredictor(filter_for("real", sigma_point_m=NOISE_M), hit_x_m=hit_x_m)
    paper = PaperPredictor(predictor_for("real", hit_x_m=hit_x_m))
    moments = {"before landing": truth.bounce_s - BEFORE_LANDING_S, "after bounce": truth.bounce_s + AFTER_BOUNCE_S}
    for name, predictor in (("filter", flown), ("paper", paper)):
        errors, series = found[name], PredictionSeries([], [])
        for t, p in zip(t_s.tolist(), seen, strict=True):
            began = time.thread_time()
            new = predictor.add(round(1e6 * t), p)
            (errors.quiet_seconds if new is None else errors.seconds).append(time.thread_time() - began)
            if new is not None:
                series.when_s.append(t)
                series.predictions.append(new)
            for when, moment in moments.items():
                if predictor is flown and 0 <= t - moment < 0.001 and t > 0.02:
                    errors.nees[when].append(_nees(flown, _state(serve, arrivals, t, task)))
        errors.score(series, truth)


def _state(serve: Serves, arrivals: Arrivals, t: float, task: TaskConfig) -> Array:
    """(6,) true position and velocity."""
    times = np.array([[t - DIFFERENCE_S, t, t + DIFFERENCE_S]])
    ps = sample_serves(serve, arrivals, times, task)[0]
    return np.concatenate([ps[1], (ps[2] - ps[0]) / (2 * DIFFERENCE_S)])


def _nees(predictor: FilterPredictor, truth: Array) -> float:
    """The squared error of position and velocity in units of its covariance; 1 on average if that is honest."""
    off = predictor.state[:6] - truth
    return float(off @ np.linalg.solve(predictor.covariance[:6, :6], off)) / 6
