"""EBPP as a detector: events update a surface, EROS, and each window is searched for a circle.

EROS, the exponential reduced ordinal surface, is an 8-bit picture of the edges that does not depend on their speed.
An event sets its pixel to 255 and lets the brighter pixels around it decay, so an edge that moves on wipes out where
it was, and one that stands still stays (Glover et al. 2021; the rule is that of robotology/event-driven).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.ebpp_config import EbppConfig
from core.detection.ebpp_region import FollowedCircle, follow, region_of
from core.detection.ebpp_votes import VotedCircles, voted_circles
from core.detection.method_trace import (
    RAW,
    RESULT,
    CandidateRow,
    MethodTrace,
    Outline,
    PixelLayer,
    StageCount,
    View,
    circle_points,
    region_shapes,
)
from core.detection.reasons import Reason
from core.detection.stages.roi import Roi
from core.events import SensorSize, Window
from core.jit import njit

LONG_AGO_US: Final = -(1 << 60)
VIEWS: Final = (RAW, "surface", "circles", RESULT)
"""The stages, as on their buttons."""
WEAK: Final = 0.5
"""Share of the votes needed from which a circle is listed in a trace: with few votes there are very many."""
RIM_PX: Final = 3.0
"""Events within this distance of a circle are of its rim: the edges of the surface are broad."""
LISTED: Final = 40
"""Most circles in a trace."""


class ErosRule(NamedTuple):
    """How an event changes the surface."""

    kernel_px: int
    decayed: NDArray[np.uint8]
    """(256,) decayed value of each value."""
    support_us: int
    """Largest age of a neighbour's event for an event to count, us; 0 counts all."""


class ErosSurface(NamedTuple):
    """The surface and what the filter before it remembers, both with a margin that makes bounds checks superfluous."""

    values: NDArray[np.uint8]
    """(height + 2 m, width + 2 m), m = half the kernel; the margin stays 0."""
    last_us: NDArray[np.int64]
    """(height + 2, width + 2) last event of each pixel; one value if the filter is off."""


def eros_rule(kernel_px: int, decay: float, support_us: int) -> ErosRule:
    """The rule with a decay of `decay ** (1 / kernel_px)` for each event, cut off to whole numbers."""
    decayed = (np.arange(256) * decay ** (1.0 / kernel_px)).astype(np.uint8)
    return ErosRule(kernel_px, decayed, support_us)


def blank_surface(sensor: SensorSize, rule: ErosRule) -> ErosSurface:
    """Surface without any events."""
    margin = rule.kernel_px - 1
    remembered = (sensor.height_px + 2, sensor.width_px + 2) if rule.support_us else (1, 1)
    return ErosSurface(
        np.zeros((sensor.height_px + margin, sensor.width_px + margin), np.uint8),
        np.full(remembered, LONG_AGO_US, np.int64),
    )


def picture_of(surface: ErosSurface, rule: ErosRule) -> NDArray[np.uint8]:
    """(height, width) the surface without its margin, not copied."""
    half = rule.kernel_px // 2
    height, width = surface.values.shape
    return surface.values[half : height - half, half : width - half]


@njit
def update_surface(t_us, x_px, y_px, surface: ErosSurface, rule: ErosRule) -> None:
    """Update the surface with events of both polarities, in order of time."""
    values, side, half = surface.values, rule.kernel_px, rule.kernel_px // 2
    for i in range(len(t_us)):
        x, y = np.int64(x_px[i]), np.int64(y_px[i])
        if rule.support_us and not _has_support(surface.last_us, x, y, t_us[i], rule.support_us):
            continue
        before = values[y + half, x + half]
        for row in range(y, y + side):
            line = values[row, x : x + side]
            for k in range(side):
                if line[k] > before:
                    line[k] = rule.decayed[line[k]]
        values[y + half, x + half] = 255


@njit
def _has_support(last_us, x, y, t_us, support_us):
    """Whether one of the eight neighbours had a recent event; stores this event's time."""
    since = t_us - support_us
    last_us[y + 1, x + 1] = LONG_AGO_US
    found = False
    for row in range(y, y + 3):
        for column in range(x, x + 3):
            found |= last_us[row, column] >= since
    last_us[y + 1, x + 1] = t_us
    return found


@njit
def rim_events(x_px, y_px, circles):
    """(N,) events within `RIM_PX` of each circle (u_px, v_px, r_px, ...), per pixel of its circumference."""
    found = np.zeros(len(circles))
    for number in range(len(circles)):
        u, v, r = circles[number, 0], circles[number, 1], circles[number, 2]
        near = 0
        for i in range(len(x_px)):
            near += abs(math.hypot(x_px[i] - u, y_px[i] - v) - r) <= RIM_PX
        found[number] = near / max(2.0 * math.pi * r, 1.0)
    return found


Circles = NDArray[np.float64]
"""(N, 3) u_px, v_px, r_px, the one with the most votes first."""


def find_circles(picture: NDArray[np.uint8], roi: Roi | None, config: EbppConfig) -> Circles:
    """The circles of a surface (height, width), in the region or, without one, anywhere."""
    return _circles_of(_searched(picture, roi, config), config, votes_needed(roi, config))


class SearchedPicture(NamedTuple):
    """The part of a surface that is searched."""

    blurred: NDArray[np.uint8] | None
    """(height, width); None if the part is too small for a circle."""
    origin_px: NDArray[np.float64]
    """(2,) its first pixel."""


def _circles_of(searched: SearchedPicture, config: EbppConfig, votes: float) -> Circles:
    """The circles with so many votes for the centre and for the radius."""
    if searched.blurred is None:
        return np.empty((0, 3))
    found = cv2.HoughCircles(
        searched.blurred,
        cv2.HOUGH_GRADIENT,
        dp=config.cell_px,
        minDist=2 * config.radius_min_px,
        param1=config.canny_high,
        param2=votes,
        minRadius=config.radius_min_px,
        maxRadius=config.radius_max_px,
    )
    if found is None:
        return np.empty((0, 3))
    return found[0, :, :3].astype(np.float64) + np.array([*searched.origin_px, 0.0])


def votes_needed(roi: Roi | None, config: EbppConfig) -> float:
    """Fewest votes of a circle in a region, or without one anywhere."""
    return config.votes_full if roi is None else config.votes_roi


def _searched(picture: NDArray[np.uint8], roi: Roi | None, config: EbppConfig) -> SearchedPicture:
    """The blurred part of a surface in the region, or all of it without one."""
    u0 = v0 = 0
    if roi is not None:
        u0, v0 = max(0, roi.x_min), max(0, roi.y_min)
        picture = picture[v0 : max(v0, roi.y_max + 1), u0 : max(u0, roi.x_max + 1)]
    if min(picture.shape) <= config.radius_min_px:
        return SearchedPicture(None, np.array([u0, v0], np.float64))
    # The blurred copy is contiguous, which the surface and a part of it are not.
    blurred = cv2.GaussianBlur(picture, (config.blur_px, config.blur_px), 0)
    return SearchedPicture(blurred.astype(np.uint8, copy=False), np.array([u0, v0], np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class EbppTrace:
    """All stages of one window."""

    surface: NDArray[np.uint8]
    """(height, width) of the sensor, after this window's events."""
    roi: Roi | None
    """Where circles are searched; None: everywhere."""
    circles: NDArray[np.float64]
    """(N, 4) u_px, v_px, r_px and votes, the most votes first: those with enough, then those with too few."""
    rim_events: NDArray[np.float64]
    """(N,) see `rim_events`."""
    votes_needed: float
    detection: Detection | None
    extra_circles: int
    seconds: float


class EbppDetector:
    """Answers with the circle of the most votes, near the last one as long as it is not missed for a while.

    An estimate is valid at the end of its window less `delay_us`: the surface shows where the edges are, however long
    ago they began to move. A circle without new events on its rim is no ball, whatever the surface still shows.
    """

    def __init__(self, config: EbppConfig, sensor: SensorSize) -> None:
        self.config = config
        self.sensor = sensor
        self._rule = eros_rule(config.kernel_px, config.decay, config.support_us)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen before."""
        self._surface = blank_surface(self.sensor, self._rule)
        self._last: FollowedCircle | None = None
        self._roi: Roi | None = None
        self._events = 0
        self._searched: SearchedPicture | None = None
        self._stale: float | None = None
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball at the end of this window less the sensor's delay, or None. The window may be empty."""
        events = window.events
        if events.sensor != self.sensor:
            self.sensor = events.sensor
            self.reset()
        self.extra_circles = 0
        detection, circle, self._stale, self._searched = None, None, None, None
        self._events, self._roi = len(events), region_of(self._last, window.end_us, self.config)
        if len(events):
            update_surface(events.t_us, events.x_px, events.y_px, self._surface, self._rule)
            self._searched = _searched(picture_of(self._surface, self._rule), self._roi, self.config)
            circles = _circles_of(self._searched, self.config, votes_needed(self._roi, self.config))
            rims = rim_events(events.x_px, events.y_px, circles)
            fresh = circles[rims >= self.config.fresh_min]
            if len(fresh):
                u, v, r = circle = tuple(fresh[0].tolist())
                detection = Detection(window.end_us - self.config.delay_us, u, v, r)
                self.extra_circles = len(fresh) - 1
            elif len(circles):
                self._stale = float(rims[0])
        self._last = follow(self._last, circle, window.end_us, self.config)
        return detection

    def why_not(self) -> tuple[Reason, ...]:
        """Why the last window had no ball: too few votes of the best circle, or no new events on it."""
        needed = votes_needed(self._roi, self.config)
        setting = "ebpp.votes_full" if self._roi is None else "ebpp.votes_roi"
        if not self._events:
            return (Reason("events in the window", "window.window_us", 0, 1),)
        if self._stale is not None:
            return (_stale_reason(self._stale, self.config),)
        weak = self._voted_circles()
        if len(weak):
            return (Reason("votes of the best circle", setting, _too_few(weak[0, 3], needed), needed),)
        sentence = f"no circle has {WEAK:.0%} of the {needed:g} votes"
        return (Reason("votes of the best circle", setting, None, needed, sentence=sentence),)

    def trace(self, window: Window) -> EbppTrace:
        """The step of this window with every intermediate result."""
        start_s = time.perf_counter()
        detection = self.step(window)
        seconds = time.perf_counter() - start_s
        surface, needed = picture_of(self._surface, self._rule).copy(), votes_needed(self._roi, self.config)
        circles, events = np.empty((0, 4)), window.events
        if self._events:
            answers, weak = find_circles(surface, self._roi, self.config), self._voted_circles()
            apart = np.hypot(*(weak[:, None, :2] - answers[None, :, :2]).T)
            votes = [max(needed, *weak[apart[row] <= self.config.radius_min_px, 3], 0.0) for row in range(len(answers))]
            weak = weak[apart.min(axis=0, initial=np.inf) > self.config.radius_min_px]
            weak[:, 3] = [_too_few(votes, needed) for votes in weak[:, 3]]
            circles = np.concatenate([np.column_stack([answers, votes]).reshape(-1, 4), weak])
        rims = rim_events(events.x_px, events.y_px, circles)
        return EbppTrace(surface, self._roi, circles, rims, needed, detection, self.extra_circles, seconds)

    def explain(self, window: Window) -> MethodTrace:
        """The step of this window as Tune and `detect --explain` show it."""
        return _view_of(self.trace(window), window, self.config, self.why_not())

    def _voted_circles(self) -> VotedCircles:
        """The circles of the last window with half of the votes needed or more."""
        searched = self._searched
        if searched is None or searched.blurred is None:
            return np.empty((0, 4))
        needed = votes_needed(self._roi, self.config)
        return voted_circles(searched.blurred, self.config, WEAK * needed) + np.array([*searched.origin_px, 0.0, 0.0])


def _too_few(votes: float, needed: float) -> float:
    """Votes of a circle that is no answer: OpenCV wants more than those needed, so that as many are one too few."""
    return min(float(votes), math.ceil(needed) - 1.0)


def _stale_reason(value: float, config: EbppConfig) -> Reason:
    return Reason("new events on the rim", "ebpp.fresh_min", value, config.fresh_min, "per px")


def _circle_reasons(
    votes: float, setting: str, votes_needed: float, rim: float, config: EbppConfig
) -> tuple[Reason, ...]:
    few = () if votes >= votes_needed else (Reason("votes", setting, votes, votes_needed),)
    return few if rim >= config.fresh_min else (*few, _stale_reason(rim, config))


def _view_of(trace: EbppTrace, window: Window, config: EbppConfig, reasons: tuple[Reason, ...]) -> MethodTrace:
    rows, columns = np.nonzero(trace.surface)
    shades = (trace.surface[rows, columns] >> 6).astype(np.int16)  # four groups, from faded to fresh
    surface = PixelLayer(columns, rows, shades)
    regions = region_shapes(trace.roi)
    setting = "ebpp.votes_full" if trace.roi is None else "ebpp.votes_roi"
    listed = trace.circles[:LISTED].tolist()
    why = [
        _circle_reasons(circle[3], setting, trace.votes_needed, rim, config)
        for circle, rim in zip(listed, trace.rim_events.tolist(), strict=False)
    ]
    best = next((number for number, failed in enumerate(why) if not failed), None)
    circles = tuple(
        Outline("rejected" if failed else "accepted", circle_points(u, v), r, f"{votes:.0f} votes", (u + r + 2, v - r))
        for (u, v, r, votes), failed in zip(listed, why, strict=True)
    )
    turn = np.linspace(0, 2 * np.pi, 24)
    candidates = tuple(
        CandidateRow(
            label=number,
            figures=(f"{u:.1f}, {v:.1f}", f"{r:.1f}", f"{votes:.0f}", f"{rim:.2f}"),
            reasons=failed,
            verdict="ball" if number == best else "another circle",
            order=votes,
            x_px=u + r * np.cos(turn),
            y_px=v + r * np.sin(turn),
        )
        for number, ((u, v, r, votes), failed, rim) in enumerate(
            zip(listed, why, trace.rim_events[:LISTED].tolist(), strict=True)
        )
    )
    count = len(window.events)
    return MethodTrace(
        views=(
            View(RAW, "window", None, shows_ball=False),
            View("surface", "ebpp", surface, regions, shows_ball=False),
            View("circles", "ebpp", surface, (*regions, *circles), shows_ball=False),
            View(RESULT, "ebpp", None, regions),
        ),
        counts={
            "window": StageCount(count, count),
            "ebpp": StageCount(count, sum(not failed for failed in why), unit="possible balls", seconds=trace.seconds),
        },
        noun="circle",
        titles=("centre [px]", "radius [px]", "votes", "new events per px of rim"),
        candidates=candidates,
        detection=trace.detection,
        reasons=() if trace.detection is not None else reasons,
        where="searched in the ROI" if trace.roi else "searched on the whole sensor",
    )
