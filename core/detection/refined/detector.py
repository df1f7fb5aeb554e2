"""The refined detector: searches, tracks candidates, and answers once a track is confirmed as a ball."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.method_trace import MethodTrace
from core.detection.reasons import Reason
from core.detection.refined.attempts import BLOB_SIDE, START_RADIUS, Attempt, Origin, blob_reasons, reasons_without_ball
from core.detection.refined.ball_fit import Quality, Reach, blank_work, fit_ball, start_from_place
from core.detection.refined.circle_fit import UNKNOWNS
from core.detection.refined.history import EventHistory
from core.detection.refined.patch import MovingCircle
from core.detection.refined.refined_trace import RefinedTrace, TraceRecorder
from core.detection.refined.search import (
    LONG_AGO_US,
    SPANS_US,
    BlobLimits,
    blank_blobs,
    blank_maps,
    find_blobs,
    take_events,
)
from core.detection.refined.soft_fit import fit_soft
from core.detection.refined.track import BallTrack, fit_limits, fit_values, is_within
from core.detection.refined.view import view_of
from core.detection.refined_config import RefinedConfig
from core.events import SensorSize, Window

USUAL_RESIDUAL_PX: Final = 0.15
"""Residual at which the covariance is `USUAL` times the fit's own; it grows with the third power of the residual."""
USUAL: Final = 0.5
"""Share of the fit's own variance that is usual: points are better than their spread says, but err alike."""
SHADE: Final = (0.004, 0.01)
"""Systematic error across and down the picture, in radii: light from above leaves the lower rim pale."""


SOFT_USUAL: Final = 7.0
"""Variance of a soft ball's centre over the fit's own, in which successive windows share most of their events: the mean
over the planet of `bench planet`, 6.6 to 6.9 in its two parts."""


def observed_covariance(fitted: NDArray[np.float64], ball: MovingCircle, quality: Quality) -> NDArray[np.float64]:
    """(5, 5) of place [px], velocity [px/ms] and radius [px] from what the fit says if every point erred by itself.

    The errors grow with the residual, faster than it. Measured on 43 recordings of drawn scenes, half with drawn
    sensors, each sensor's delay known: the squared error of the centre over this has a mean of 1.1, from 0.5 for the
    cleanest quarter of the fits to 1.9 for the worst, and of 0.6 along the motion and 1.5 across it.
    """
    covariance = USUAL * (quality.residual_px / USUAL_RESIDUAL_PX) ** 3 * fitted[:5, :5]
    for axis, share in enumerate(SHADE):
        covariance[axis, axis] += (share * ball.r) ** 2
    return covariance


SEARCH_EVERY: Final = (1, 2, 4)
"""Windows between two evaluations of each time span of the search."""
CATCH_UP_US: Final = 6000
"""Length of the newest events that the search reads when a ball is lost; while one is tracked it reads none."""
FIRST_STRETCH_MS: Final = (0.6, 0.4)
"""Prior edge latency of an unknown sensor, and its standard deviation."""
STRETCH_SPREAD_MS: Final = 0.1
"""Standard deviation of the edge latency from fit to fit, and of a new ball with a known sensor."""
STRETCH_GAIN: Final = 0.02
"""Weight of a confirmed fit in the running mean of the sensor's edge latency."""
FULL_WEIGHT_PX_PER_MS: Final = 1.5
"""Speed from which a fit has full weight there."""
BAND_PX: Final = 2.5
"""Width of the band around the predicted rim that holds a track's edge points."""
UNCONFIRMED_LOOSE: Final = 2.5
"""Factor on the prior's spread of an unconfirmed track: its first fit may have been of half a ball."""
UNSEEN_MS: Final = 2.5
"""A ball unseen for longer is searched again."""
BORDER_PX: Final = 0.5
"""A ball with its centre nearer to the sensor's border may have left the picture."""
BOUNCE_RESTITUTION_GUESSES: Final = (-0.85, -0.4, 0.0)
"""Factors on the image's vertical speed that are tried when a ball is not where it was expected."""
AFTER_BOUNCE: Final = (2.5, 0.4, 0.6, 0.3)
"""Standard deviations after a bounce: position [px], speed along u and along v [px/ms], radius [px]."""
BRIEF: Final = Reach(3.5, 1.2, 3.0)
"""History of a fit after a bounce."""
RIVAL_CONTRAST_RATIO: Final = 1.15
"""A rival track with this many times the edge events is the ball; the tracked one is its shadow."""


@dataclass(frozen=True, slots=True)
class RefinedDetection(Detection):
    """A ball with its velocity and covariance."""

    vu_px_per_ms: float
    vv_px_per_ms: float
    stretch_ms: float
    """Half the lag of the trailing edge behind the leading edge, ms, see `circle_fit`."""
    covariance: NDArray[np.float64] = field(compare=False)
    """(5, 5) covariance of u, v [px], velocity u, v [px/ms], radius [px], without the uncertainty of the sensor's
    delay."""
    fit: Quality

    @property
    def velocity_px_per_ms(self) -> tuple[float, float]:
        """Velocity along u and v, px/ms."""
        return self.vu_px_per_ms, self.vv_px_per_ms

    @property
    def centre_covariance_px2(self) -> NDArray[np.float64]:
        """(2, 2) covariance of the centre, px^2."""
        return self.covariance[:2, :2]


class RefinedDetector:
    """Tracks at most one confirmed ball, and without one a few candidates."""

    def __init__(self, config: RefinedConfig, sensor: SensorSize) -> None:
        self.config = config
        self.sensor = sensor
        tail = config.trailing == "first"
        self._reach = Reach(config.motion_px, 1e-3 * config.history_min_us, 1e-3 * config.history_max_us, tail)
        self._brief = BRIEF._replace(tail=tail)
        self._work = blank_work()
        self._blobs = blank_blobs()
        self._limits, self._limits_of_ball = fit_limits(config), fit_limits(config, confirmed=True)
        self._recorder: TraceRecorder | None = None
        self.reset()

    def reset(self) -> None:
        """Forget everything seen before."""
        self._history = EventHistory(self.config.history_max_us + 6000)
        self._recent = self._history.recent
        self._maps = blank_maps(self.sensor)
        self._mapped_us = LONG_AGO_US
        self._floods = self._windows = 0
        self._brighter = 0.0
        self._stretch_ms, self._stretch_spread_ms = FIRST_STRETCH_MS
        self._learnt = 0.0
        self.tracks: list[BallTrack] = []
        self._refused: list[Attempt] = []
        self._refused_before: tuple[int, tuple[Attempt, ...]] = (0, ())
        self._given_up: list[BallTrack] = []
        self._blobs_found = 0
        self._end_us = 0

    @property
    def extra_circles(self) -> int:
        """Always 0: this method finds one ball only."""
        return 0

    def step(self, window: Window) -> RefinedDetection | None:
        """The ball at the end of this window less the sensor's delay, or None. The window may be empty."""
        if window.events.sensor != self.sensor:
            self.sensor = window.events.sensor
            self.reset()
        end_us = self._end_us = window.end_us
        if self._refused:
            self._refused_before = self._windows, tuple(self._refused)
            self._refused.clear()
        self._given_up.clear()
        self._windows += 1
        self._blobs_found = 0
        self._blobs.rejected[:] = 0.0
        self._history.append(window.events, end_us)
        self._recent = self._history.recent
        for track in self.tracks:
            self._follow(track, end_us)
        self._tidy(end_us)
        ball = self._confirmed()
        if ball is None or end_us - ball.end_us > 1e3 * UNSEEN_MS:
            self._search(end_us)
        elif (ball.brighter < 0.0 or ball.is_doubtful) and self._windows % SEARCH_EVERY[-1] == 0:
            self._search(end_us)  # it may be the shadow of a ball nearby, or a head while the ball is elsewhere
        ball = self._choose(end_us)
        if ball is None or ball.end_us != end_us:
            return None
        self._learn_stretch(ball.ball)
        u, v, vu, vv, r, stretch_ms, *_ = ball.ball
        if self.config.edge == "soft":
            seen = SOFT_USUAL * ball.covariance[:5, :5]
        else:
            seen = observed_covariance(ball.covariance, ball.ball, ball.quality)
        return RefinedDetection(end_us - self.config.delay_us, u, v, r, vu, vv, stretch_ms, seen, ball.quality)

    def why_not(self) -> tuple[Reason, ...]:
        """Limits that the nearest candidate of the last window failed, see `reasons_without_ball`.

        Slow things are searched in every fourth window only: without a candidate those of the last four windows count.
        """
        blobs = self._blobs_found or blob_reasons(self._blobs.rejected, self.config)
        since, refused = self._windows - SEARCH_EVERY[-1], self._refused
        if not refused and not self._blobs_found and self._refused_before[0] > since:
            refused = self._refused_before[1]
        return reasons_without_ball(
            self._end_us, self._recent, blobs, refused, self.tracks, self._given_up, self.config, self._brighter
        )

    def trace(self, window: Window) -> RefinedTrace:
        """The step of this window with every intermediate result: the same code, and the same answer."""
        self._recorder = recorder = TraceRecorder(self.config, window.end_us)
        try:
            detection = self.step(window)
        finally:
            self._recorder = None
        return recorder.finish(self._recent, (*self.tracks, *self._given_up), self._brighter, detection)

    def explain(self, window: Window) -> MethodTrace:
        """The step of this window as Tune and `detect --explain` show it."""
        return view_of(self.trace(window), window, self.why_not(), self.config.residual_px)

    def _learn_stretch(self, ball: MovingCircle) -> None:
        telling = min(1.0, (ball.vu**2 + ball.vv**2) / FULL_WEIGHT_PX_PER_MS**2)
        self._learnt += telling
        self._stretch_ms += telling * max(STRETCH_GAIN, 1.0 / (1.0 + self._learnt)) * (ball.stretch - self._stretch_ms)
        self._stretch_spread_ms = max(STRETCH_SPREAD_MS, FIRST_STRETCH_MS[1] / (1.0 + 0.1 * self._learnt))

    def _confirmed(self) -> BallTrack | None:
        return next((track for track in self.tracks if track.confirmed), None)

    def _tidy(self, end_us: int) -> None:
        """Drop tracks that are lost, rejected, or duplicates (the older one stays)."""
        kept: list[BallTrack] = []
        fast_only = self._wants_fast_rivals(end_us)
        for track in self.tracks:
            if fast_only and not track.confirmed and track.is_slow:
                continue
            patience_us = self.config.coast_us if track.confirmed else self.config.candidate_coast_us
            if track.is_terminated:
                self._given_up.append(track)
                continue
            if end_us - track.end_us > patience_us:
                continue
            if any(_apart_px(one.ball, track.ball) < 0.5 * one.ball.r for one in kept):
                continue
            kept.append(track)
        self.tracks = kept

    def _follow(self, track: BallTrack, end_us: int) -> None:
        expected = track.at(end_us)
        if not self._on_sensor(expected):
            return
        unseen_ms = 1e-3 * (end_us - track.end_us)
        loose = (1.0 if track.confirmed else UNCONFIRMED_LOOSE) + 0.3 * unseen_ms
        spreads = (loose, 0.15 * loose, 0.15 * loose, 0.5 * loose)
        if self._refit("track", track, expected, spreads, end_us, self._reach, BAND_PX + 0.3 * unseen_ms):
            return
        # A fit that failed once is no bounce.
        if not track.confirmed or unseen_ms < 1.5:
            return
        was = track.ball
        for keeps in BOUNCE_RESTITUTION_GUESSES:
            vv = keeps * was.vv
            bounced = was._replace(vv=vv, au=0.0, av=0.0).at(unseen_ms)
            if self._refit("bounce", track, bounced, AFTER_BOUNCE, end_us, self._brief, BAND_PX):
                return

    def _refit(
        self,
        origin: Origin,
        track: BallTrack,
        expected: MovingCircle,
        spreads: tuple[float, ...],
        end_us: int,
        reach: Reach,
        band_px: float,
    ) -> bool:
        fit = self._work.fit
        place, along_u, along_v, radius = (spread**-2 for spread in spreads)
        stretch = self._stretch_spread_ms**-2
        fit.estimate[:] = fit.prior[:] = expected[:UNKNOWNS]
        fit.prior[5] = self._stretch_ms
        fit.information[:] = (place, place, along_u, along_v, radius, stretch)
        fit.bend[:] = expected.au, expected.av
        # The first fit of an unconfirmed track may have been of half a ball: it gets a wider band first.
        rounds = 1 if track.confirmed else 2
        found = self._fit(origin, end_us, reach, band_px, rounds, track)
        if found is None:
            return False
        ball, quality = found
        apart_px, most_px = _apart_px(ball, expected), 3.0 * spreads[0]
        if apart_px > most_px or (track.confirmed and not track.fits_in(ball, quality)):
            self._refuse(Attempt(origin, ball, quality, track=track, apart_px=apart_px, most_px=most_px))
            return False
        track.take(end_us, ball, self._work.covariance.copy(), quality)
        return True

    def _fit(
        self, origin: Origin, end_us: int, reach: Reach, band_px: float, rounds: int, track: BallTrack | None = None
    ) -> tuple[MovingCircle, Quality] | None:
        """Fit from the start in `self._work.fit`, for a track or a new one; None if it cannot be a ball."""
        if self._recorder is not None:
            self._recorder.begin_fit(self._work.fit, reach)
        if self.config.edge == "soft":
            fitted = fit_soft(self._recent, self._work, end_us, reach, rounds)
        else:
            polarity = 0 if track is None else track.polarity
            fitted = fit_ball(self._recent, self._work, end_us, reach, band_px, rounds, polarity)
        if not fitted:
            self._refuse(Attempt(origin, points=int(self._work.counts[0])))
            return None
        ball, quality = MovingCircle(*self._work.fit.estimate.tolist()), Quality(*self._work.quality.tolist())
        if self._recorder is not None:
            self._recorder.end_fit(origin, self._work, ball, quality)
        confirmed = track is not None and track.confirmed
        limits = self._limits_of_ball if confirmed else self._limits
        if is_within(fit_values(ball, quality), limits) and self._on_sensor(ball):
            return ball, quality
        self._refuse(Attempt(origin, ball, quality, on_sensor=self._on_sensor(ball), confirmed=confirmed))
        return None

    def _refuse(self, attempt: Attempt) -> None:
        self._refused.append(attempt)
        if self._recorder is not None:
            self._recorder.refuse(attempt)

    def _search(self, end_us: int) -> None:
        """Search for new blobs, and start tracks of possible balls."""
        config = self.config
        take_events(self._recent, max(self._mapped_us, end_us - CATCH_UP_US), self._maps, config.neighbours_min)
        self._mapped_us = end_us
        found, limits = 0, BlobLimits(BLOB_SIDE * config.radius_max_px, config.blob_elongation_max)
        for span, every in enumerate(SEARCH_EVERY):
            if self._windows % every == 0:
                self._floods += 1
                found = find_blobs(self._maps, span, end_us, self._floods, limits, self._blobs, found)
        self._blobs_found = found
        if self._recorder is not None:
            evaluated = tuple(self._windows % every == 0 for every in SEARCH_EVERY)
            self._recorder.take_search(self._recent, self._maps, self._blobs, found, evaluated)
        trials = 0
        for turn in range(found):
            if len(self.tracks) >= config.tracks_max or trials >= config.trials_max:
                break
            blob = (self._windows * config.trials_max + turn) % found  # many blobs are examined in turns
            box = self._blobs.boxes[blob]
            covered = any(_covers(track, box, end_us) for track in self.tracks)
            if self._recorder is not None:
                self._recorder.take_blob(blob, "tracked" if covered else "examined")
            if not covered:
                trials += 1
                self._examine(box, int(SPANS_US[self._blobs.span[blob]]), end_us)

    def _examine(self, box: NDArray[np.float64], span_us: int, end_us: int) -> None:
        """Make a track of the blob in a box, if it can be a ball."""
        fit, config = self._work.fit, self.config
        if not start_from_place(self._recent, box, end_us, span_us, fit.estimate):
            self._refuse(Attempt("blob", few_events=True))
            return
        _, _, vu, vv, r, *_ = fit.estimate.tolist()
        low, high = START_RADIUS
        if not low * config.radius_min_px <= r <= high * config.radius_max_px or (
            math.hypot(vu, vv) > config.speed_max_px_per_ms
        ):
            self._refuse(Attempt("blob", start=MovingCircle(*fit.estimate.tolist())))
            return
        fit.estimate[5] = self._stretch_ms
        fit.prior[:] = fit.estimate
        # A prior of 100 px: nothing is known but the edge latency of the sensor. It only keeps the equations regular.
        fit.information[:5] = 1e-4
        fit.information[5] = self._stretch_spread_ms**-2
        fit.bend[:] = 0.0
        found = self._fit("blob", end_us, self._reach, 2.0, 3)
        if found is None:
            return
        ball, quality = found
        if any(track.end_us == end_us and _apart_px(track.ball, ball) < ball.r for track in self.tracks):
            return
        covariance = self._work.covariance.copy()
        track = BallTrack(end_us, ball, covariance, quality, config=config, sensor=self.sensor)
        if not (track.is_slow and self._wants_fast_rivals(end_us)):
            self.tracks.append(track)

    def _wants_fast_rivals(self, end_us: int) -> bool:
        """Whether a bright ball is followed: what is slow beside it is not fitted window by window for nothing."""
        ball = self._confirmed()
        return ball is not None and ball.end_us == end_us and ball.brighter > 0.0

    def _choose(self, end_us: int) -> BallTrack | None:
        """The confirmed track; else the best newly confirmed one, which alone continues."""
        ball = self._confirmed()
        ready = [
            track
            for track in self.tracks
            if track.end_us == end_us and not track.confirmed and track.is_confirmed_by(self.config, self._brighter)
        ]
        if ball is not None and ball.end_us == end_us:
            ready = [rival for rival in ready if _outdoes(rival, ball)]
        if not ready:
            return ball
        best = max(ready, key=lambda track: track.quality.points / track.quality.residual_px)
        best.confirmed = True
        self._brighter = best.brighter
        self.tracks = [best]
        return best

    def _on_sensor(self, ball: MovingCircle) -> bool:
        width_px, height_px = self.sensor.width_px, self.sensor.height_px
        return BORDER_PX <= ball.u <= width_px - 1 - BORDER_PX and BORDER_PX <= ball.v <= height_px - 1 - BORDER_PX


def _outdoes(rival: BallTrack, ball: BallTrack) -> bool:
    """Whether a rival is the ball and the tracked one its shadow, or something slow and less round."""
    if rival.quality.contrast > RIVAL_CONTRAST_RATIO * ball.quality.contrast:
        return True
    return ball.is_doubtful and not rival.is_slow and rival.quality.residual_px < ball.quality.residual_px


def _apart_px(one: MovingCircle, other: MovingCircle) -> float:
    return math.hypot(one.u - other.u, one.v - other.v)


def _covers(track: BallTrack, box: NDArray[np.float64], end_us: int) -> bool:
    """Whether a box (u, v, width, height) contains a track."""
    if track.end_us != end_us:
        return False
    ball, (u, v, width, height) = track.ball, box.tolist()
    return abs(ball.u - u) < ball.r + 0.5 * width and abs(ball.v - v) < ball.r + 0.5 * height


OF_STRETCH: Final = (1.09, -0.135)
"""Delay [ms] as a function of the median edge latency [ms]: a line through 43 recordings of drawn scenes with 22
sensors, whose delays are 0.08 to 0.88 ms."""
LEFT_US: Final = 75
"""Standard deviation of the delays about that line. Within a flight the stretch changes with the light on the ball, so
this is for the median of whole flights."""
FEWEST: Final = 200
"""Answers with a moving ball from which a delay is estimated. Chosen by hand; not measured."""
MIN_PX_PER_MS: Final = 1.0
"""Slowest ball that is used."""


class DelayEstimate(NamedTuple):
    """An estimate for `refined.delay_us`."""

    delay_us: int
    sigma_us: int


def estimate_delay(detections: Sequence[RefinedDetection]) -> DelayEstimate | None:
    """Delay of the sensor that detected these balls; None if too few of them moved."""
    telling = [one.stretch_ms for one in detections if math.hypot(*one.velocity_px_per_ms) >= MIN_PX_PER_MS]
    if len(telling) < FEWEST:
        return None
    slope, start = OF_STRETCH
    return DelayEstimate(round(1000 * max(0.0, slope * float(np.median(telling)) + start)), LEFT_US)
