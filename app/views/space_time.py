"""Events of a window and of its neighbours as points in space and time, with the ball's circles as a tube.

Coordinates are those of a box round the origin, in which 1 is the longer side of the region, and `TIME_LENGTH` the time
that is shown: +x is later, +y the sensor's left, +z its top. So the box shows the picture, not its mirror image, to who
looks along time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.pictures.canvas import Region
from app.pictures.palette import PaletteIndex, PolarityColours, palette
from app.state.client_state import SpaceColour
from app.views.stage_picture import ball_ink, cluster_colour_index, stage_pixels
from core.detection import DetectorConfig, make_detector
from core.detection.method_trace import MethodTrace
from core.events import Events
from core.metrics.run import LEAD_IN_US, WindowAnswer, WindowAnswers, run_detector
from core.recordings import CameraStream, PixelTruth
from core.text import counted

MOST_POINTS: Final = 30_000
"""More are thinned: so many points can be turned smoothly, and are 270 kB an update."""
NEIGHBOURS: Final = 8
"""Windows shown on each side: in 17 ms of `refined` a ball moves by several radii, so its tube has a direction."""
TIME_LENGTH: Final = 1.6
"""Length of the box along time: the middle of the window is wider than high."""
RING: Final = 24
"""Corners of a circle of the tube."""
STAVES: Final = 8
"""Lines along the tube; divides `RING`."""
PICK_RAD: Final = 0.012
"""A click means an event at most so far beside its ray: 10 px in a picture of 560 px and 40 degrees."""
TICKS: Final = 3
"""About so many on each axis: labels hide points."""

Array = NDArray[np.float64]
Points = NDArray[np.float32]
Segments = NDArray[np.float32]
"""(N, 2, 3) ends of lines."""
NO_LINES: Final = np.zeros((0, 2, 3), np.float32)


class Circles(Protocol):
    """N circles of balls, each at its own time, ascending; nan where there is none."""

    @property
    def t_us(self) -> NDArray[np.int64]: ...
    @property
    def u_px(self) -> Array: ...
    @property
    def v_px(self) -> Array: ...
    @property
    def r_px(self) -> Array: ...


@dataclass(frozen=True, slots=True)
class SpaceTimeBox:
    """What the box holds: a region of the sensor, and a time."""

    region: Region
    start_us: int
    end_us: int

    def places(self, x_px: ArrayLike, y_px: ArrayLike, t_us: ArrayLike) -> Points:
        """(N, 3) places in the box of pixels at times; each argument is (N,) or a number."""
        region, longest = self.region, max(self.region.width, self.region.height)
        x, y, t = (np.asarray(one, np.float64) for one in (x_px, y_px, t_us))
        along = TIME_LENGTH * ((t - self.start_us) / (self.end_us - self.start_us) - 0.5)
        left = (region.x + (region.width - 1) / 2 - x) / longest
        up = (region.y + (region.height - 1) / 2 - y) / longest
        return np.stack(np.broadcast_arrays(along, left, up), axis=-1).reshape(-1, 3).astype(np.float32)

    def holds(self, x_px: ArrayLike, y_px: ArrayLike, t_us: ArrayLike) -> NDArray[np.bool_]:
        """(N,) whether points at times lie in the box; nan does not."""
        region = self.region
        x, y, t = np.subtract(x_px, region.x), np.subtract(y_px, region.y), np.asarray(t_us)
        beside = (x >= -0.5) & (x < region.width - 0.5) & (y >= -0.5) & (y < region.height - 0.5)
        return beside & (t >= self.start_us) & (t <= self.end_us)

    def edges(self, start_us: int, end_us: int) -> Segments:
        """(12, 2, 3) edges of the part of the box between two times."""
        x, y, width, height = self.region.x, self.region.y, self.region.width, self.region.height
        xs, ys = (x - 0.5, x + width - 0.5), (y - 0.5, y + height - 0.5)
        corners = self.places(*np.array([(i, j, t) for t in (start_us, end_us) for j in ys for i in xs]).T)
        pairs = [(a, a | bit) for bit in (1, 2, 4) for a in range(8) if not a & bit]
        return corners[np.array(pairs)]


@dataclass(frozen=True, slots=True)
class Tick:
    """A value on an axis of the box."""

    place: tuple[float, float, float]
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class SpaceTime:
    """What the 3D view of a window shows."""

    points: Points
    """(N, 3) events, N at most `MOST_POINTS`."""
    colours: NDArray[np.uint8]
    """(N, 3) RGB."""
    x_px: NDArray[np.uint16]
    """(N,) column on the sensor; so y_px."""
    y_px: NDArray[np.uint16]
    frame: Segments
    slab: Segments
    """The window in the box `frame`."""
    tube: Segments
    """The circles of the balls in the windows, joined where two windows in a row have one."""
    tube_rgb: tuple[int, int, int]
    mark: Segments
    """One circle through the window, which is set off; empty if none is."""
    mark_rgb: tuple[int, int, int]
    truth: Segments
    """Path of the true ball's centre; empty where it is not known or not to be shown."""
    ticks: tuple[Tick, ...]
    note: str
    """How many of the events are drawn, and in which time."""


def space_time_of(
    stream: CameraStream,
    answer: WindowAnswer,
    circles: WindowAnswers,
    region: Region,
    stage: str,
    colour: SpaceColour,
    colours: PolarityColours,
    *,
    truth: PixelTruth | None = None,
    wrong: bool = False,
) -> SpaceTime:
    """The events of a region in the window of an answer and in `NEIGHBOURS` on each side.

    Args:
        stream: the camera.
        answer: the window, with its trace.
        circles: answers to the windows shown, see `answers_around`.
        region: part of the sensor that is shown.
        stage: name of the view of the trace that colours the window's events, if `colour` is "stage".
        colour: what colours them.
        colours: those of ON and OFF events.
        truth: the true ball, to be drawn too.
        wrong: whether the window's ball is false; its tube is red.
    """
    window = answer.window.start_us, answer.window.end_us
    return events_in_space(
        stream,
        window,
        region,
        lambda events: answer_inks(events, window, answer, stage, colour),
        colours,
        circles,
        joined_us=window[1] - window[0],
        ink=ball_ink(wrong=wrong),
        zero_us=window[1],
        truth=truth,
    )


def events_in_space(
    stream: CameraStream,
    window: tuple[int, int],
    region: Region,
    inks: Callable[[Events], NDArray[np.uint8]],
    colours: PolarityColours,
    circles: Circles,
    *,
    joined_us: int,
    ink: int,
    zero_us: int,
    truth: PixelTruth | None = None,
    mark: tuple[float, float, float] | None = None,
    mark_ink: int = 0,
) -> SpaceTime:
    """The events of a region in a window and in `NEIGHBOURS` on each side.

    Args:
        stream: the camera.
        window: start and end, us.
        region: part of the sensor that is shown.
        inks: (N,) palette indices of N events.
        colours: those of ON and OFF events.
        circles: balls in the time that is shown, see `span_of`.
        joined_us: usual time between two circles in a row.
        ink: palette index of their tube.
        zero_us: the time that the axis calls 0.
        truth: the true ball, to be drawn too.
        mark: column, row and radius of a circle that is set off, px.
        mark_ink: its palette index.
    """
    start_us, end_us = span_of(window)
    box, rgb = SpaceTimeBox(region, start_us, end_us), palette(colours)
    shown = events_in(stream.slice(start_us, end_us), region)
    kept = thinned(len(shown), MOST_POINTS)
    x_px, y_px = shown.x_px[kept], shown.y_px[kept]
    windows = round((end_us - start_us) / (window[1] - window[0]))
    return SpaceTime(
        points=box.places(x_px, y_px, shown.t_us[kept]),
        colours=rgb[inks(shown)[kept]],
        x_px=x_px,
        y_px=y_px,
        frame=box.edges(start_us, end_us),
        slab=box.edges(*window),
        tube=tube_of(box, circles, joined_us),
        tube_rgb=_rgb(rgb, ink),
        mark=NO_LINES if mark is None else cylinder_of(box, window, mark),
        mark_rgb=_rgb(rgb, mark_ink),
        truth=_path_of(box, truth),
        ticks=ticks_of(box, zero_us),
        note=f"{count_note(len(kept), len(shown))} in {counted(windows, 'window')}, {(end_us - start_us) / 1e3:g} ms",
    )


def span_of(window: tuple[int, int]) -> tuple[int, int]:
    """Start and end of the time that is shown with a window, us; whole windows, from the start of the recording on."""
    start_us, end_us = window
    window_us = end_us - start_us
    before = min(NEIGHBOURS, start_us // window_us)
    return start_us - before * window_us, end_us + NEIGHBOURS * window_us


def answers_around(stream: CameraStream, answer: WindowAnswer, config: DetectorConfig) -> WindowAnswers:
    """Answers of the method to the windows shown, from one run over them and the time before."""
    window_us = answer.window.end_us - answer.window.start_us
    start_us, end_us = span_of((answer.window.start_us, answer.window.end_us))
    lead_in = min(LEAD_IN_US, start_us) // window_us
    detector = make_detector(answer.method, stream.sensor, config)
    found = run_detector(stream, detector, window_us, start_us=start_us - lead_in * window_us, end_us=end_us)
    return found.rows(found.end_us > start_us)


def events_in(events: Events, region: Region) -> Events:
    """The events on the pixels of a region, in order of time."""
    x, y = events.x_px.astype(np.int64) - region.x, events.y_px.astype(np.int64) - region.y
    return events.rows((x >= 0) & (x < region.width) & (y >= 0) & (y < region.height))


def thinned(count: int, most: int) -> NDArray[np.intp]:
    """(min(count, most),) indices, evenly spaced: every part of the box loses the same share of its events."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.intp)


def count_note(drawn: int, count: int) -> str:
    """How many of the events are drawn."""
    if drawn == count:
        return counted(count, "event")
    return f"{drawn:,} of {counted(count, 'event')} drawn, 1 in {count / drawn:.1f},"


def tube_of(box: SpaceTimeBox, circles: Circles, window_us: int) -> Segments:
    """Circles of balls at their own times, with lines between those of neighbouring windows.

    Args:
        box: where they are drawn.
        circles: those of windows in a row.
        window_us: length of a window; circles that lie farther apart than 1.5 windows are not joined.
    """
    inside = box.holds(circles.u_px, circles.v_px, circles.t_us) & np.isfinite(circles.r_px)
    t = circles.t_us[inside]
    u, v, r = (one[inside] for one in (circles.u_px, circles.v_px, circles.r_px))
    joined = np.diff(t) <= 1.5 * window_us
    return _rings_of(box, t, u, v, r, joined)


def cylinder_of(box: SpaceTimeBox, window: tuple[int, int], circle: tuple[float, float, float]) -> Segments:
    """A circle (column, row, radius, px) from the start to the end of a window; nothing if its centre is outside."""
    t = np.array(window, np.int64)
    u, v, r = (np.full(2, value) for value in circle)
    if not box.holds(u, v, t).all():
        return NO_LINES
    return _rings_of(box, t, u, v, r, np.ones(1, np.bool_))


def _rings_of(
    box: SpaceTimeBox, t: NDArray[np.int64], u: Array, v: Array, r: Array, joined: NDArray[np.bool_]
) -> Segments:
    """N circles, and lines from one to the next where the (N - 1,) `joined` say so."""
    angle = np.arange(RING) * (2 * np.pi / RING)
    x, y = u[:, None] + r[:, None] * np.cos(angle), v[:, None] + r[:, None] * np.sin(angle)
    rings = box.places(x, y, np.broadcast_to(t[:, None], x.shape)).reshape(-1, RING, 3)
    around = np.stack([rings, np.roll(rings, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    corners = rings[:, :: RING // STAVES]
    along = np.stack([corners[:-1], corners[1:]], axis=2)[joined].reshape(-1, 2, 3)
    return np.concatenate([around, along])


def ticks_of(box: SpaceTimeBox, zero_us: int) -> tuple[Tick, ...]:
    """Round values along the lower front edges, with units; times are from the end of the window, `zero_us`."""
    region = box.region
    left, top = region.x - 0.5, region.y - 0.5
    right, bottom = left + region.width, top + region.height
    times_ms = round_values((box.start_us - zero_us) / 1e3, (box.end_us - zero_us) / 1e3)
    ticks = [
        *((right, bottom, zero_us + 1e3 * ms, f"t = {ms:g} ms" if ms == 0 else f"{ms:+g} ms") for ms in times_ms),
        *((x, bottom, box.start_us, f"x {x:g} px") for x in round_values(left, right)),
        *((left, y, box.start_us, f"y {y:g} px") for y in round_values(top, bottom)),
    ]
    places = box.places(*np.array([tick[:3] for tick in ticks]).T)
    return tuple(
        Tick((float(p[0]), float(p[1]), float(p[2])), text) for p, (*_, text) in zip(places, ticks, strict=True)
    )


def round_values(low: float, high: float) -> list[float]:
    """About `TICKS` round values from `low` to `high`: multiples of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next(factor for factor in (1, 2, 5, 10) if factor * power >= 0.8 * rough)
    return [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def event_at(shown: SpaceTime, origin: ArrayLike, direction: ArrayLike) -> tuple[float, float] | None:
    """Pixel of the event nearest to a ray, by the angle seen from its origin; None if none is within `PICK_RAD`.

    Args:
        shown: the events.
        origin: (3,) of the ray, in the box.
        direction: (3,) of the ray, of any length.
    """
    if not len(shown.points):
        return None
    ray = np.asarray(direction, np.float64)
    ray = ray / np.linalg.norm(ray)
    away = shown.points - np.asarray(origin, np.float64)
    depth = away @ ray
    beside = np.linalg.norm(away - depth[:, None] * ray, axis=1)
    angle = np.where(depth > 0, np.arctan2(beside, depth), np.inf)
    nearest = int(np.argmin(angle))
    if angle[nearest] > PICK_RAD:
        return None
    return float(shown.x_px[nearest]), float(shown.y_px[nearest])


def answer_inks(
    events: Events, shown_us: tuple[int, int], answer: WindowAnswer, stage: str, colour: SpaceColour
) -> NDArray[np.uint8]:
    """(N,) palette indices: those of the answer's window as asked for, others by polarity, dim outside of `shown_us`.

    Args:
        events: N events.
        shown_us: start and end of the window that is set off.
        answer: the method's answer, with its trace; without one all are by polarity.
        stage: name of the view of the trace, if `colour` is "stage".
        colour: what colours the events of the answer's window.
    """
    window, trace = answer.window, answer.trace
    inks = polarity_inks(events, *shown_us)
    inside = (events.t_us >= window.start_us) & (events.t_us < window.end_us)
    if trace is not None and colour in ("cluster", "verdict"):
        return np.where(inside, _candidate_inks(events, trace, colour), inks)
    if trace is not None and colour == "stage" and trace.view(stage).pixels is not None:
        return np.where(inside, stage_pixels(window, trace, stage, "polarity")[events.y_px, events.x_px], inks)
    return inks


def polarity_inks(events: Events, start_us: int, end_us: int) -> NDArray[np.uint8]:
    """(N,) palette indices by polarity: bright in a window, dim around it; in one that is empty, dim everywhere."""
    inside = (events.t_us >= start_us) & (events.t_us < end_us)
    bright = np.where(events.on, PaletteIndex.ON, PaletteIndex.OFF)
    return np.where(inside, bright, np.where(events.on, PaletteIndex.ON_DIM, PaletteIndex.OFF_DIM)).astype(np.uint8)


def _candidate_inks(events: Events, trace: MethodTrace, colour: SpaceColour) -> NDArray[np.uint8]:
    """(N,) green or red on the pixels of a candidate by its "verdict", or a colour for each "cluster"; others dim."""
    inks = polarity_inks(events, 0, 0)
    here = _pixel_keys(events.x_px, events.y_px)
    for candidate in sorted(trace.candidates, key=lambda one: not one.reasons):  # an accepted one last
        ink = PaletteIndex.HULL_REJECTED if candidate.reasons else PaletteIndex.HULL
        ink = cluster_colour_index(candidate.label) if colour == "cluster" else ink
        inks[np.isin(here, _pixel_keys(candidate.x_px, candidate.y_px))] = ink
    return inks


def _pixel_keys(x_px: NDArray[np.number], y_px: NDArray[np.number]) -> NDArray[np.int64]:
    return np.rint(y_px).astype(np.int64) << 32 | np.rint(x_px).astype(np.int64)


def _path_of(box: SpaceTimeBox, truth: PixelTruth | None) -> Segments:
    if truth is None:
        return NO_LINES
    there = truth.at(np.linspace(box.start_us, box.end_us, 2 * NEIGHBOURS + 2))
    places = box.places(there.u_px, there.v_px, there.t_us)
    seen = there.visible & box.holds(there.u_px, there.v_px, there.t_us)
    return np.stack([places[:-1], places[1:]], axis=1)[seen[:-1] & seen[1:]]


def _rgb(rgb: NDArray[np.uint8], ink: int) -> tuple[int, int, int]:
    red, green, blue = rgb[ink].tolist()
    return red, green, blue
