"""Extended Kalman filter of a ball with bounces on the table."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.trajectory.ball_kernel import LIFT
from core.trajectory.bounce_question import SIGMAS, BounceQuestion, coming_contact
from core.trajectory.filter_config import FilterConfig
from core.trajectory.filter_kernel import ProcessNoise, move
from core.trajectory.observation import Observation, PointObservation

Array = NDArray[np.float64]

FIRST_VELOCITY_MPS: Final = (-4.0, 0.0, 0.0)
FIRST_SIGMA_MPS: Final = 10.0
SETTLED: Final = 4
"""Points from which the velocity is known well enough to predict a bounce."""
TYPICAL: Final = 8
"""Points from which a point's likelihood reflects the flight rather than the prior."""
SCALES: Final = (0.01, 100.0)
"""Bounds of the estimated scale of the noise variance."""


class BallFilter:
    """One flight; what the model leaves out is one of the two amounts of the configuration."""

    def __init__(
        self, config: FilterConfig, t_us: int, p: Array, noise_m2: Array, *, needs_tick: bool, odds: float
    ) -> None:
        """Begin with a point and its covariance; `odds`: of this kind of flight before anything is seen."""
        c = self._config = config
        air, bounce = (c.restless_air, c.restless_bounce_mps) if needs_tick else (c.air_noise, c.bounce_noise_mps)
        self.process_noise = ProcessNoise(LIFT * c.magnus, air, bounce, c.ahead_m, c.ahead_s)
        self.state = np.array([*p, *FIRST_VELOCITY_MPS, 0.0, 0.0, 0.0, c.drag, c.restitution, c.friction, 0.0, 0.0])
        sigmas = [0.0] * 3 + [FIRST_SIGMA_MPS] * 3 + [c.spin_sigma_radps] * 3
        constants = [c.drag_sigma, c.restitution_sigma, c.friction_sigma, c.table_sigma_m, c.ahead_m]
        self.covariance = np.diag(np.square([*sigmas, *constants]))
        self.covariance[:3, :3] = noise_m2 + c.ahead_m**2 * np.eye(3)
        self.t_us = self.first_us = t_us
        self.bounces_us: tuple[int, ...] = ()
        self.strays = 0
        """Consecutive outliers."""
        self.prior = math.log(odds)
        """Logarithm of the odds before anything is seen."""
        self.log_odds = self.prior
        """Log odds of this kind of flight given its points, up to a constant."""
        self.spoke = False
        """Whether the newest observation was compared with the prediction; those near a bounce are not."""
        self.accepted = False
        """Whether the newest observation moved the estimate."""
        self.points = 1
        """Number of points used."""
        self._question: BounceQuestion | None = None
        self._tally = np.zeros((2, 3))

    @property
    def is_asking(self) -> bool:
        """Whether it is undecided if the ball has bounced."""
        return self._question is not None

    @property
    def noise_scales(self) -> Array:
        """(3,) variances of the observations over what was said of them, by the innovations of this flight."""
        weight = self._config.adapt_points
        if weight == 0:
            return np.ones(3)
        return np.clip((weight + self._tally[0]) / (weight + self._tally[1]), *SCALES)

    def take(self, t_us: int, seen: Observation) -> None:
        """Predict to this time, and update with what was seen. Pixels neither count as points nor begin a flight."""
        if self._question is None:
            self._question = self._ask(t_us)
        seconds, self.t_us = (t_us - self.t_us) * 1e-6, t_us
        if self._question is None:
            move(self.state, self.covariance, seconds, self.process_noise)
            noise_scales, lift = self.noise_scales, self.process_noise.lift
            distance, likelihood = seen.update(self.state, self.covariance, noise_scales, self._tally, lift)
            self.spoke = True
            self.accepted = distance <= seen.gate
            if isinstance(seen, PointObservation):
                self.points += 1
                self.strays = 0 if self.accepted else self.strays + 1
            if self.points > TYPICAL:
                self.log_odds += likelihood
            return
        bounced = self._question.add(t_us, seen, self.noise_scales)
        self.accepted = False
        self.spoke = self._question.likelihood is not None
        if self._config.perhaps_real:
            self.log_odds += self._question.likelihood or 0.0
        self.state, self.covariance = self._question.likelier
        if bounced is not None:
            if bounced:
                self.bounces_us = (*self.bounces_us, self._question.bounced_us())
            self._question = None

    def _ask(self, t_us: int) -> BounceQuestion | None:
        """Start a bounce question if a bounce may happen before the next point."""
        if self.points < SETTLED:
            return None
        contact = coming_contact(self.state, self.covariance, self.process_noise.lift)
        if contact is None or contact.in_s - SIGMAS * contact.sigma_s > (t_us - self.t_us) * 1e-6:
            return None
        guard_s = 1e-3 * self._config.bounce_guard_ms
        return BounceQuestion(self.t_us, self.state, self.covariance, contact, self.process_noise, guard_s)
