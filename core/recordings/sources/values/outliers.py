"""Which events of a decoded stream can be true: strays in time and addresses outside the sensor are told from the rest.

A stray is an event whose time lies apart from its neighbours: of the events that follow, more go on from the time
before it than from its own. So a few wrong times cost a few events, wherever they stand.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit

LOOK_AHEAD: Final = 64
"""Events that are asked whether a time is wrong or right."""
FAR_AHEAD: Final = 4096
"""Events that are asked whether a time that leaps for good comes back: a packet may have come twice or late."""
_LEAP_US: Final = 1_000_000
_MOST_FAR_LOOKS: Final = 20_000
FEW: Final = 64
"""So many events at the very start may be left over from before a clock was set."""

GOOD, STRAY, OUTSIDE, DAMAGED = range(4)
"""What an event is: to be kept, of a wrong time, beside the sensor, or both."""
RUNNING, BACK, AHEAD = range(3)
"""How a stream ended: not yet, or because its time jumps for good."""
NOW, STARTED, KEPT, LATE, LATEST, WRAPS, EPOCH, END, MAX_X, MAX_Y, FAR_LOOKS, FIRST = range(12)
"""Places in the state of `mark_outliers`."""


class Rows(NamedTuple):
    """Rows that are judged, of equal length: times (us), columns, rows, and what each is found to be."""

    t: NDArray[np.int64]
    x: NDArray[np.int64]
    y: NDArray[np.int64]
    kind: NDArray[np.uint8]


class AddressBounds(NamedTuple):
    """What events must keep to."""

    width: int
    height: int
    jitter: int
    """An event that comes so late (us) is in its place."""
    longest: int
    """The longest pause, us."""
    lengths: NDArray[np.int64]
    """Lengths of clocks that may begin again at 0, us."""
    hold: bool
    """Whether a late event gets the time before it; without, it keeps its own."""


def start_state() -> np.ndarray:
    """The state in front of the first event."""
    return np.zeros(12, np.int64)


@njit
def _votes(t, i, epoch, now, here, bounds):
    """Counts of the events after `i`: how many go on from `now`, and how many from the time `here` of event `i`."""
    on, off = 0, 0
    low, high = min(now, here), max(now, here)
    for j in range(i + 1, min(i + 1 + LOOK_AHEAD, len(t))):
        t_j = t[j] + epoch
        if low - bounds.jitter <= t_j < high - bounds.jitter:
            on += here > now
            off += here < now
        elif high - bounds.jitter <= t_j <= high + bounds.longest:
            on += here < now
            off += here > now
    return on, off


@njit
def _comes_back(t, i, state, here, bounds):
    """Whether the time `here` of event `i` begins a packet of wrong times: of the last 64 of the next 4096 events most
    go on from the time before it.

    A clock that was set to its beginning may reach that time, too, but step by step.
    """
    now, epoch = state[NOW], state[EPOCH]
    end = min(i + 1 + FAR_AHEAD, len(t))
    start = max(i + 1, end - LOOK_AHEAD)
    latest = here - bounds.jitter if here > now else now + bounds.longest
    on = 0
    for j in range(start, end):
        on += now - bounds.jitter <= t[j] + epoch <= latest
    if 2 * on <= end - start:
        return False
    if here > now or here - state[FIRST] > (now - here) // 8:
        return True
    for j in range(i + 1, end):
        if t[j] + epoch >= now - bounds.jitter:
            return t[j] - t[j - 1] >= (now - here) // 2
    return False


@njit
def _wrap(now, raw, epoch, lengths):
    """The length of the clock that has begun again between `now` and the raw time; 0 if none has."""
    for length in lengths:
        ahead = raw + epoch + length - now
        near_end = now - epoch >= length - (length >> 4) or raw < 0
        if 0 <= ahead <= length >> 4 and near_end and abs(now - epoch) < length:
            return length
    return np.int64(0)


@njit
def _judge_step(t, i, state, bounds):
    """Whether a step of more than the jitter is right, what it ends (RUNNING, BACK, AHEAD), and the clock's length."""
    epoch, now = state[EPOCH], state[NOW]
    here = t[i] + epoch
    on, off = _votes(t, i, epoch, now, here, bounds)
    wrapped = np.int64(0)
    if here > now:
        good = on < off or (on == 0 and here - now <= bounds.longest)
        end = AHEAD if good and here - now > bounds.longest else RUNNING
    else:
        wrapped = _wrap(now, t[i], epoch, bounds.lengths)
        good = off > on or (wrapped > 0 and on == 0)
        end = BACK if good and wrapped == 0 else RUNNING
    leaps = end != RUNNING or (good and here - now > _LEAP_US)
    if leaps and state[FAR_LOOKS] < _MOST_FAR_LOOKS:
        state[FAR_LOOKS] += 1
        if _comes_back(t, i, state, here, bounds):
            return False, RUNNING, np.int64(0)
    return good, end, wrapped


@njit
def mark_outliers(rows, ready, bounds, state):
    """Judge the first `ready` of the rows; the others are only looked at. Returns how many were judged.

    Writes what each event is to `kind`, and puts right the times: clocks that begin again at 0 run on, and of late
    events those that `bounds` says.
    """
    t, x, y, kind = rows
    fresh = state[KEPT] == 0
    now = state[NOW]
    for i in range(ready):
        here = t[i] + state[EPOCH]
        outside = x[i] < 0 or y[i] < 0 or x[i] >= bounds.width or y[i] >= bounds.height
        good, end, wrapped = True, RUNNING, np.int64(0)
        if state[STARTED] and abs(here - now) > bounds.jitter:
            state[NOW] = now
            good, end, wrapped = _judge_step(t, i, state, bounds)
        if outside or not good:
            kind[i] = STRAY if not outside else OUTSIDE if good else DAMAGED
            if kind[i] == OUTSIDE:
                state[MAX_X], state[MAX_Y] = max(state[MAX_X], x[i]), max(state[MAX_Y], y[i])
            continue
        if end != RUNNING:
            if not fresh or state[KEPT] > FEW:
                state[END], state[NOW] = end, now
                return i
            for j in range(i):  # what stands before is left over from before the clock was set
                kind[j] = STRAY if kind[j] == GOOD else kind[j]
            state[KEPT] = state[STARTED] = 0
        if wrapped:
            state[EPOCH] += wrapped
            state[WRAPS] += 1
            here += wrapped
        kind[i] = GOOD
        state[KEPT] += 1
        if state[STARTED] and now - bounds.jitter <= here < now:
            state[LATE] += 1
            state[LATEST] = max(state[LATEST], now - here)
            t[i] = now if bounds.hold else here
            continue
        if not state[STARTED]:
            state[FIRST] = here
        state[STARTED] = 1
        now = here
        t[i] = here
    state[NOW] = now
    return ready
