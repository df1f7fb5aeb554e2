"""How well models of flight predict recorded flights that they were not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.physics.config import PhysicsConfig
from core.physics.contact import come_down
from core.physics.fit_flights import FittedPhysics, RecordedFlight, fit_start, simulate_flight, with_constants
from core.physics.flight import air_from_config

Array = NDArray[np.float64]

OBSERVED_S: Final = 0.150
AHEAD_S: Final = (0.1, 0.2, 0.3)
NEAR_S: Final = 0.006
"""A recorded point counts as being at a time if it is so near; the model is then asked for the point's own time."""


@dataclass(frozen=True, slots=True)
class ModelErrors:
    """Errors of one model over the test flights; millimetres, nan where no flight is long enough."""

    model: str
    bounce_median_mm: float
    bounce_p95_mm: float
    ahead_median_mm: dict[float, float]
    """By seconds ahead of the last observation."""
    ahead_p95_mm: dict[float, float]
    flights: dict[float, int]
    """How many are long enough."""


def models(fitted: FittedPhysics) -> dict[str, tuple[PhysicsConfig, bool]]:
    """What is compared: the physics, and whether the flight's spin is estimated. All share the fitted table."""
    both = fitted.profile()
    drag = with_constants(0.0, fitted.drag_coefficient, fitted.restitution, fitted.friction)
    gravity = replace(drag, air=replace(drag.air, drag_coefficient=0.0))
    return {"gravity": (gravity, False), "drag": (drag, False), "drag + Magnus": (both, True)}


def compare_models(
    flights: Sequence[RecordedFlight], fitted: FittedPhysics, progress: Callable[[float], None] = lambda share: None
) -> list[ModelErrors]:
    """Each model observes the first 150 ms of each flight and predicts the rest."""
    truth_physics = fitted.profile()
    bounces = [bounce_point(fit_start(flight, truth_physics, with_spin=True), truth_physics) for flight in flights]
    found = []
    for number, (name, (physics, with_spin)) in enumerate(models(fitted).items()):
        bounce_mm: list[float] = []
        ahead_mm: dict[float, list[float]] = {ahead: [] for ahead in AHEAD_S}
        for flight, bounce in zip(flights, bounces, strict=True):
            seen = flight.t_s <= OBSERVED_S
            if seen.sum() < 6 or bounce is None:
                continue
            start = fit_start(
                RecordedFlight(flight.name, flight.t_s[seen], flight.ps_m[seen]), physics, with_spin=with_spin
            )
            if bounce[0] > OBSERVED_S:
                said = bounce_point(start, physics)
                bounce_mm.append(1e3 * float(np.linalg.norm(said[1:] - bounce[1:])) if said is not None else np.inf)
            for ahead, errors in ahead_mm.items():
                wanted = flight.t_s[seen][-1] + ahead
                near = int(np.abs(flight.t_s - wanted).argmin())
                if abs(flight.t_s[near] - wanted) <= NEAR_S:
                    place = simulate_flight(start, flight.t_s[near : near + 1], physics)[0]
                    errors.append(1e3 * float(np.linalg.norm(place - flight.ps_m[near])))
        found.append(
            ModelErrors(
                name,
                *_median_and_p95(bounce_mm),
                {ahead: _median_and_p95(errors)[0] for ahead, errors in ahead_mm.items()},
                {ahead: _median_and_p95(errors)[1] for ahead, errors in ahead_mm.items()},
                {ahead: len(errors) for ahead, errors in ahead_mm.items()},
            )
        )
        progress((number + 1) / 3)
    return found


def bounce_point(start: Array, physics: PhysicsConfig) -> Array | None:
    """(3,) time, x and y at which the ball first comes down to the table's plane; None if it does not."""
    landed = np.empty(9)
    t_s = come_down(start, air_from_config(physics), landed)
    return None if np.isnan(t_s) else np.array([t_s, landed[0], landed[1]])


def _median_and_p95(values: list[float]) -> tuple[float, float]:
    if not values:
        return float("nan"), float("nan")
    return float(np.median(values)), float(np.percentile(values, 95))
