"""Track of a possible ball: position, motion, and evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.refined.ball_fit import Quality
from core.detection.refined.patch import MovingCircle
from core.detection.refined_config import RefinedConfig

MIN_STRETCH_MS: Final = -0.2
MAX_STRETCH_MS: Final = 2.5
MIN_FRESH: Final = 0.06
REMEMBERED: Final = 0.92
"""Share of the evidence kept at the next fit, so that mediocre fits never confirm a ball."""
GIVEN_UP: Final = -3.0
CONFIRMED_GIVEN_UP: Final = -5.0
FRESH: Final = 0.25
"""Weight of the newest fit in the running means."""
FAST_PER_MS: Final = 0.12
"""Fast: this many of its own radii per ms, 2.4 m/s for a ball."""
SHARPEST_CURVE_PX: Final = 60.0
FALL_PX_PER_MS2: Final = 0.006
"""Gravity in the picture of a near camera, px/ms^2."""
MIN_BEND_MS: Final = 2.0
BEND_PX: Final = 3.5
"""Accelerations are averaged over the time in which the ball moves this far, with a minimum time."""
BOTH_EDGES: Final = 0.55
"""Smallest coverage of both edges; a moving limb often shows only one."""
ALL_ROUND: Final = 0.5
"""Smallest share of one polarity around the edge: brighter, or darker, than its background nearly all round."""
STEADY_FITS: Final = 4
STEADY_RADIUS: Final = 0.1
"""Number of fits, and the share within which their radii must lie: a ball emerging from an occlusion grows."""
SAME_RADIUS: Final = 0.2
"""Largest relative change of a confirmed ball's radius from fit to fit."""


@dataclass(slots=True)
class BallTrack:
    """A moving round object."""

    end_us: int
    """End of the window that the estimate is for."""
    ball: MovingCircle
    covariance: NDArray[np.float64]
    """(6, 6) covariance of the ball's fields as reported by the fit."""
    quality: Quality
    """Quality of the last fit."""
    initial: MovingCircle = field(init=False)
    initial_us: int = field(init=False)
    fits: int = 1
    confirmed: bool = False
    evidence: float = 0.0
    brighter: float = field(init=False)
    """Mean of `Quality.brighter`; so `contrast`, and `coverage` of the smaller one."""
    contrast: float = field(init=False)
    coverage: float = field(init=False)
    radii_px: tuple[float, ...] = ()
    bend: tuple[float, float] = (0.0, 0.0)
    """Acceleration u and v in px/ms^2, from the change of the fits' velocities."""

    def __post_init__(self) -> None:
        self.initial, self.initial_us = self.ball, self.end_us
        self.brighter, self.contrast = self.quality.brighter, self.quality.contrast
        self.coverage = self.quality.coverage

    def at(self, end_us: int) -> MovingCircle:
        """Predicted ball at another time."""
        return self.ball._replace(au=self.bend[0], av=self.bend[1]).at(1e-3 * (end_us - self.end_us))

    def _bend_with(self, ball: MovingCircle, ms: float) -> tuple[float, float]:
        """Running mean of the acceleration, from the velocities of the fits."""
        speed2 = ball.vu**2 + ball.vv**2
        most = max(FALL_PX_PER_MS2, speed2 / SHARPEST_CURVE_PX)
        gain = ms / (ms + MIN_BEND_MS + BEND_PX / max(math.sqrt(speed2), 0.1))
        changes = (ball.vu - self.ball.vu) / ms, (ball.vv - self.ball.vv) / ms
        au, av = (was + gain * (min(max(now, -most), most) - was) for was, now in zip(self.bend, changes, strict=True))
        return au, av

    def take(self, end_us: int, ball: MovingCircle, covariance: NDArray[np.float64], quality: Quality) -> None:
        """Update the track with a new fit."""
        self.bend = self._bend_with(ball, 1e-3 * (end_us - self.end_us))
        self.end_us, self.ball, self.covariance, self.quality = end_us, ball, covariance, quality
        self.fits += 1
        self.evidence = REMEMBERED * self.evidence + evidence_of(quality)
        self.brighter += FRESH * (quality.brighter - self.brighter)
        self.contrast += FRESH * (quality.contrast - self.contrast)
        self.coverage += FRESH * (quality.coverage - self.coverage)
        self.radii_px = (*self.radii_px[1 - STEADY_FITS :], ball.r)

    @property
    def is_terminated(self) -> bool:
        """Whether the evidence against it is too strong."""
        return self.evidence <= (CONFIRMED_GIVEN_UP if self.confirmed else GIVEN_UP)

    def fits_in(self, ball: MovingCircle, quality: Quality) -> bool:
        """Whether a fit is of the same ball: similar size, brightness and contrast."""
        return (
            abs(ball.r - self.ball.r) <= SAME_RADIUS * self.ball.r
            and quality.brighter * self.brighter >= -0.3
            and quality.contrast >= 0.5 * self.contrast
        )

    def is_confirmed_by(self, config: RefinedConfig, brighter: float) -> bool:
        """Whether it has earned the name of a ball, where the last one was brighter (> 0) or darker than its ground.

        Something dark needs three times the evidence, since a ball's shadow is dark; something bright and fast half of
        it, since people are not; of another kind than the last, more fits.
        """
        ball = self.ball
        moved_px = math.hypot(ball.u - self.initial.u, ball.v - self.initial.v)
        lived_ms = 1e-3 * (self.end_us - self.initial_us)
        pace_per_ms = min(moved_px / max(lived_ms, 1.0), math.hypot(ball.vu, ball.vv)) / ball.r  # first fits are rough
        doubt = 3.0 if self.brighter <= 0.0 else 0.5 if pace_per_ms > FAST_PER_MS else 1.0
        return (
            self.fits >= config.confirm_fits * (1 if self.brighter * brighter >= 0.0 else 4)
            and self.evidence >= config.evidence_min * doubt
            and self.coverage >= BOTH_EDGES
            and abs(self.brighter) >= ALL_ROUND
            and moved_px >= config.confirm_motion_px
            and pace_per_ms >= config.pace_min_per_ms
            and max(self.radii_px) - min(self.radii_px) <= STEADY_RADIUS * ball.r
        )


def evidence_of(quality: Quality) -> float:
    """Evidence of a fit for a ball: about +1 for a clean ball, below 0 for most other objects.

    Light and dark on the ball itself weigh as much as its edge where that is pale; there the inside counts less.
    """
    inside = quality.inside * min(1.0, quality.contrast / 4.0)
    mixed = 0.4 * (1.0 - abs(quality.brighter))  # a ball is brighter than its ground all round, or darker
    badness = quality.residual_px / 0.4 + quality.stray / 0.4 + inside / 0.15 + mixed
    virtue = quality.fill + quality.coverage
    return min(max(1.2 - badness + virtue, -1.0), 1.0)


def passes(ball: MovingCircle, quality: Quality, config: RefinedConfig) -> bool:
    """Whether a single fit passes the limits of a ball."""
    lead, trail = quality.coverage_lead, quality.coverage_trail
    return (
        MIN_STRETCH_MS <= ball.stretch <= MAX_STRETCH_MS
        and config.radius_min_px <= ball.r <= config.radius_max_px
        and config.speed_min_px_per_ms <= math.hypot(ball.vu, ball.vv) <= config.speed_max_px_per_ms
        and quality.residual_px <= config.residual_px
        and quality.points >= config.points_min
        and 0.5 * (lead + trail) >= config.coverage_min
        and min(lead, trail) >= 0.25
        and quality.inside <= config.inside_max
        and quality.fill >= config.fill_min
        and quality.stray <= config.stray_max
        and quality.fresh >= MIN_FRESH
    )
