"""The paper's predictor, fed point by point: five observations, a gravity fit, before the bounce and anew after it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.trajectory.config import PaperPredictorConfig
from core.trajectory.prediction import Prediction, Stage, predict_flight

CONFIRM = 2
"""Consecutive rising points that confirm a bounce: one may be an outlier."""


class BounceFinder:
    """Watches the height fall to a lowest point near the table and rise again."""

    def __init__(self, config: PaperPredictorConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget every point seen so far."""
        self._high_m = -math.inf
        self._low_m = math.inf
        self._low_t_us = 0
        self._fallen = False
        self._risen = 0

    def add(self, t_us: int, z_m: float) -> int | None:
        """The time of the lowest point once the ball has bounced there, else None. Finds one bounce after the other."""
        rise = self._config.bounce_rise_m
        if z_m <= self._low_m:
            self._low_m, self._low_t_us = z_m, t_us
        if not self._fallen:
            self._high_m = max(self._high_m, z_m)
            if z_m < self._high_m - rise:
                self._fallen, self._low_m, self._low_t_us = True, z_m, t_us
            return None
        self._risen = self._risen + 1 if z_m > self._low_m + rise else 0
        if self._risen < CONFIRM:
            return None
        bounced_us = self._low_t_us if self._low_m < self._config.bounce_height_m else None
        self.reset()
        self._high_m = self._low_m = z_m
        self._low_t_us = t_us
        return bounced_us


Array = NDArray[np.float64]
FEWEST = 3
"""Fewest observations when time is short."""
EARLY = 0.02
"""An observation may come this share of the spacing early: time stamps jitter."""


class PaperPredictor:
    """Predicts with the newest five observations of the present stage, and again at every further one.

    The paper predicts from five; that later ones replace the oldest is a choice, the newest being nearest to what is
    predicted.
    """

    def __init__(self, config: PaperPredictorConfig | None = None) -> None:
        self.config = config or PaperPredictorConfig()
        self._bounce = BounceFinder(self.config)
        self.reset()

    def forget_flight(self) -> None:
        """Expect a new ball; nothing is learned from flight to flight."""
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._bounce.reset()
        self._recent: list[tuple[int, Array]] = []
        self._observations: list[tuple[int, Array]] = []
        self.bounces_us: tuple[int, ...] = ()
        self.latest: Prediction | None = None
        self._expected_us = 1 << 62

    @property
    def stage(self) -> Stage:
        """Before or after the first observed bounce."""
        return "post" if self.bounces_us else "pre"

    def add(self, t_us: int, p_world_m: ArrayLike, covariance_m2: Array | None = None) -> Prediction | None:
        """A new prediction if this point completes one, else None. Points come in order of time.

        All points count alike: their covariance is not used.

        Raises:
            ConfigError: if a point is not later than the one before, or not three finite numbers.
        """
        p = np.asarray(p_world_m, np.float64)
        if p.shape != (3,) or not np.isfinite(p).all():
            raise ConfigError("not a position", expected="3 finite numbers", got=p, where="PaperPredictor.add")
        if self._recent and t_us <= self._recent[-1][0]:
            expected = f"after {self._recent[-1][0]} us"
            raise ConfigError("points are not in order", expected=expected, got=t_us, where="PaperPredictor.add")
        self._recent.append((t_us, p))
        bounced_us = self._bounce.add(t_us, float(p[2]))
        if bounced_us is None:
            return self._observe(t_us, p, t_us)
        self.bounces_us = (*self.bounces_us, bounced_us)
        self._observations = []
        first_us = bounced_us + 1000 * self.config.bounce_guard_ms
        self._recent = [point for point in self._recent if point[0] >= first_us]
        prediction = None
        for seen_us, seen in self._recent:
            prediction = self._observe(seen_us, seen, t_us) or prediction
        # Kept for the check that points come in order.
        if not self._recent:
            self._recent = [(t_us, p)]
        return prediction

    def _observe(self, t_us: int, p: Array, now_us: int) -> Prediction | None:
        spacing_us = 1000 * self.config.spacing_ms * (1 - EARLY)
        if self._observations and t_us - self._observations[-1][0] < spacing_us:
            return None
        if self.stage == "pre" and 0 <= t_us - self._expected_us < 1000 * self.config.bounce_wait_ms:
            return None
        self._observations = [*self._observations, (t_us, p)][-self.config.observations :]
        # Needed back to a bounce only, which is noticed within a few points.
        self._recent = [point for point in self._recent if point[0] > t_us - 200_000]
        missing = self.config.observations - len(self._observations)
        if missing > 0 and (self.stage == "pre" or len(self._observations) < FEWEST):
            return None
        times = np.array([seen[0] for seen in self._observations]) * 1e-6
        ps = np.array([seen[1] for seen in self._observations])
        found = predict_flight(times, ps, now_us, self.stage, self.config)
        if found is not None and missing > 0 and not self._in_a_hurry(found, missing):
            return None
        self.latest = found or self.latest
        if found is not None and found.bounces:
            self._expected_us = round(1e6 * found.bounces[0].t_s)
        return found

    def _in_a_hurry(self, found: Prediction, missing: int) -> bool:
        """Whether the ball reaches the hitting plane too soon to wait for the missing observations."""
        wait_s = 1e-3 * (missing * self.config.spacing_ms + self.config.hurry_ms)
        soon = found.hit_plane is not None and found.hit_plane.t_s < found.t_us * 1e-6 + wait_s
        return soon and self.config.hurry_ms > 0
