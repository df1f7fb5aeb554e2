"""Pixels around a predicted ball: first and last event of each, and the edge points derived from them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.refined.circle_fit import EdgePoints
from core.detection.refined.history import Recent
from core.jit import njit

HALF: Final = 80
"""Half size of the patch, px: the largest ball, its motion and a margin."""
SIDE: Final = 2 * HALF + 1
MAX_POINTS: Final = 1200
"""Most edge points of one fit; later ones are ignored."""


class Patch(NamedTuple):
    """First and last event of each pixel, microseconds before the end of the window plus one; 0: none."""

    first: NDArray[np.int32]
    """(SIDE + 2, SIDE + 2), with a border that stays empty."""
    last: NDArray[np.int32]
    turned: NDArray[np.int32]
    """The first event of the other polarity than the pixel's first one."""
    before: NDArray[np.int32]
    """The last event of the other polarity than the pixel's last one."""
    events: NDArray[np.int32]
    """Number of events of each pixel."""
    brighter: NDArray[np.bool_]
    """Whether each pixel's first event was ON."""
    newest: NDArray[np.bool_]
    """Whether each pixel's last event was ON."""
    touched: NDArray[np.int32]
    """Flat indices of the pixels with events, in order of their first event."""
    interior: NDArray[np.bool_]
    """Whether each of these is well inside the disc; written by `edge_points`."""


class MovingCircle(NamedTuple):
    """Predicted ball at the end of the window: px, px/ms, edge latency in ms, px/ms^2 (see `circle_fit`)."""

    u: float
    v: float
    vu: float
    vv: float
    r: float
    stretch: float = 0.0
    au: float = 0.0
    av: float = 0.0

    def at(self, ms: float) -> MovingCircle:
        """The circle this much later."""
        u, v = self.u + ms * (self.vu + 0.5 * ms * self.au), self.v + ms * (self.vv + 0.5 * ms * self.av)
        return self._replace(u=u, v=v, vu=self.vu + ms * self.au, vv=self.vv + ms * self.av)


class LookBack(NamedTuple):
    """Time limits of the events used, in ms before the end of the window."""

    end_us: int
    gather_ms: float
    """Events are read back to here."""
    history_ms: float
    """A leading edge point is a pixel whose first event is at most as old."""
    guard_ms: float
    """A trailing edge point is one whose last event is at least as old."""
    tail: bool = False
    """Trailing edge points are first events of the trailing polarity instead: for a receptor with a long tail."""
    polarity: int = 0
    """1 for a ball that is known to be brighter than its ground, -1 for a darker one, 0 if that is not known."""


def blank_patch() -> Patch:
    """An empty patch."""
    side = SIDE + 2
    first, last, turned, before, events = np.zeros((5, side, side), np.int32)
    brighter, newest = np.zeros((2, side, side), np.bool_)
    touched, interior = np.zeros(side * side, np.int32), np.zeros(side * side, np.bool_)
    return Patch(first, last, turned, before, events, brighter, newest, touched, interior)


@njit
def fill_patch(recent: Recent, patch: Patch, u: float, v: float, reach_px: int, span: LookBack) -> tuple[int, int, int]:
    """Read the events within `reach_px` of (u, v); how many pixels were touched, and the address of the patch's origin.

    `first` and `last` hold the events' age in microseconds plus one.

    Args:
        recent: events of the history.
        patch: output, empty before.
        u: column of its middle, px.
        v: row of its middle, px.
        reach_px: half of the side that is read.
        span: time limits.
    """
    x0, y0 = round(u) - HALF - 1, round(v) - HALF - 1
    low, high = HALF + 1 - reach_px, 2 * reach_px
    oldest = span.end_us - int(span.gather_ms * 1000.0)
    begin = np.searchsorted(recent.t_us, oldest)
    count = 0
    first, last, touched = patch.first, patch.last, patch.touched
    x_low, y_low = x0 + low, y0 + low
    for k in range(begin, len(recent.t_us)):
        x, y = recent.x_px[k] - x_low, recent.y_px[k] - y_low
        if x < 0 or x > high or y < 0 or y > high:
            continue
        row, column = y + low, x + low
        # One more than the age: 0 is a pixel without events.
        age, on = np.int32(span.end_us - recent.t_us[k] + 1), recent.on[k]
        if first[row, column] == 0:
            first[row, column] = age
            # The other maps are not cleared after a fit; they begin anew with a pixel's first event.
            patch.brighter[row, column] = patch.newest[row, column] = on
            patch.events[row, column] = 0
            patch.turned[row, column] = patch.before[row, column] = 0
            touched[count] = row * (SIDE + 2) + column
            count += 1
        elif on != patch.newest[row, column]:
            patch.before[row, column] = last[row, column]
            patch.newest[row, column] = on
            if patch.turned[row, column] == 0:
                patch.turned[row, column] = age
        last[row, column] = age
        patch.events[row, column] += 1
    return count, x0, y0


@njit
def clear_patch(patch: Patch, count: int) -> None:
    """Clear the touched pixels."""
    for k in range(count):
        row, column = divmod(patch.touched[k], SIDE + 2)
        patch.first[row, column] = 0
        patch.last[row, column] = 0


@njit
def edge_points(
    patch: Patch,
    count: int,
    origin: tuple[int, int],
    ball: MovingCircle,
    band_px: float,
    span: LookBack,
    points: EdgePoints,
) -> tuple[int, int]:
    """Edge points within `band_px` of the ball's rim, and how many events lie well inside it.

    A pixel with fewer than two touched neighbours is noise. First events count on the leading half, last
    ones on the trailing half. With `span.tail` those are the first ones of the trailing polarity: the last ones of a
    slow receptor come when what is left of its tail happens to be less than a threshold, time constants later.

    Of a ball whose polarity is known, a pixel with events of both counts with the one that this edge of the ball makes:
    the ball's own shadow, which runs before it near a bounce, and noise would mark the pixel at another time. On the
    trailing half only where the other event is older than the guard: after a bounce the ball enters pixels again that
    it has just left, and the older event is of a path that it no longer follows.

    Args:
        patch: filled by `fill_patch`.
        count: pixels touched.
        origin: (x, y) address of the patch's corner.
        ball: the expected circle at the end of the window.
        band_px: half width of the band round the rim.
        span: time limits, and what is known of the polarity.
        points: output.
    """
    first, last = patch.first, patch.last
    found, inside = 0, 0
    bright = span.polarity > 0
    lead_on = span.tail and _brighter_ahead(patch, count, origin, ball, band_px, span)
    # Far enough from the rim that an error of the first estimate does not count edge events as inside.
    inner = 0.6 * ball.r
    for k in range(count):
        row, column = divmod(patch.touched[k], SIDE + 2)
        patch.interior[k] = False
        if not _has_neighbours(first, row, column):
            continue
        x, y = float(column + origin[0]), float(row + origin[1])
        entered_age, left_age, lead = first[row, column], last[row, column], patch.brighter[row, column]
        if span.polarity != 0:
            if lead != bright and patch.turned[row, column] != 0:
                entered_age, lead = patch.turned[row, column], bright
            stays = -0.001 * (last[row, column] - 1) <= -span.guard_ms
            if stays and patch.newest[row, column] == bright and patch.before[row, column] != 0:
                left_age = patch.before[row, column]
        entered = -0.001 * (entered_age - 1)
        left = -0.001 * (left_age - 1)
        if entered >= -span.history_ms:
            ms = entered + ball.stretch
            du = x - ball.u - (ball.vu + 0.5 * ball.au * ms) * ms
            dv = y - ball.v - (ball.vv + 0.5 * ball.av * ms) * ms
            distance = math.sqrt(du * du + dv * dv)
            if abs(distance - ball.r) <= band_px and du * ball.vu + dv * ball.vv >= 0.0 and found < MAX_POINTS:
                points.u[found], points.v[found], points.ms[found] = x, y, entered
                points.events[found] = patch.events[row, column]
                points.lead[found] = 1.0 if lead else -1.0
                found += 1
            if distance < inner:
                inside += int(patch.events[row, column])
                patch.interior[k] = True
        trails = left <= -span.guard_ms and left >= -span.history_ms
        if span.tail:
            age = patch.turned[row, column] if patch.brighter[row, column] == lead_on else first[row, column]
            left = -0.001 * (age - 1)
            trails = age > 0 and left >= -span.history_ms
        if trails:
            ms = left - ball.stretch
            du = x - ball.u - (ball.vu + 0.5 * ball.au * ms) * ms
            dv = y - ball.v - (ball.vv + 0.5 * ball.av * ms) * ms
            distance = math.sqrt(du * du + dv * dv)
            if abs(distance - ball.r) <= band_px and du * ball.vu + dv * ball.vv < 0.0 and found < MAX_POINTS:
                points.u[found], points.v[found], points.ms[found] = x, y, left
                points.events[found] = patch.events[row, column]
                points.lead[found] = 0.0
                found += 1
    return found, inside


@njit
def _brighter_ahead(patch, count, origin, ball, band_px, span):
    """Whether more pixels of the leading edge became brighter than darker."""
    surplus = 0
    for k in range(count):
        row, column = divmod(patch.touched[k], SIDE + 2)
        ms = -0.001 * (patch.first[row, column] - 1)
        if ms < -span.history_ms:
            continue
        ms += ball.stretch
        du = column + origin[0] - ball.u - (ball.vu + 0.5 * ball.au * ms) * ms
        dv = row + origin[1] - ball.v - (ball.vv + 0.5 * ball.av * ms) * ms
        if du * ball.vu + dv * ball.vv >= 0.0 and abs(math.sqrt(du * du + dv * dv) - ball.r) <= band_px:
            surplus += 1 if patch.brighter[row, column] else -1
    return surplus >= 0


@njit
def _has_neighbours(first, row, column):
    neighbours = -1
    for i in range(-1, 2):
        for j in range(-1, 2):
            neighbours += first[row + i, column + j] != 0
    return neighbours >= 2
