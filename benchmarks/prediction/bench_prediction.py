"""How well the flight is predicted: the filter and the paper's rule on simulated flights with spin, truth plus 1 mm.

Profile `real`, 1 kHz, the serve speeds in turn, each with a random spin. The paper's rule knows gravity and, for the
bounce, the medians of recorded ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine
from benchmarks.prediction.prediction_errors import (
    AFTER_BOUNCE_S,
    BEFORE_LANDING_S,
    FlightTruth,
    PredictionErrors,
    PredictionSeries,
)
from core.physics import Serves, TaskConfig
from core.physics.episode import Arrivals
from core.physics.task import STAGE_SPEEDS_MPS, task_profile
from core.simulation.episodes import draw_serves, fly_serves
from core.simulation.episodes.closed_form import sample_serves
from core.trajectory import FilterPredictor, PaperPredictor, filter_for, predictor_for

Array = NDArray[np.float64]

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
