"""How well the filter and the paper's rule, fed point by point, predict recorded flights that were kept apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.bench.physics.physics_report import AHEAD_S, NEAR_S, OBSERVED_S, bounce_point
from core.physics.fit_flights import FittedPhysics, RecordedFlight, fit_start
from core.trajectory import FilterConfig, FilterPredictor, PaperPredictor, Prediction, predictor_for

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PredictorErrors:
    """Errors of one method over the flights, in millimetres; nan where no flight is long enough."""

    method: str
    bounce_median_mm: float
    bounce_p95_mm: float
    bounces: int
    ahead_median_mm: dict[float, float]
    """By seconds ahead of the last observation."""
    ahead_p95_mm: dict[float, float]
    flights: dict[float, int]
    """How many are long enough."""
    normalised: dict[float, float]
    """Mean squared error in units of what was said of it and of the noise of the point, over three: 1 is honest."""
    normalised_but_worst: dict[float, float]
    """The same without the flight that is farthest off: one may touch the net after it was seen."""


def compare_predictors(flights: Sequence[RecordedFlight], fitted: FittedPhysics) -> list[PredictorErrors]:
    """Both see the first 150 ms of each flight; the filter has the fitted constants, each with its usual spread."""
    physics = fitted.profile()
    bounces = [bounce_point(fit_start(flight, physics, with_spin=True), physics) for flight in flights]
    config = replace(
        FilterConfig(),
        drag=fitted.drag_coefficient,
        restitution=fitted.restitution,
        friction=fitted.friction,
        magnus=fitted.magnus_coefficient,
    )
    return [
        _score(name, predictor, flights, bounces)
        for name, predictor in (("filter", FilterPredictor(config)), ("paper", PaperPredictor(predictor_for("real"))))
    ]


def _score(
    name: str,
    predictor: FilterPredictor | PaperPredictor,
    flights: Sequence[RecordedFlight],
    bounces: Sequence[Array | None],
) -> PredictorErrors:
    off_bounce: list[float] = []
    off: dict[float, list[float]] = {ahead: [] for ahead in AHEAD_S}
    normalised: dict[float, list[float]] = {ahead: [] for ahead in AHEAD_S}
    for flight, bounce in zip(flights, bounces, strict=True):
        seen = flight.t_s <= OBSERVED_S
        said = _predict(predictor, flight.t_s[seen], flight.ps_m[seen])
        if said is None:
            continue
        if bounce is not None and bounce[0] > OBSERVED_S and said.landing is not None:
            found = np.array([said.landing.t_s, *said.landing.p_world_m[:2]])
            off_bounce.append(1e3 * float(np.linalg.norm(found[1:] - bounce[1:])))
        for ahead in AHEAD_S:
            wanted = flight.t_s[seen][-1] + ahead
            near = int(np.abs(flight.t_s - wanted).argmin())
            if abs(flight.t_s[near] - wanted) > NEAR_S:
                continue
            ps, sigmas = said.positions(flight.t_s[near : near + 1])
            miss = ps[0] - flight.ps_m[near]
            off[ahead].append(1e3 * float(np.linalg.norm(miss)))
            noise_m2 = np.square(predictor.config.sigma_point_m)
            if isinstance(predictor, FilterPredictor):
                noise_m2 = noise_m2 * predictor.noise_scales
            normalised[ahead].append(float(np.mean(miss**2 / (sigmas[0] ** 2 + noise_m2))))
    pairs = normalised.items()
    return PredictorErrors(
        name,
        _percentile(off_bounce, 50),
        _percentile(off_bounce, 95),
        len(off_bounce),
        {ahead: _percentile(values, 50) for ahead, values in off.items()},
        {ahead: _percentile(values, 95) for ahead, values in off.items()},
        {ahead: len(values) for ahead, values in off.items()},
        {ahead: float(np.mean(values)) if values else float("nan") for ahead, values in pairs},
        {ahead: float(np.mean(sorted(values)[:-1])) if len(values) > 1 else float("nan") for ahead, values in pairs},
    )


def _predict(predictor: FilterPredictor | PaperPredictor, t_s: Array, ps_m: Array) -> Prediction | None:
    """What it says after the last point."""
    predictor.reset()
    for t, p in zip(t_s, ps_m, strict=True):
        predictor.add(round(1e6 * t), p)
    return predictor.predict() if isinstance(predictor, FilterPredictor) else predictor.latest


def _percentile(values: Sequence[float], percent: float) -> float:
    return float(np.percentile(values, percent)) if values else float("nan")
