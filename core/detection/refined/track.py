"""Track of a possible ball: position, motion, evidence, and the limits that it must keep."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.reasons import Limit, Reason, failed_limits
from core.detection.refined.ball_fit import Quality
from core.detection.refined.patch import MovingCircle
from core.detection.refined_config import RefinedConfig
from core.events import SensorSize

USUAL: Final = RefinedConfig()
REMEMBERED: Final = 0.92
"""Share of the evidence kept at the next fit, so that mediocre fits never confirm a ball."""
FRESH: Final = 0.25
"""Weight of the newest fit in the running means."""
FAST_PER_MS: Final = 0.12
"""Fast: this many of its own radii per ms, 2.4 m/s for a ball."""
DOUBTFUL_PX: Final = 0.3
"""Residual from which something slow is doubted: balls have 0.15 to 0.25 px, parts of players that were followed for a
while had 0.32 to 0.43."""
SHARPEST_CURVE_PX: Final = 60.0
"""Smallest radius of a curve that a ball is followed on. Chosen by hand; not measured."""
FALL_PX_PER_MS2: Final = 0.006
"""Gravity in the picture of a near camera, px/ms^2."""
MIN_BEND_MS: Final = 2.0
BEND_PX: Final = 3.5
"""Accelerations are averaged over the time in which the ball moves this far, with a minimum time."""
PACE_US: Final = (8000, 10_000)
"""Least and greatest age of the place from which a candidate's pace is measured as well: its first places are rough,
and a ball that comes at the camera moves less than their error for a long time."""
IN_VIEW: Final = 0.8
"""Radii of a new ball that its centre must be within the picture: half a disc at the border may be anything."""
KNOWN_RADIUS: Final = 0.75
"""Times the smallest radius that a confirmed ball may have: it goes away, and is still that ball. The largest holds for
all: with a quarter more, a planet without a rim was lost in a circle about its glow."""
STEADY_FITS: Final = 4
"""Number of fits whose radii are compared."""
OTHER_POLARITY: Final = -0.3
"""Smallest product of two contrasts' signs of a confirmed ball: its shadow has the other sign."""
OTHER_KIND: Final = 4
"""Times as many fits are needed of a ball that is dark after a bright one, or bright after a dark one."""
OTHER_KIND_PACE: Final = 2.5
"""Times the pace it needs then: a ball before a bright wall is as fast as it was, hair and dark sleeves are slow."""
DARK_DOUBT: Final = 3.0
"""Times the evidence is needed of something dark, since a ball's shadow is dark."""
FAST_DOUBT: Final = 0.5
"""Times the evidence is needed of something bright and fast."""


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
    sensor: SensorSize | None = None
    """Where the picture ends; None for a picture without end."""
    places: tuple[tuple[int, float, float], ...] = ()
    """Time [us] and centre u, v [px] of the last fits before it is confirmed, oldest first."""
    config: RefinedConfig = USUAL

    def __post_init__(self) -> None:
        self.initial, self.initial_us = self.ball, self.end_us
        self.places = ((self.end_us, self.ball.u, self.ball.v),)
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
        """Update the track with a new fit.

        Args:
            end_us: end of the window.
            ball: the circle then.
            covariance: (6, 6) of its unknowns, as `circle_fit.UNKNOWNS`.
            quality: of the fit.
        """
        self.bend = self._bend_with(ball, 1e-3 * (end_us - self.end_us))
        self.end_us, self.ball, self.covariance, self.quality = end_us, ball, covariance, quality
        self.fits += 1
        fresh = evidence_of(quality) if self.config.edge == "sharp" else soft_evidence(quality, self.config)
        self.evidence = REMEMBERED * self.evidence + fresh
        gain = max(FRESH, 1.0 / self.fits)  # a plain mean at first: the first fit is the roughest
        self.brighter += gain * (quality.brighter - self.brighter)
        self.contrast += gain * (quality.contrast - self.contrast)
        self.coverage += gain * (quality.coverage - self.coverage)
        self.radii_px = (*self.radii_px[1 - STEADY_FITS :], ball.r)
        if not self.confirmed:
            since_us = end_us - PACE_US[1]
            self.places = (*(one for one in self.places if one[0] >= since_us), (end_us, ball.u, ball.v))

    @property
    def polarity(self) -> int:
        """1 for a ball brighter than its ground nearly all round, -1 for a darker one, 0 if neither is certain."""
        certain = self.confirmed and abs(self.brighter) >= self.config.all_round_min
        return 0 if not certain else 1 if self.brighter > 0.0 else -1

    @property
    def is_slow(self) -> bool:
        """Whether it is slow for a ball of its size, as the heads and hands of players are."""
        return math.hypot(self.ball.vu, self.ball.vv) < FAST_PER_MS * self.ball.r

    @property
    def is_doubtful(self) -> bool:
        """Whether it may be a player's head or hand: slow, and less round than balls are. Without a rim none is."""
        return self.is_slow and self.config.edge == "sharp" and self.quality.residual_px > DOUBTFUL_PX

    @property
    def is_terminated(self) -> bool:
        """Whether the evidence against it is too strong."""
        return self.evidence <= (self.config.confirmed_given_up if self.confirmed else self.config.given_up)

    def given_up(self) -> tuple[Reason, ...]:
        """Why it is given up; empty if it is not."""
        if not self.is_terminated:
            return ()
        name = "confirmed_given_up" if self.confirmed else "given_up"
        limit: float = getattr(self.config, name)
        return (Limit("evidence", f"refined.{name}", limit, math.inf).failed_by(self.evidence),)

    def fits_in(self, ball: MovingCircle, quality: Quality) -> bool:
        """Whether a fit is of the same ball: similar size, brightness and contrast."""
        return all(limit.holds(value) for value, limit in self._same_ball(ball, quality))

    def differs_in(self, ball: MovingCircle, quality: Quality) -> tuple[Reason, ...]:
        """Why a fit is not of the same ball."""
        return failed_limits(*zip(*self._same_ball(ball, quality), strict=True))

    def _same_ball(self, ball: MovingCircle, quality: Quality) -> tuple[tuple[float, Limit], ...]:
        most_px, least = self.config.same_radius * self.ball.r, self.config.same_contrast * self.contrast
        radius, contrast = "refined.same_radius", "refined.same_contrast"
        return (
            (abs(ball.r - self.ball.r), Limit("change of the ball's radius", radius, -math.inf, most_px, "px")),
            (quality.brighter * self.brighter, Limit("same polarity as before", None, OTHER_POLARITY, math.inf)),
            (quality.contrast, Limit("events per edge pixel", contrast, least, math.inf)),
        )

    def is_confirmed_by(self, config: RefinedConfig, brighter: float) -> bool:
        """Whether it has earned the name of a ball, see `missing`."""
        return all(limit.holds(value) for value, limit in self._requirements(config, brighter))

    def missing(self, config: RefinedConfig, brighter: float) -> tuple[Reason, ...]:
        """What it lacks to be a ball, where the last one was brighter (> 0) or darker than its ground.

        Something dark needs three times the evidence, since a ball's shadow is dark; something bright and fast half of
        it, since people are not; of another kind than the last, more fits and a faster pace.
        """
        return failed_limits(*zip(*self._requirements(config, brighter), strict=True))

    def _steady_speed(self, moved_px: float) -> float:
        """Speed since the first fit, or of something bright over the last milliseconds if that is more, px/ms."""
        speed = moved_px / max(1e-3 * (self.end_us - self.initial_us), 1.0)
        then_us, u, v = self.places[0]
        if self.end_us - then_us < PACE_US[0] or self.brighter <= 0.0:  # dark hair is as fast for so short a time
            return speed
        return max(speed, math.hypot(self.ball.u - u, self.ball.v - v) / (1e-3 * (self.end_us - then_us)))

    def _border_px(self) -> float:
        """Distance of the centre from the nearest border of the picture, px."""
        if self.sensor is None:
            return math.inf
        u, v = self.ball.u, self.ball.v
        return min(u, v, self.sensor.width_px - 1.0 - u, self.sensor.height_px - 1.0 - v)

    def _requirements(self, config: RefinedConfig, brighter: float) -> tuple[tuple[float, Limit], ...]:
        """What makes a track a ball: each value with its limit."""
        ball, inf = self.ball, math.inf
        moved_px = math.hypot(ball.u - self.initial.u, ball.v - self.initial.v)
        pace_per_ms = min(self._steady_speed(moved_px), math.hypot(ball.vu, ball.vv)) / ball.r  # first fits are rough
        doubt = DARK_DOUBT if self.brighter <= 0.0 else FAST_DOUBT if pace_per_ms > FAST_PER_MS else 1.0
        other_kind = self.brighter * brighter < 0.0
        fits = config.confirm_fits * (OTHER_KIND if other_kind else 1)
        pace = config.pace_min_per_ms * (OTHER_KIND_PACE if other_kind else 1.0)
        evidence, steady_px = config.evidence_min * doubt, config.steady_radius * ball.r
        spread_px = max(self.radii_px) - min(self.radii_px) if self.radii_px else 0.0
        return (
            (self.fits, Limit("consistent fits", "refined.confirm_fits", fits, inf)),
            (self.evidence, Limit("evidence", "refined.evidence_min", evidence, inf)),
            (self.coverage, Limit("coverage of the weaker edge", "refined.both_edges_min", config.both_edges_min, inf)),
            (abs(self.brighter), Limit("one polarity all round", "refined.all_round_min", config.all_round_min, inf)),
            (moved_px, Limit("motion so far", "refined.confirm_motion_px", config.confirm_motion_px, inf, "px")),
            (pace_per_ms, Limit("pace", "refined.pace_min_per_ms", pace, inf, "radii/ms")),
            (spread_px, Limit("spread of the radii", "refined.steady_radius", -inf, steady_px, "px")),
            (self._border_px(), Limit("distance of the centre from the border", None, IN_VIEW * ball.r, inf, "px")),
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


def soft_evidence(quality: Quality, config: RefinedConfig) -> float:
    """Evidence of a fit for a ball without a sharp rim: its flaws as shares of their limits, its coverage against them.

    How soft a ball is differs from one to the next, so that here the settings say what is much.
    """
    flaws = (
        quality.residual_px / config.residual_px
        + quality.stray / max(config.stray_max, 0.01)
        + quality.inside / max(config.inside_max, 0.01)
        + 0.4 * (1.0 - abs(quality.brighter))
    )
    return min(max(1.2 - flaws + quality.coverage, -1.0), 1.0)


def fit_limits(config: RefinedConfig, *, confirmed: bool = False) -> tuple[Limit, ...]:
    """The limits of a single fit, for the values of `fit_values`.

    A confirmed ball may be somewhat smaller than a new one.
    """
    inf, one = math.inf, config
    low = KNOWN_RADIUS if confirmed else 1.0
    return (
        Limit("edge latency", "refined.stretch_min_ms", one.stretch_min_ms, inf, "ms"),
        Limit("edge latency", "refined.stretch_max_ms", -inf, one.stretch_max_ms, "ms"),
        Limit("radius", "refined.radius_min_px", low * one.radius_min_px, inf, "px"),
        Limit("radius", "refined.radius_max_px", -inf, one.radius_max_px, "px"),
        Limit("speed", "refined.speed_min_px_per_ms", one.speed_min_px_per_ms, inf, "px/ms"),
        Limit("speed", "refined.speed_max_px_per_ms", -inf, one.speed_max_px_per_ms, "px/ms"),
        Limit("residual", "refined.residual_px", -inf, one.residual_px, "px"),
        Limit("edge points", "refined.points_min", one.points_min, inf),
        Limit("coverage", "refined.coverage_min", one.coverage_min, inf),
        Limit("coverage of one edge", "refined.edge_coverage_min", one.edge_coverage_min, inf),
        Limit("events inside", "refined.inside_max", -inf, one.inside_max),
        Limit("fill", "refined.fill_min", one.fill_min, inf),
        Limit("outliers", "refined.stray_max", -inf, one.stray_max),
        Limit("fresh edge points", "refined.fresh_min", one.fresh_min, inf),
    )


def fit_values(ball: MovingCircle, quality: Quality) -> tuple[float, ...]:
    """What is compared with `fit_limits`, in its order."""
    lead, trail = quality.coverage_lead, quality.coverage_trail
    speed = math.hypot(ball.vu, ball.vv)
    return (
        ball.stretch, ball.stretch, ball.r, ball.r, speed, speed, quality.residual_px, quality.points,
        0.5 * (lead + trail), min(lead, trail), quality.inside, quality.fill, quality.stray, quality.fresh,
    )  # fmt: skip


def is_within(values: tuple[float, ...], limits: tuple[Limit, ...]) -> bool:
    """Whether every value keeps its limit."""
    return all(limit[2] <= value <= limit[3] for value, limit in zip(values, limits, strict=True))


def passes(ball: MovingCircle, quality: Quality, config: RefinedConfig) -> bool:
    """Whether a single fit passes the limits of a ball."""
    return is_within(fit_values(ball, quality), fit_limits(config))
