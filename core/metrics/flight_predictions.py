"""How well recorded flights are predicted from their first 150 ms: by models of flight, and by predictors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.metrics.score import statistic_of
from core.physics.config import PhysicsConfig
from core.physics.contact import come_down
from core.physics.fit_flights import FittedPhysics, RecordedFlight, fit_start, simulate_flight, with_constants
from core.physics.flight import air_from_config
from core.trajectory import FilterConfig, FilterPredictor, PaperPredictor, predictor_for

Array = NDArray[np.float64]
Recorded = tuple[RecordedFlight, Array | None]
"""A flight with its bounce (time, x and y), or None."""

OBSERVED_S: Final = 0.150
"""As long as `predict` looks by default."""
AHEAD_S: Final = (0.1, 0.2, 0.3)
NEAR_S: Final = 0.006
"""Largest distance of a recorded point from a wanted time; the prediction is for the point's own time."""


@dataclass(frozen=True, slots=True)
class FlightErrors:
    """Errors over the flights, in millimetres; nan where no flight is long enough. Dicts are by seconds ahead."""

    bounce_median_mm: float
    bounce_p95_mm: float
    bounces: int
    ahead_median_mm: dict[float, float]
    ahead_p95_mm: dict[float, float]
    flights: dict[float, int]
    """Number of flights that are long enough."""
    normalised: dict[float, float]
    """Mean squared error over the predicted variance plus the point's noise, per dimension: 1 is consistent. Only where
    a variance was predicted."""
    normalised_but_worst: dict[float, float]
    """`normalised` without the worst flight: one may touch the net after it was seen."""


class PredictedFlight(NamedTuple):
    """Prediction of one flight."""

    bounce: Array | None
    """Time, x and y of the bounce."""
    positions: Callable[[Array], tuple[Array, Array | None]]
    """Maps times (N,) to points (N, 3) and, if known, variances (N, 3) of their distance from recorded points."""


def compare_models(
    flights: Sequence[RecordedFlight], fitted: FittedPhysics, progress: Callable[[float], None] = lambda share: None
) -> dict[str, FlightErrors]:
    """Compare least-squares fits, each with the fitted table; they have no uncertainty."""
    both = fitted.profile()
    drag = with_constants(0.0, fitted.drag_coefficient, fitted.restitution, fitted.friction)
    gravity = replace(drag, air=replace(drag.air, drag_coefficient=0.0))
    bounced = [(flight, bounce) for flight, bounce in _with_bounces(flights, fitted) if bounce is not None]
    found: dict[str, FlightErrors] = {}
    for name, physics in {"gravity": gravity, "drag": drag, "drag + Magnus": both}.items():
        found[name] = _score(partial(_fitted, physics, with_spin=physics is both), bounced)
        progress(len(found) / 3)
    return found


def compare_predictors(flights: Sequence[RecordedFlight], fitted: FittedPhysics) -> dict[str, FlightErrors]:
    """Compare the filter (with the fitted constants and their usual uncertainty) and the paper's predictor, point by
    point.
    """
    config = replace(
        FilterConfig(),
        drag=fitted.drag_coefficient,
        restitution=fitted.restitution,
        friction=fitted.friction,
        magnus=fitted.magnus_coefficient,
    )
    predictors = {"filter": FilterPredictor(config), "paper": PaperPredictor(predictor_for("real"))}
    bounces = list(_with_bounces(flights, fitted))
    return {name: _score(partial(_predicted, predictor), bounces) for name, predictor in predictors.items()}


def bounce_point(start: Array, physics: PhysicsConfig) -> Array | None:
    """(3,) time, x and y at which the ball first comes down to the table's plane; None if it does not."""
    landed = np.empty(9)
    t_s = come_down(start, air_from_config(physics), landed)
    return None if np.isnan(t_s) else np.array([t_s, landed[0], landed[1]])


def _with_bounces(flights: Sequence[RecordedFlight], fitted: FittedPhysics) -> Iterable[Recorded]:
    physics = fitted.profile()
    return ((flight, bounce_point(fit_start(flight, physics, with_spin=True), physics)) for flight in flights)


def _fitted(physics: PhysicsConfig, flight: RecordedFlight, *, with_spin: bool) -> PredictedFlight | None:
    if len(flight.t_s) < 6:
        return None
    start = fit_start(flight, physics, with_spin=with_spin)
    bounce = bounce_point(start, physics)
    never = np.full(3, np.inf)
    return PredictedFlight(
        never if bounce is None else bounce, lambda t_s: (simulate_flight(start, t_s, physics), None)
    )


def _predicted(predictor: FilterPredictor | PaperPredictor, flight: RecordedFlight) -> PredictedFlight | None:
    predictor.forget_flight()
    for t, p in zip(flight.t_s, flight.ps_m, strict=True):
        predictor.add(round(1e6 * t), p)
    predicted = predictor.predict() if isinstance(predictor, FilterPredictor) else predictor.latest
    if predicted is None:
        return None
    noise_m2 = np.square(predictor.config.sigma_point_m)
    if isinstance(predictor, FilterPredictor):
        noise_m2 = noise_m2 * predictor.noise_scales

    def positions(t_s: Array) -> tuple[Array, Array]:
        ps, sigmas = predicted.positions(t_s)
        return ps, sigmas**2 + noise_m2

    landing = predicted.landing
    return PredictedFlight(None if landing is None else np.array([landing.t_s, *landing.p_world_m[:2]]), positions)


def _score(predict: Callable[[RecordedFlight], PredictedFlight | None], flights: Sequence[Recorded]) -> FlightErrors:
    bounce_mm: list[float] = []
    ahead_mm: dict[float, list[float]] = {ahead: [] for ahead in AHEAD_S}
    normalised: dict[float, list[float]] = {ahead: [] for ahead in AHEAD_S}
    for flight, bounce in flights:
        seen = flight.t_s <= OBSERVED_S
        predicted = predict(RecordedFlight(flight.name, flight.t_s[seen], flight.ps_m[seen]))
        if predicted is None:
            continue
        # A bounce that was observed is no prediction.
        if bounce is not None and bounce[0] > OBSERVED_S and predicted.bounce is not None:
            bounce_mm.append(1e3 * float(np.linalg.norm(predicted.bounce[1:] - bounce[1:])))
        for ahead in AHEAD_S:
            wanted = flight.t_s[seen][-1] + ahead
            near = int(np.abs(flight.t_s - wanted).argmin())
            if abs(flight.t_s[near] - wanted) <= NEAR_S:
                ps, variances = predicted.positions(flight.t_s[near : near + 1])
                miss = ps[0] - flight.ps_m[near]
                ahead_mm[ahead].append(1e3 * float(np.linalg.norm(miss)))
                if variances is not None:
                    normalised[ahead].append(float(np.mean(miss**2 / variances)))
    return FlightErrors(
        _percentile(bounce_mm, 50),
        _percentile(bounce_mm, 95),
        len(bounce_mm),
        {ahead: _percentile(errors, 50) for ahead, errors in ahead_mm.items()},
        {ahead: _percentile(errors, 95) for ahead, errors in ahead_mm.items()},
        {ahead: len(errors) for ahead, errors in ahead_mm.items()},
        {ahead: float(np.mean(errors)) for ahead, errors in normalised.items() if errors},
        {ahead: float(np.mean(sorted(errors)[:-1])) for ahead, errors in normalised.items() if len(errors) > 1},
    )


def _percentile(values: Sequence[float], percent: float) -> float:
    return statistic_of(np.asarray(values, np.float64), lambda found: np.percentile(found, percent))
