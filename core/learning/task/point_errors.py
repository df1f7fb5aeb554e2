"""How the points of two event cameras err: by a part that place and motion of the ball explain, and by chance.

The explained part is quadratic in place and velocity (a fast edge is seen ahead of the ball, a lit one too high). What
is left has a bias per flight, a drift with a time constant, and noise from point to point, before and after the bounce.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FEATURES: Final = 14
"""One, place, velocity, and the products of those that change along a flight."""
NEAR_BOUNCE_S: Final = 0.004
"""Points so near a bounce are of windows that may hold both sides of it; the filter leaves them out."""
FEWEST: Final = 8
"""Points of a stage of a flight that say something of their scatter."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenFlight:
    """Points of one flight: their times after the launch, where the ball was, how far off they are."""

    t_s: Array
    truth_m: Array
    """(K, 3)."""
    errors_m: Array
    """(K, 3)."""
    bounce_t_s: float


@dataclass(frozen=True, slots=True, eq=False)
class PointErrors:
    """All in millimetres along x, y, z; rows of (2, 3) are before and after the bounce."""

    explained: Array
    """(2, 14, 3) of `place_and_motion`."""
    bias: Array
    """(2, 3) standard deviation from flight to flight."""
    drift: Array
    """(2, 3)."""
    drift_s: float
    noise: Array
    """(2, 3)."""

    def draw(self, t_s: Array, truth_m: Array, bounce_t_s: Array, rng: np.random.Generator) -> Array:
        """Errors (N, K, 3) in metres of N balls at times (K,) in rising order, their places (N, K, 3) given."""
        n, k = truth_m.shape[:2]
        after = (t_s > bounce_t_s[:, None]).astype(np.int8)
        features = np.stack([place_and_motion(t_s, one) for one in truth_m]) if n else np.empty((0, k, FEATURES))
        explained = np.where(after[..., None] == 1, features @ self.explained[1], features @ self.explained[0])
        bias = rng.standard_normal((n, 1, 3))
        steps, noise = rng.standard_normal((2, n, k, 3))
        drift = steps.copy()
        for i in range(1, k):
            kept = np.exp(-(t_s[i] - t_s[i - 1]) / self.drift_s)
            drift[:, i] = kept * drift[:, i - 1] + np.sqrt(1 - kept * kept) * steps[:, i]
        return 1e-3 * (explained + self.bias[after] * bias + self.drift[after] * drift + self.noise[after] * noise)


def place_and_motion(t_s: Array, truth_m: Array) -> Array:
    """(K, 14): one, where the ball is, how fast it goes by two neighbouring places, and products of both."""
    v = np.zeros_like(truth_m)
    if len(t_s) > 1:
        steps = np.diff(truth_m, axis=0) / np.diff(t_s)[:, None]
        v = np.vstack([steps, steps[-1:]])
    (x, _, z), (vx, _, vz) = truth_m.T, v.T
    return np.column_stack([np.ones(len(t_s)), truth_m, v, x * x, z * z, vx * vx, vz * vz, x * vx, z * vz, vx * vz])


def fit_point_errors(flights: Sequence[SeenFlight]) -> PointErrors:
    """The errors of flights that were seen, split into these parts."""
    explained, bias, drift, noise, times = [], [], [], [], []
    for stage in (0, 1):
        parts = [_of_stage(flight, stage) for flight in flights]
        parts = [part for part in parts if len(part[0]) >= FEWEST]
        features = np.vstack([place_and_motion(t, p) for t, p, _ in parts])
        errors_mm = 1e3 * np.vstack([e for _, _, e in parts])
        # A little ridge: the plane of a launch hardly varies, and no coefficient may run away for it.
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
    """How long what is left stays alike: where its correlation along the flight falls to 1 / e."""
    one = left_mm - left_mm.mean(axis=0)
    power = float((one * one).sum())
    for lag in range(1, len(one) - 1):
        if float((one[lag:] * one[:-lag]).sum()) < power / np.e:
            return lag * float(np.median(np.diff(t_s)))
    return float(t_s[-1] - t_s[0])


MEASURED: Final = PointErrors(
    explained=np.array(
        [
            [
                [-0.146, 0.139, 0.133],
                [0.745, -0.154, -0.646],
                [0.03, 0.068, -0.045],
                [-0.214, -0.713, -0.174],
                [-0.122, -0.03, 0.009],
                [0.0, 0.0, 0.0],
                [-0.301, 0.084, -0.102],
                [0.0, -0.0, -0.222],
                [0.953, 0.527, -0.932],
                [-0.003, -0.002, -0.003],
                [-0.032, 0.002, -0.091],
                [0.09, -0.017, -0.092],
                [0.038, -0.126, -0.072],
                [-0.048, 0.0, 0.042],
            ],
            [
                [0.465, -1.682, 0.634],
                [0.385, -2.1, 2.19],
                [0.036, 0.924, 0.018],
                [0.909, 3.293, 4.803],
                [0.045, -0.095, -0.15],
                [0.0, 0.0, 0.0],
                [-0.022, 0.091, -0.098],
                [-0.275, -0.86, 0.659],
                [-0.706, -5.903, -3.407],
                [-0.002, 0.015, 0.001],
                [-0.022, 0.056, 0.14],
                [0.097, -0.094, 0.012],
                [-0.4, -0.393, -1.566],
                [-0.012, 0.056, 0.072],
            ],
        ]
    ),
    bias=np.array([[0.054, 0.067, 0.027], [0.045, 0.069, 0.072]]),
    drift=np.array([[0.062, 0.14, 0.111], [0.049, 0.172, 0.089]]),
    drift_s=0.006,
    noise=np.array([[0.062, 0.081, 0.078], [0.057, 0.093, 0.062]]),
)
"""Of the chain with the detector `refined`, cameras of the `side` placement: a first fit, to about 25 serves at 3, 5
and 9 m/s. `rallyscope bench state-errors` prints one to as many as it is told to."""
