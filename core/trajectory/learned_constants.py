"""Constants of air and table learned from the balls so far: a lab's constants do not change between two balls.

Three numbers with standard deviations, and how probable it is that there is air at all. What a ball says of its own
constants is one draw around the lab's: they scatter from ball to ball (the models of drag and bounce are crude).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.trajectory.ball_filter import BallFilter
from core.trajectory.ball_kernel import DRAG
from core.trajectory.filter_config import PROCESS_NOISE_KINDS, FilterConfig, with_unknown_constants, without_air

Array = NDArray[np.float64]

NAMES: Final = ("drag", "restitution", "friction")
"""Names in the order of the filter's state, from `DRAG` on."""
LOWEST, HIGHEST = np.array([0.0, 0.5, 0.0]), np.array([1.0, 1.0, 1.0])
NO_DRAG: Final = 1e-3
"""A filter with a smaller drag coefficient flew `without_air`, and says nothing of the drag: real balls have 0.55."""
FEWEST_POINTS: Final = 20
"""A flight of fewer points is not used (choice)."""
CHANGE: Final = 0.01
"""Probability that the physics changes from one ball to the next: with air, or without (choice)."""


@dataclass(frozen=True, slots=True, eq=False)
class LearnedConstants:
    """Means and variances (3,) of drag coefficient, restitution and friction."""

    means: Array
    variances: Array
    """Variances of the lab's constants; the scatter from ball to ball comes on top."""
    scatter: Array
    """(3,) standard deviations from ball to ball."""
    air: float
    """The probability that balls fly through air."""
    balls: int
    """Number of balls learned from."""

    @property
    def sigmas(self) -> Array:
        """(3,) standard deviations of the lab's constants."""
        return np.sqrt(self.variances)

    def kinds(self, config: FilterConfig) -> list[tuple[FilterConfig, float]]:
        """Filter configs of the next ball with their probabilities: without air, and with air for each process
        noise.
        """
        known = _before_any_ball(config)
        through = self._with_constants(known, NAMES)
        found = [(self._with_constants(without_air(known), NAMES[1:]), 1 - self.air)]
        for share, air, bounce_mps in PROCESS_NOISE_KINDS:
            kind = through
            if air is not None and bounce_mps is not None:
                kind = dataclasses.replace(through, air_noise=air, bounce_noise_mps=bounce_mps)
            found.append((kind, share * self.air))
        return found

    def after(self, ball: BallFilter, probability: float, air: float) -> LearnedConstants:
        """The constants after a flight, weighted by the probability of its filter among the flight's filters."""
        if ball.points - ball.strays < FEWEST_POINTS:  # without outliers: most flights end with some, from the hit
            return self
        first = 0 if ball.state[DRAG] > NO_DRAG else 1
        rows = slice(DRAG + first, DRAG + 3)
        means, variances = self.means.copy(), self.variances.copy()
        prior = variances[first:] + self.scatter[first:] ** 2
        gain = probability * variances[first:] / prior
        off = np.clip(ball.state[rows] - means[first:], -3 * np.sqrt(prior), 3 * np.sqrt(prior))
        means[first:] += gain * off
        variances[first:] -= gain**2 * np.maximum(prior - ball.covariance.diagonal()[rows], 0.0)
        return dataclasses.replace(
            self,
            means=np.clip(means, LOWEST, HIGHEST),
            variances=variances,
            air=(1 - 2 * CHANGE) * air + CHANGE,
            balls=self.balls + 1,
        )

    def _with_constants(self, config: FilterConfig, names: tuple[str, ...]) -> FilterConfig:
        sigmas = np.sqrt(self.variances + self.scatter**2)
        constants: dict[str, float] = {}
        for name, mean, sigma in zip(NAMES, self.means.tolist(), sigmas.tolist(), strict=True):
            if name in names:
                constants |= {name: mean, f"{name}_sigma": sigma}
        return dataclasses.replace(config, **constants)


def _before_any_ball(config: FilterConfig) -> FilterConfig:
    return config if config.has_fitted_constants else with_unknown_constants(config)


def nothing_learned(config: FilterConfig) -> LearnedConstants:
    """Constants before the first ball: those fitted to other balls, or the published ones."""
    c = _before_any_ball(config)
    return LearnedConstants(
        means=np.array([c.drag, c.restitution, c.friction]),
        variances=np.square([c.drag_sigma, c.restitution_sigma, c.friction_sigma]),
        scatter=np.array([c.drag_scatter, c.restitution_scatter, c.friction_scatter]),
        air=c.air_probability,
        balls=0,
    )
