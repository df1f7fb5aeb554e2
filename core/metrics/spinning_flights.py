"""Prediction errors of a filter on recorded flights with spin, and the consistency of its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.physics.config import physics_profile
from core.physics.fit_flights import RecordedFlight, fit_start
from core.table import BALL_RADIUS_M, NET_HEIGHT_M
from core.trajectory import FilterPredictor

Array = NDArray[np.float64]

RATE_HZ: Final = 140.0
"""Rate of the points given to the filter."""
NOISE_M: Final = 0.003
"""Standard deviation of these points along each axis."""
RECORDED_NOISE_M: Final = 0.0015
"""Noise already on recorded points (1 to 2 mm)."""
MAX_SPIN_RADPS: Final = 450.0
"""Largest credible spin; flights with more have touched something."""
SEEN_S: Final = 0.100
"""Time of a flight that is observed before the first prediction."""
EVERY: Final = 2
"""A prediction is evaluated at every second point after that."""
NEAR_S: Final = 0.006
AHEAD_S: Final = (0.1, 0.2, 0.3)


@dataclass(frozen=True, slots=True, eq=False)
class ForeseenPoints:
    """N predictions of one horizon: their errors, absolute and normalised by the predicted variance."""

    errors_m: Array
    """(N,) distances, m."""
    squared: Array
    """(N,) mean over three axes of squared error over variance: 1 on average is honest."""

    @property
    def worst_tenth_m(self) -> float:
        """90th percentile of the errors, m."""
        return float(np.percentile(self.errors_m, 90))

    @property
    def median_m(self) -> float:
        """Median error, m."""
        return float(np.median(self.errors_m))

    @property
    def nees(self) -> float:
        """Mean normalised error squared, per dimension."""
        return float(self.squared.mean())


def spinning_flights(flights: Sequence[RecordedFlight]) -> list[RecordedFlight]:
    """Flights with a credible spin, by a fit of the whole flight with the constants of `real`."""
    real = physics_profile("real")
    spins = [float(np.linalg.norm(fit_start(flight, real, with_spin=True)[6:])) for flight in flights]
    return [flight for flight, spin in zip(flights, spins, strict=True) if spin <= MAX_SPIN_RADPS]


def touches_net(flight: RecordedFlight) -> bool:
    """Whether the recorded ball passed the net's plane lower than one that does not touch it."""
    x, z = flight.ps_m[:, 0], flight.ps_m[:, 2]
    if not x[0] > 0 > x[-1]:
        return False
    return float(np.interp(0.0, x[::-1], z[::-1])) < NET_HEIGHT_M + BALL_RADIUS_M


def thinned(flight: RecordedFlight, seed: int, recorded_noise_m: float = RECORDED_NOISE_M) -> RecordedFlight:
    """Flight as given to the filter: fewer points, with more noise."""
    ticks = np.arange(0.0, flight.t_s[-1], 1 / RATE_HZ)
    rows = np.unique(np.abs(flight.t_s[None] - ticks[:, None]).argmin(axis=1))
    noise = np.random.default_rng(seed).normal(0.0, np.sqrt(NOISE_M**2 - recorded_noise_m**2), (len(rows), 3))
    return RecordedFlight(flight.name, flight.t_s[rows], flight.ps_m[rows] + noise)


def foresee_flights(
    predictor: FilterPredictor,
    flights: Sequence[RecordedFlight],
    *,
    carry: bool = True,
    recorded_noise_m: float = RECORDED_NOISE_M,
) -> dict[float, ForeseenPoints]:
    """Prediction errors by horizon in seconds. Learned constants are kept from flight to flight unless `carry` is
    false.
    """
    errors: dict[float, list[float]] = {ahead: [] for ahead in AHEAD_S}
    squared: dict[float, list[float]] = {ahead: [] for ahead in AHEAD_S}
    predictor.forget()
    for number, flight in enumerate(flights):
        predictor.reset() if carry else predictor.forget()
        seen = thinned(flight, number, recorded_noise_m)
        for k, (t, p) in enumerate(zip(seen.t_s, seen.ps_m, strict=True)):
            predictor.add(round(1e6 * t), p, NOISE_M**2 * np.eye(3))
            prediction = predictor.predict() if t >= SEEN_S and k % EVERY == 0 else None
            if prediction is None:
                continue
            for ahead in AHEAD_S:
                near = int(np.abs(flight.t_s - t - ahead).argmin())
                if abs(flight.t_s[near] - t - ahead) > NEAR_S:
                    continue
                ps, sigmas = prediction.positions(flight.t_s[near : near + 1])
                miss = ps[0] - flight.ps_m[near]
                errors[ahead].append(float(np.linalg.norm(miss)))
                squared[ahead].append(float(np.mean(miss**2 / (sigmas[0] ** 2 + recorded_noise_m**2))))
    return {ahead: ForeseenPoints(np.array(errors[ahead]), np.array(squared[ahead])) for ahead in AHEAD_S}
