"""EBPP as a detector: events update a surface, EROS, and each window is searched for a circle.

EROS, the exponential reduced ordinal surface, is an 8-bit picture of the edges that does not depend on their speed.
An event sets its pixel to 255 and lets the brighter pixels around it decay, so an edge that moves on wipes out where
it was, and one that stands still stays (Glover et al. 2021; the rule is that of robotology/event-driven).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.ebpp_config import EbppConfig
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
from core.detection.stages.roi import Centre, Roi, RoiConfig, next_region, roi_around
from core.events import SensorSize, Window
from core.jit import njit

LONG_AGO_US: Final = -(1 << 60)
VIEWS: Final = (RAW, "surface", "circles", RESULT)
"""The stages, as on their buttons."""
WEAK: Final = 0.5
"""Share of the votes needed from which a circle is listed in a trace: with few votes there are very many."""
LEVELS: Final = 6
"""Numbers of votes that are tried from there to the votes needed: OpenCV tells only whether a circle has enough."""
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


Circles = NDArray[np.float64]
"""(N, 3) u_px, v_px, r_px, the one with the most votes first."""


def find_circles(picture: NDArray[np.uint8], roi: Roi | None, config: EbppConfig) -> Circles:
    """The circles of a surface (height, width), in the region or, without one, anywhere."""
    return _vote(picture, roi, config, votes_needed(roi, config))


def votes_needed(roi: Roi | None, config: EbppConfig) -> float:
    """Fewest votes of a circle in a region, or without one anywhere."""
    return config.votes_full if roi is None else config.votes_roi


def _vote(picture: NDArray[np.uint8], roi: Roi | None, config: EbppConfig, votes: float) -> Circles:
    """The circles with so many votes for the centre and for the radius."""
    u0 = v0 = 0
    if roi is not None:
        u0, v0 = max(0, roi.x_min), max(0, roi.y_min)
        picture = picture[v0 : max(v0, roi.y_max + 1), u0 : max(u0, roi.x_max + 1)]
    if min(picture.shape) <= config.radius_min_px:
        return np.empty((0, 3))
    # The blurred copy is contiguous, which the surface and a part of it are not.
    blurred = cv2.GaussianBlur(picture, (config.blur_px, config.blur_px), 0)
    found = cv2.HoughCircles(
        blurred,
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
    return found[0, :, :3].astype(np.float64) + np.array([u0, v0, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class EbppTrace:
    """All stages of one window."""

    surface: NDArray[np.uint8]
    """(height, width) of the sensor, after this window's events."""
    roi: Roi | None
    """Where circles are searched; None: everywhere."""
    circles: NDArray[np.float64]
    """(N, 4) u_px, v_px, r_px and votes, the most votes first: the answers, then circles with too few, whose votes are
    the most that they have of a few numbers tried."""
    votes_needed: float
    detection: Detection | None
    extra_circles: int
    seconds: float


class EbppDetector:
    """Answers with the circle of the most votes, near the last one as long as it is not missed for a while.

    An estimate is valid at the end of its window less `delay_us`: the surface shows where the edges are, however long
    ago they began to move. A window without any event has no ball, whatever the surface still shows.
    """

    def __init__(self, config: EbppConfig, sensor: SensorSize) -> None:
        self.config = config
        self.sensor = sensor
        self._rule = eros_rule(config.kernel_px, config.decay, config.support_us)
        self._region = RoiConfig(roi_expand_px=config.roi_expand_px, misses_to_reset=config.misses_to_reset)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen before."""
        self._surface = blank_surface(self.sensor, self._rule)
        self._centre_px: Centre | None = None
        self._misses = 0
        self._roi: Roi | None = None
        self._events = 0
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball at the end of this window less the sensor's delay, or None. The window may be empty."""
        events = window.events
        if events.sensor != self.sensor:
            self.sensor = events.sensor
            self.reset()
        self.extra_circles = 0
        detection, found_px = None, None
        self._events, self._roi = len(events), roi_around(self._centre_px, self._region)
        if len(events):
            update_surface(events.t_us, events.x_px, events.y_px, self._surface, self._rule)
            circles = find_circles(picture_of(self._surface, self._rule), self._roi, self.config)
            if len(circles):
                u, v, r = circles[0].tolist()
                found_px = u, v
                detection = Detection(window.end_us - self.config.delay_us, u, v, r)
                self.extra_circles = len(circles) - 1
        self._centre_px, self._misses = next_region(self._centre_px, self._misses, found_px, self._region)
        return detection

    def why_not(self) -> tuple[Reason, ...]:
        """Why the last window had no ball: too few votes of the best circle."""
        needed = votes_needed(self._roi, self.config)
        setting = "ebpp.votes_full" if self._roi is None else "ebpp.votes_roi"
        if not self._events:
            return (Reason("events in the window", "window.window_us", 0, 1),)
        weak = next((found for found in self._weaker() if len(found)), None)
        if weak is not None:
            return (Reason("votes of the best circle", setting, float(weak[0, 3]), needed),)
        told = f"no circle has {WEAK:.0%} of the {needed:g} votes"
        return (Reason("votes of the best circle", setting, None, needed, told=told),)

    def trace(self, window: Window) -> EbppTrace:
        """The step of this window with every intermediate result."""
        start_s = time.perf_counter()
        detection = self.step(window)
        seconds = time.perf_counter() - start_s
        surface, needed = picture_of(self._surface, self._rule).copy(), votes_needed(self._roi, self.config)
        circles = np.empty((0, 4))
        if self._events:
            answers = find_circles(surface, self._roi, self.config)
            circles = np.column_stack([answers, np.full(len(answers), needed)])
        for weak in self._weaker():
            apart = np.hypot(*(weak[:, None, :2] - circles[None, :, :2]).T).min(axis=0, initial=np.inf)
            circles = np.concatenate([circles, weak[apart > self.config.radius_min_px]])
        return EbppTrace(surface, self._roi, circles, needed, detection, self.extra_circles, seconds)

    def explain(self, window: Window) -> MethodTrace:
        """The step of this window as Tune and `detect --explain` show it."""
        return _view_of(self.trace(window), window, self.why_not())

    def _weaker(self) -> Iterator[NDArray[np.float64]]:
        """(N, 4) circles of the last window with fewer and fewer votes than needed: u_px, v_px, r_px, votes."""
        needed = votes_needed(self._roi, self.config)
        picture = picture_of(self._surface, self._rule)
        for votes in np.linspace(needed, WEAK * needed, LEVELS)[1:].tolist() if self._events else ():
            found = _vote(picture, self._roi, self.config, votes)
            yield np.column_stack([found, np.full(len(found), votes)])


def _view_of(trace: EbppTrace, window: Window, reasons: tuple[Reason, ...]) -> MethodTrace:
    rows, columns = np.nonzero(trace.surface)
    shades = (trace.surface[rows, columns] >> 6).astype(np.int16)  # four groups, from faded to fresh
    surface = PixelLayer(columns, rows, shades)
    regions = region_shapes(trace.roi)
    enough = trace.circles[:, 3] >= trace.votes_needed
    circles = tuple(
        Outline("accepted" if good else "rejected", circle_points(u, v), r, f"{votes:.0f} votes", (u + r + 2, v - r))
        for (u, v, r, votes), good in zip(trace.circles[:LISTED].tolist(), enough, strict=False)
    )
    setting = "ebpp.votes_full" if trace.roi is None else "ebpp.votes_roi"
    candidates = tuple(
        CandidateRow(
            label=number,
            figures=(f"{u:.1f}, {v:.1f}", f"{r:.1f}", f"{votes:.0f}"),
            reasons=() if good else (Reason("votes", setting, votes, trace.votes_needed),),
            verdict="ball" if number == 0 else "another circle",
            order=votes,
            x_px=u + r * np.cos(np.linspace(0, 2 * np.pi, 24)),
            y_px=v + r * np.sin(np.linspace(0, 2 * np.pi, 24)),
        )
        for number, ((u, v, r, votes), good) in enumerate(zip(trace.circles[:LISTED].tolist(), enough, strict=False))
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
            "ebpp": StageCount(count, int(enough.sum()), unit="circles with enough votes", seconds=trace.seconds),
        },
        noun="circle",
        titles=("centre [px]", "radius [px]", "votes"),
        candidates=candidates,
        detection=trace.detection,
        reasons=() if trace.detection is not None else reasons,
        where="searched in the ROI" if trace.roi else "searched on the whole sensor",
    )
