"""Fits the errors of a chain's points along flights: the constants of `core/learning/task/timed_points.py`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.task.timed_points import FEATURES, PointErrors, place_and_motion

Array = NDArray[np.float64]
NEAR_BOUNCE_S: Final = 0.004
"""Points this close to a bounce may contain both sides of it; the filter ignores them."""
FEWEST: Final = 8
"""Fewest points of a stage of a flight for an estimate of their scatter."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenFlight:
    """Points of one flight: their times after the launch, where the ball was, how far off they are."""

    t_s: Array
    truth_m: Array
    """(K, 3)."""
    errors_m: Array
    """(K, 3)."""
    bounce_t_s: float


def fit_point_errors(flights: Sequence[SeenFlight]) -> PointErrors:
    """Fit the error model to observed flights."""
    explained, bias, drift, noise, times = [], [], [], [], []
    for stage in (0, 1):
        parts = [_of_stage(flight, stage) for flight in flights]
        parts = [part for part in parts if len(part[0]) >= FEWEST]
        features = np.vstack([place_and_motion(t, p) for t, p, _ in parts])
        errors_mm = 1e3 * np.vstack([e for _, _, e in parts])
        # A small ridge: the launch position hardly varies, and coefficients must stay bounded.
        scale = features.std(axis=0) + 1e-9
        ridge = np.diag(np.r_[0.0, np.full(FEATURES - 1, 1e-3)] * scale**2 * len(features))
        found = np.linalg.solve(features.T @ features + ridge, features.T @ errors_mm)
        left = [1e3 * e - place_and_motion(t, p) @ found for t, p, e in parts]
        means = np.array([one.mean(axis=0) for one in left])
        fast = np.sqrt(np.median([np.diff(one, axis=0).var(axis=0) / 2 for one in left], axis=0))
        whole = np.median([one.var(axis=0) for one in left], axis=0)
        slow = np.sqrt(np.maximum(whole - fast**2, 0.0))
        explained.append(found)
        bias.append(means.std(axis=0))
        drift.append(slow)
        noise.append(fast)
        times += [_time_constant_s(t, one) for (t, _, _), one in zip(parts, left, strict=True)]
    return PointErrors(np.array(explained), np.array(bias), np.array(drift), float(np.median(times)), np.array(noise))


def _of_stage(flight: SeenFlight, stage: int) -> tuple[Array, Array, Array]:
    since_s = flight.t_s - flight.bounce_t_s
    which = since_s > NEAR_BOUNCE_S if stage else since_s < -NEAR_BOUNCE_S
    return flight.t_s[which], flight.truth_m[which], flight.errors_m[which]


def _time_constant_s(t_s: Array, left_mm: Array) -> float:
    """Time constant of the residuals: their correlation along the flight falls to 1 / e."""
    one = left_mm - left_mm.mean(axis=0)
    power = float((one * one).sum())
    for lag in range(1, len(one) - 1):
        if float((one[lag:] * one[:-lag]).sum()) < power / np.e:
            return lag * float(np.median(np.diff(t_s)))
    return float(t_s[-1] - t_s[0])
