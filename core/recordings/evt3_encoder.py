"""Events to the EVT3 words of Prophesee's cameras, and the text in front of them in a RAW file.

Source: Prophesee's EVT3 format description. Single events only (no vectors): a word per event, and one for each change
of row and time. The coarse time is repeated every 4,096 us, as cameras do, so that its wrapping can be followed.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.events import Events, SensorSize
from core.jit import njit

LARGEST_PX: Final = 2048
"""Addresses have 11 bits."""
LOW_BITS: Final = 12
ROW, COLUMN, TIME_LOW, TIME_HIGH = 0x0000, 0x2000, 0x6000, 0x8000
NONE: Final = -1


class Evt3Encoder:
    """Events to words; what the reader remembers is remembered here from slice to slice."""

    def __init__(self) -> None:
        self._state = np.full(3, NONE, np.int64)

    @property
    def coarse(self) -> int:
        """The last coarse time that was said, in steps of 4,096 us; -1 before there was one."""
        return int(self._state[0])

    def advance(self, coarse: int) -> NDArray[np.uint16]:
        """The words of a stretch without events, up to a coarse time."""
        first = int(self._state[0]) + 1
        if coarse < first:
            return np.zeros(0, np.uint16)
        self._state[:2] = coarse, NONE
        return (TIME_HIGH | (np.arange(first, coarse + 1) & 0xFFF)).astype(np.uint16)

    def begin_packet(self) -> NDArray[np.uint16]:
        """The words that begin a packet which can be read without the one before it: the coarse time again."""
        self._state[1:] = NONE
        coarse = self.coarse
        return np.array([TIME_HIGH | (coarse & 0xFFF)] if coarse >= 0 else [], np.uint16)

    def encode(self, events: Events) -> NDArray[np.uint16]:
        """The words of the next events, whose times continue those before."""
        if not len(events):
            return np.zeros(0, np.uint16)
        highs = int(events.t_us[-1] >> LOW_BITS) - int(self._state[0])
        words = np.empty(3 * len(events) + highs, np.uint16)
        count = _encode(events.t_us, events.x_px, events.y_px, events.on, self._state, words)
        return words[:count]


def evt3_header(sensor: SensorSize) -> bytes:
    """The text in front of the words."""
    w, h = sensor.width_px, sensor.height_px
    lines = ["evt 3.0", f"format EVT3;height={h};width={w}", f"geometry {w}x{h}", "end"]
    return "".join(f"% {line}\n" for line in lines).encode()


@njit
def _encode(t, x, y, on, state, words):
    """Fill `words`, return how many; `state` is the last coarse time, fine time and row, -1 before there is one."""
    high, low, row = state[0], state[1], state[2]
    n = 0
    for i in range(len(t)):
        coarse, fine = t[i] >> 12, t[i] & 0xFFF
        while high < coarse:
            high += 1
            words[n] = TIME_HIGH | (high & 0xFFF)
            n += 1
            low = -1
        if fine != low:
            low = fine
            words[n] = TIME_LOW | low
            n += 1
        if y[i] != row:
            row = np.int64(y[i])
            words[n] = ROW | row
            n += 1
        words[n] = COLUMN | (np.int64(on[i]) << 11) | np.int64(x[i])
        n += 1
    state[0], state[1], state[2] = high, low, row
    return n
