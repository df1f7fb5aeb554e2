"""Model of the stroke as a Gaussian process, learned from balls; only gravity is given.

Where a ball came down and how high it crossed the net tell with what velocity it left the racket. That velocity is a
smooth function of the one it came with, of the racket's angles and of its speed: the law of reflection, which is
learned here and not told. (Regression as in Rasmussen and Williams 2006, chapters 2 and 5.)
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.task.normalise import STATE_CENTRE, STATE_SCALE, normal_racket_speeds
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]

AMPLITUDE_MPS: Final = 3.0
"""Prior standard deviation of the velocity's constant, linear and curved part each (choice: wide)."""
LENGTHS: Final = (2.0, 4.0)
"""Candidate length scales, in units of the inputs, which are about 1; the likelier one is used, as with"""
NOISES_MPS: Final = (1e-3, 1e-2, 0.03, 0.1, 0.3)
"""the residual noise: 1 mm/s with the true state, some cm/s with a perceived state."""
ODD: Final = 5.0
"""A ball more standard deviations than this from its leave-one-out prediction is an outlier and is dropped."""
SLOWEST_MPS: Final = 0.3
"""Lower bound of the speed: slower balls do not come near the net."""


def stroke_inputs(states: Array, racket_mps: Array, actions: Array) -> Array:
    """(N, 7) velocity, angles and racket speed, scaled, of states (N, 6), speeds (N,) and actions (N, 3)."""
    velocities = (states[:, 3:6] - STATE_CENTRE[3:]) / STATE_SCALE[3:]
    speeds = normal_racket_speeds(racket_mps)[:, None].astype(np.float64)
    return np.concatenate([velocities, actions, speeds], axis=1)


def velocities_after(states: Array, landings_m: Array, net_z_m: Array) -> Array:
    """(N, 3) with which balls left the racket at (N, 6), came down at (N, 2) and crossed the net at a height (N,).

    NaN where no parabola does that.
    """
    p, drop_m = states[:, :3], BALL_RADIUS_M - states[:, 2]
    away_m = landings_m - p[:, :2]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = -p[:, 0] / away_m[:, 0]  # of the flight, at the net
        rise_m = net_z_m - p[:, 2] - share * drop_m
        t = np.sqrt(2 * rise_m / (GRAVITY_MPS2 * share * (1 - share)))
        return np.column_stack([away_m / t[:, None], drop_m / t + GRAVITY_MPS2 * t / 2])


def landings_of(states: Array, velocities: Array) -> Array:
    """(N, 2) where balls that leave states (N, 6) with velocities (N, 3) come down to the table's plane."""
    up = velocities[:, 2]
    down = np.sqrt(np.maximum(up**2 + 2 * GRAVITY_MPS2 * (states[:, 2] - BALL_RADIUS_M), SLOWEST_MPS**2))
    return states[:, :2] + velocities[:, :2] * ((up + down) / GRAVITY_MPS2)[:, None]


class GaussianProcessModel:
    """Predicts the velocity after a stroke from at least two observed balls."""

    def __init__(self, inputs: Array, velocities: Array) -> None:
        """Fit to `stroke_inputs` (N, 7) and `velocities_after` (N, 3), all finite."""
        self._fit(inputs, velocities)
        if (sound := ~self._odd_ones()).sum() >= 2 and not sound.all():
            self._fit(inputs[sound], velocities[sound])

    def _fit(self, inputs: Array, velocities: Array) -> None:
        self._inputs, self._mean = inputs, velocities.mean(0)
        off, likeliest = velocities - self._mean, -np.inf
        for length in LENGTHS:
            prior = _covariances(inputs, inputs, length)
            for noise in NOISES_MPS:
                root = np.linalg.cholesky(prior + noise**2 * np.eye(len(inputs)))
                inverse = np.linalg.inv(root)
                weights = inverse.T @ (inverse @ off)
                evidence = -0.5 * (off * weights).sum() - off.shape[1] * np.log(np.diag(root)).sum()
                if evidence > likeliest:
                    likeliest, self.length, self.noise_mps = evidence, length, noise
                    self._weights, self._precision = weights, (inverse**2).sum(0)

    def _odd_ones(self) -> NDArray[np.bool_]:
        """(N,) whether each ball is an outlier by leave-one-out prediction."""
        off_sigmas = np.abs(self._weights) / np.sqrt(self._precision)[:, None]
        return (off_sigmas > ODD).any(axis=1)

    def __call__(self, inputs: Array) -> tuple[Array, Array]:
        """(M, 3) velocities, and (M, 3, 2) their derivatives by the last two angles."""
        curved = _curved(inputs, self._inputs, self.length)
        linear = AMPLITUDE_MPS**2 * self._inputs.T @ self._weights
        constant = self._mean + AMPLITUDE_MPS**2 * self._weights.sum(0)
        slopes = []
        for k in (4, 5):
            towards = curved * (self._inputs[:, k] - inputs[:, k, None])
            slopes.append(towards @ self._weights / self.length**2 + linear[k])
        return constant + inputs @ linear + curved @ self._weights, np.stack(slopes, axis=2)


def _curved(a: Array, b: Array, length: float) -> Array:
    square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    return AMPLITUDE_MPS**2 * np.exp(-0.5 * np.maximum(square, 0.0) / length**2)


def _covariances(a: Array, b: Array, length: float) -> Array:
    return _curved(a, b, length) + AMPLITUDE_MPS**2 * (1 + a @ b.T)
