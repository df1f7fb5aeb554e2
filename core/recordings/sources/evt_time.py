"""The coarse time words of Prophesee's EVT formats: which to believe.

All of them share one scheme: words of one type carry the upper bits of the time, a counter that wraps. They are
repeated many times a second, so a damaged one betrays itself by the next.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit

BELIEVE: Final = 0
IGNORE: Final = 1
STOP: Final = 2

_ASKED: Final = 8
"""Coarse times that are asked whether one before them is right."""
_ASKED_LONG: Final = 64
"""Coarse times that are asked about a large step: a whole packet of damaged ones may follow."""
_SMALL_SHARE: Final = 100
"""A step of less than a second divided by this is not asked about for so long."""

NO_DAMAGE, BAD_WORD, BAD_COLUMN, BAD_ROW, BAD_TIME = range(5)
"""Why a decoder stopped."""
SUSPECT_WORDS: Final = 4096
"""A jump in time this close before damage is taken for part of it (chosen)."""
BLOCK_BYTES: Final = 1 << 20
"""Bytes of a file that are read and decoded at once (chosen: small beside the memory, large beside a read)."""
ROOM_EVENTS, ROOM_TRIGGERS = 1 << 18, 1 << 14
"""Size of what is decoded at once: memory stays bounded, whatever the words expand to (chosen)."""


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
    def empty(events: int = ROOM_EVENTS, triggers: int = ROOM_TRIGGERS) -> Decoded:
        """Room for so many events and triggers."""
        x, y, on = np.empty(events, np.uint16), np.empty(events, np.uint16), np.empty(events, np.bool_)
        trigger_on, trigger_id = np.empty(triggers, np.bool_), np.empty(triggers, np.int16)
        return Decoded(np.empty(events, np.int64), x, y, on, np.empty(triggers, np.int64), trigger_on, trigger_id)


class CoarseTime(NamedTuple):
    """Where the coarse time is in the words of a format."""

    kind: int
    """Type of its words."""
    kind_shift: int
    value_shift: int
    mask: int
    """Largest value of the counter."""
    second: int
    """One second in steps of the counter."""
    pairs: bool = False
    """Whether words of types C and D are followed by one of no type (EVT4)."""


EVT2_TIME: Final = CoarseTime(8, 28, 0, 0xFFFFFFF, 1_000_000 // 64)
EVT21_TIME: Final = CoarseTime(8, 60, 32, 0xFFFFFFF, 1_000_000 // 64)
EVT3_TIME: Final = CoarseTime(8, 12, 0, 0xFFF, 1_000_000 // 4096)
EVT4_TIME: Final = CoarseTime(14, 28, 0, 0xFFFFFFF, 1_000_000 // 64, pairs=True)


@njit
def _find_coarse(words, start, form):
    """The first coarse time from word `start` on, or -1, and the number of the word after it."""
    i = start
    while i < len(words):
        word = np.uint64(words[i])
        kind = np.int64(word >> np.uint64(form.kind_shift))
        i += 1
        if kind == form.kind:
            return np.int64((word >> np.uint64(form.value_shift)) & np.uint64(form.mask)), i
        if form.pairs and (kind == 0xC or kind == 0xD):
            i += 1
    return np.int64(-1), i


@njit
def next_time_high(words, start, form):
    """The value of the first coarse time word from `start` on, or -1."""
    return _find_coarse(words, start, form)[0]


@njit
def _comes_back(words, at, value, current, form):
    """Whether most of the last coarse times of the next 64 go on from `current`, and not from the `value` of word `at`.

    So a packet of wrong times is told from a pause and from a clock that was set.
    """
    ahead = (value - current) & form.mask
    longest = min(form.mask // 2, 600 * form.second)
    limit = ahead - 1 if ahead <= longest else longest
    latest = np.zeros(_ASKED, np.bool_)
    seen, i = 0, at + 1
    while seen < _ASKED_LONG:
        following, i = _find_coarse(words, i, form)
        if following < 0:
            break
        latest[seen % _ASKED] = (following - current) & form.mask <= limit
        seen += 1
    return 2 * np.count_nonzero(latest) > min(seen, _ASKED)


@njit
def judge_time_high(words, at, value, current, form):
    """Whether to believe the coarse time `value` of word `at` after `current`; `form` is a `CoarseTime`.

    A step of one is plain. Any other is damage if the next coarse time goes on from the current one, or if those that
    follow do not go on from it. A step back is damage, too, unless those that follow confirm it: then it is the end of
    what can be trusted.
    """
    mask, second = form.mask, form.second
    ahead = (value - current) & mask
    if ahead <= 1:
        return BELIEVE
    # Ten minutes without an event, or half of the counter, beyond which ahead and back look alike.
    longest_pause = min(mask // 2, 600 * second)
    largest_step = longest_pause if ahead <= longest_pause else second
    last, seen, going_on, odd, i = value, 0, 0, 0, at + 1
    while seen < _ASKED and odd < _ASKED_LONG:
        following, i = _find_coarse(words, i, form)
        if following < 0:
            break
        going_on += (following - current) & mask <= min(second, ahead - 1)
        if going_on > min(seen, 1):
            return IGNORE
        if (following - last) & mask > largest_step and (following - value) & mask > largest_step:
            odd += 1
            if ahead > second:
                return IGNORE
            continue
        last = following
        seen += 1
    if odd > seen:
        return IGNORE
    if ahead > max(second // _SMALL_SHARE, 1) and _comes_back(words, at, value, current, form):
        return IGNORE
    if ahead <= longest_pause:
        return BELIEVE
    return STOP if seen else IGNORE
