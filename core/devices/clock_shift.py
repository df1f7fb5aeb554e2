"""Offset from the time stamps of one camera to the clock of another."""

from __future__ import annotations

from typing import Final

from core.devices.clock_fit import ClockFit

SLEW: Final = 1e-3
"""The shift changes by at most so much a second: ten times what clocks drift, too little to reorder events."""


class ClockShift:
    """Shift of one camera's clock. It stays 0 for a camera that shares a clock, as with a sync cable."""

    def __init__(self, own: ClockFit | None = None, reference: ClockFit | None = None) -> None:
        self._own, self._reference = own, reference
        self._last: tuple[int, float] | None = None

    def shift_us(self, stamp_us: int) -> int | None:
        """For stamps around this one, which grow from call to call; None before both clocks are known."""
        if self._own is None or self._reference is None:
            return 0
        own, reference = self._own.estimate, self._reference.estimate
        if own is None or reference is None:
            return None
        wanted_us = reference.stamp_us(own.host_us(stamp_us)) - stamp_us
        if self._last is not None:
            last_stamp_us, last_us = self._last
            most_us = SLEW * max(0, stamp_us - last_stamp_us)
            wanted_us = min(last_us + most_us, max(last_us - most_us, wanted_us))
        self._last = stamp_us, wanted_us
        return round(wanted_us)

    def settle(self) -> None:
        """Take the next shift at once, however far it is from the last."""
        self._last = None
