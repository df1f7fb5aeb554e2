"""The coarse time words of Prophesee's EVT formats: which to believe.

EVT2, EVT2.1 and EVT3 share one scheme: a word of type 8 carries the upper bits of the time, a counter that wraps. It is
repeated many times a second, so a damaged one betrays itself by the next.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit

TIME_HIGH: Final = 8

BELIEVE: Final = 0
IGNORE: Final = 1
STOP: Final = 2

_ASKED: Final = 8
"""Coarse times that are asked whether one before them is right."""
_ODD_AMONG_ASKED: Final = 3
"""So many of them may be damaged themselves where the step is a plausible one."""

NO_DAMAGE, BAD_WORD, BAD_COLUMN, BAD_ROW, BAD_TIME = range(5)
"""Why a decoder stopped."""


class Decoded(NamedTuple):
    """What the decoders write to: columns of events and of triggers, times in microseconds."""

    t_us: NDArray[np.int64]
    x_px: NDArray[np.uint16]
    y_px: NDArray[np.uint16]
    on: NDArray[np.bool_]
    trigger_t_us: NDArray[np.int64]
    trigger_on: NDArray[np.bool_]
    trigger_id: NDArray[np.int16]

    @staticmethod
    def empty(events: int, triggers: int) -> Decoded:
        """Room for so many events and triggers."""
        x, y, on = np.empty(events, np.uint16), np.empty(events, np.uint16), np.empty(events, np.bool_)
        trigger_on, trigger_id = np.empty(triggers, np.bool_), np.empty(triggers, np.int16)
        return Decoded(np.empty(events, np.int64), x, y, on, np.empty(triggers, np.int64), trigger_on, trigger_id)


@njit
def next_time_high(words, start, type_shift, value_shift, mask):
    """The value of the first coarse time word from `start` on, or -1."""
    for i in range(start, len(words)):
        word = np.uint64(words[i])
        if word >> np.uint64(type_shift) == TIME_HIGH:
            return np.int64((word >> np.uint64(value_shift)) & np.uint64(mask))
    return np.int64(-1)


@njit
def judge_time_high(words, at, value, current, type_shift, value_shift, mask, second):
    """Whether to believe the coarse time `value` of word `at` after `current`.

    `second` is one second in steps of the counter, `mask` its largest value. A step of one is plain. Any other is
    damage if the next coarse time goes on from the current one, or if those that follow do not go on from it. A step
    back is damage, too, unless those that follow confirm it: then it is the end of what can be trusted.
    """
    ahead = (value - current) & mask
    if ahead <= 1:
        return BELIEVE
    longest_pause = min(mask // 2, 600 * second)
    largest_step = longest_pause if ahead <= longest_pause else second
    last, before, seen, going_on, odd, i = value, value, 0, 0, 0, at + 1
    while seen < _ASKED and i < len(words):
        word = np.uint64(words[i])
        i += 1
        if word >> np.uint64(type_shift) != TIME_HIGH:
            continue
        following = np.int64((word >> np.uint64(value_shift)) & np.uint64(mask))
        going_on += (following - current) & mask <= min(second, ahead - 1)
        if going_on > min(seen, 1):
            return IGNORE
        if (following - last) & mask > largest_step:
            odd += 1  # this one, or the one before it
            if odd > (_ODD_AMONG_ASKED if ahead <= second else 0):
                return IGNORE
            if (following - before) & mask > second:
                continue
        before, last = last, following
        seen += 1
    if ahead <= longest_pause:
        return BELIEVE
    return STOP if seen else IGNORE
