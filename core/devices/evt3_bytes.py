"""EVT3 bytes without decoding: the time at their end, and where to resume after a gap.

Source: Prophesee's EVT3 format description: 16-bit words, the upper four bits their kind.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

ROW, COLUMN, VECTOR_12, VECTOR_8, TIME_LOW, TIME_HIGH, TRIGGER = 0x0, 0x2, 0x4, 0x5, 0x6, 0x8, 0xA
TAIL: Final = 4096
"""Words at the end that are looked at first: cameras repeat the time much more often."""


class Evt3Clock:
    """The time at the end of each piece of a stream, from its first coarse time on; as the decoder counts it."""

    def __init__(self) -> None:
        self._high = -1
        self._epoch = self._low = 0

    def after(self, words: NDArray[np.uint16]) -> int | None:
        """Microseconds; None before there was a coarse time. Call it for every piece, in order."""
        for part in (words[-TAIL:], words):
            kinds = part >> 12
            highs = np.flatnonzero(kinds == TIME_HIGH)
            if len(highs):
                break
        since = 0
        if len(highs):
            since, high = int(highs[-1]), int(part[highs[-1]]) & 0xFFF
            ahead = (high - self._high) & 0xFFF
            if self._high < 0 or ahead < 0x800:  # else it is damaged, or the clock went back
                self._epoch += self._high >= 0 and high < self._high
                if ahead:
                    self._low = 0
                self._high = high
        lows = np.flatnonzero(kinds[since:] == TIME_LOW)
        if len(lows):
            self._low = int(part[since + lows[-1]]) & 0xFFF
        return None if self._high < 0 else (self._epoch << 24) + (self._high << 12) + self._low


class GapResynchroniser:
    """After a gap row and time are unknown: removes events until the stream has stated both."""

    def __init__(self) -> None:
        self.events_left_out = 0
        self._has_time = self._has_row = True

    def begin_gap(self) -> None:
        """Note that data is missing before the next piece."""
        self._has_time = self._has_row = False

    def fix(self, words: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Next words without events of unknown position or time."""
        if self._has_row:
            return words
        kinds = words >> 12
        first = 0
        if not self._has_time:
            highs = np.flatnonzero(kinds == TIME_HIGH)
            self._has_time = len(highs) > 0
            first = int(highs[0]) if self._has_time else len(words)
        rows = np.flatnonzero(kinds[first:] == ROW)
        self._has_row = len(rows) > 0 and self._has_time
        until = first + int(rows[0]) if self._has_row else len(words)
        self.events_left_out += count_events(words[:until])
        kept = np.isin(kinds[:until], (TIME_LOW, TIME_HIGH))
        kept[:first] = False
        return np.concatenate([words[:until][kept], words[until:]])


def count_events(words: NDArray[np.uint16]) -> int:
    """Number of events in some words."""
    kinds = words >> 12
    events = int((kinds == COLUMN).sum())
    for kind, mask in ((VECTOR_12, 0xFFF), (VECTOR_8, 0xFF)):
        events += int(np.bitwise_count(words[kinds == kind] & mask).sum())
    return events
