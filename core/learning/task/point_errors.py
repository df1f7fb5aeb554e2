"""Error model of stereo points of event cameras: a part explained by position and motion of the ball, and noise.

The explained part is cubic in place and velocity (a fast edge is seen ahead of the ball, a lit one too high). What is
left has a bias per flight, a drift with a time constant, and noise from point to point, before and after the bounce.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MOTION_SCALE: Final = np.array([1.0, 1.0, 1.0, 5.0, 2.0])
"""Scales of the variables that explain errors: x, y, z and the velocity along x and z (along y a ball hardly moves)."""
DEGREE: Final = 3
FEATURES: Final = 56
"""Largest degree of the products of the five variables."""
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


@dataclass(frozen=True, slots=True, eq=False)
class PointErrors:
    """All in millimetres along x, y, z; rows of (2, 3) are before and after the bounce."""

    explained: Array
    """(2, 56, 3) of `place_and_motion`."""
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
    """(K, 56): one, and the products of where the ball is and how fast it goes, by two neighbouring places."""
    steps = np.diff(truth_m, axis=0) / np.diff(t_s)[:, None] if len(t_s) > 1 else np.zeros((1, 3))
    v = np.vstack([steps, steps[-1:]])[: len(t_s)]
    motion = (np.column_stack([truth_m, v[:, [0, 2]]]) / MOTION_SCALE).T
    products = [
        np.prod(motion[list(which)], axis=0)
        for degree in range(1, DEGREE + 1)
        for which in itertools.combinations_with_replacement(range(len(motion)), degree)
    ]
    return np.column_stack([np.ones(len(t_s)), *products])


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


MEASURED: Final = PointErrors(
    explained=np.array(
        [
            [
                [0.121, 0.003, -0.172],
                [0.189, -0.019, -0.098],
                [0.036, -0.187, 0.034],
                [-0.198, -0.011, 0.255],
                [-0.250, 0.010, -0.112],
                [-0.048, -0.048, -0.238],
                [0.157, -0.050, 0.026],
                [0.216, -1.372, -0.047],
                [0.214, 0.121, -0.754],
                [-0.100, -0.029, -0.114],
                [-0.271, 0.025, -0.386],
                [0.375, 0.223, 0.645],
                [0.089, 1.169, 0.096],
                [0.115, 0.412, -0.016],
                [-0.086, 0.757, 0.035],
                [-0.521, 0.520, -0.648],
                [-0.624, -0.121, -0.543],
                [-0.872, 0.324, -1.186],
                [0.033, 0.003, 0.022],
                [-0.085, -0.008, -0.037],
                [-0.153, 0.012, -0.038],
                [0.108, 0.063, 0.072],
                [-0.091, 0.108, -0.105],
                [0.497, 0.127, 0.632],
                [0.303, 0.018, 0.100],
                [0.020, -0.035, -0.269],
                [-0.645, -0.321, 0.330],
                [-0.134, 1.473, 0.050],
                [0.018, -0.129, -0.011],
                [0.175, 0.671, 0.052],
                [1.170, -0.212, -0.567],
                [0.375, 0.149, 0.519],
                [-0.477, -0.041, -2.063],
                [-0.106, -0.002, -0.033],
                [-0.133, 0.017, -0.025],
                [-0.174, -0.030, -0.232],
                [0.031, -0.426, 0.035],
                [-0.343, -1.055, -0.348],
                [0.464, -0.309, 0.049],
                [0.448, 0.392, 0.355],
                [0.379, -0.789, -0.706],
                [0.484, -0.862, -0.086],
                [-0.017, 0.915, 0.033],
                [0.132, 0.068, 0.018],
                [-0.019, 0.156, -0.044],
                [-0.055, 0.242, 0.030],
                [0.549, -1.197, -0.869],
                [-0.409, -0.189, 0.858],
                [-0.465, -0.570, 1.373],
                [-0.158, -0.103, -0.229],
                [-0.813, 0.047, -0.497],
                [-0.000, -0.103, 0.392],
                [0.009, -0.004, -0.002],
                [0.001, -0.006, 0.010],
                [-0.035, 0.005, 0.002],
                [-0.060, 0.001, 0.060],
            ],
            [
                [0.349, -0.004, -0.247],
                [0.125, -0.025, -0.186],
                [-0.163, -0.301, 0.073],
                [0.074, -0.118, 0.262],
                [0.071, 0.030, -0.056],
                [-0.105, -0.021, 0.089],
                [-0.079, -0.005, -0.013],
                [0.000, -0.176, -0.074],
                [0.322, 0.215, 0.240],
                [0.035, 0.047, 0.010],
                [0.126, 0.012, -0.027],
                [-0.132, 0.079, 0.829],
                [-0.185, -2.309, 0.547],
                [0.110, 0.370, 0.146],
                [-0.002, 0.063, -0.209],
                [-0.726, -1.166, 0.260],
                [0.697, -0.269, 0.090],
                [1.591, 1.451, 1.830],
                [0.016, -0.001, 0.025],
                [0.016, 0.047, -0.058],
                [-0.102, -0.042, -0.098],
                [0.054, -0.019, -0.013],
                [0.045, 0.817, -0.028],
                [-0.359, -0.138, -0.177],
                [-0.226, -0.052, -0.023],
                [-0.065, -0.056, -0.413],
                [-1.113, -0.282, 0.755],
                [0.221, -2.091, 0.623],
                [-0.075, 0.481, -0.037],
                [-0.170, -0.201, -0.118],
                [0.615, 0.522, -0.015],
                [1.255, 0.321, 0.402],
                [0.059, -0.503, 2.366],
                [0.061, -0.017, -0.011],
                [0.003, 0.003, -0.115],
                [0.282, -0.011, -0.015],
                [0.339, -0.598, 0.028],
                [-3.848, -1.572, 1.229],
                [0.702, 0.153, -0.157],
                [0.138, -0.003, -0.026],
                [1.192, 4.316, 0.385],
                [-1.008, -4.844, -0.155],
                [-0.688, -4.385, -0.389],
                [0.104, -0.502, 0.082],
                [0.038, -0.929, -0.066],
                [0.072, -0.812, 0.075],
                [5.839, 3.033, 5.201],
                [-1.373, -4.128, -5.932],
                [-3.916, -3.667, -6.161],
                [-1.511, -0.864, -0.270],
                [-2.137, 2.126, -0.238],
                [-0.659, 0.344, 1.393],
                [-0.039, -0.001, -0.015],
                [0.069, 0.080, -0.012],
                [0.015, -0.083, 0.090],
                [0.237, -0.050, 0.112],
            ],
        ]
    ),
    bias=np.array([[0.021, 0.027, 0.020], [0.036, 0.081, 0.046]]),
    drift=np.array([[0.053, 0.119, 0.094], [0.062, 0.154, 0.094]]),
    drift_s=0.006,
    noise=np.array([[0.066, 0.080, 0.068], [0.047, 0.094, 0.055]]),
)
"""Errors of the chain with the detector `refined` and cameras of the `side` placement: fitted to 242 standard serves at
3, 5 and 9 m/s, the even ones of `rallyscope bench state-errors`, which prints a fit to as many as it is told to."""
