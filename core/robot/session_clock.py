"""When, by this machine's clock, it is what time in the session of a live source: from when its blocks arrive."""

from __future__ import annotations

from collections import deque
from typing import Final

SPAN_US: Final = 1_000_000
"""What arrived in this time is remembered. A block comes late, never early: the quickest one counts."""


class SessionClock:
    """Of one session; used by one thread, read by any."""

    def __init__(self) -> None:
        self._gaps: deque[tuple[float, float]] = deque()
        """(arrival, arrival - time of the session), the gaps growing: of all others a later one is smaller."""
        self._gap_us: float | None = None

    def add(self, t_us: int, host_us: float) -> None:
        """At a time of our clock a block came that ends at `t_us`."""
        gap_us = host_us - t_us
        while self._gaps and self._gaps[-1][1] >= gap_us:
            self._gaps.pop()
        self._gaps.append((host_us, gap_us))
        while host_us - self._gaps[0][0] > SPAN_US:
            self._gaps.popleft()
        self._gap_us = self._gaps[0][1]

    def host_us(self, t_us: float) -> float | None:
        """On our clock; None before anything came."""
        return None if self._gap_us is None else t_us + self._gap_us

    def session_us(self, host_us: float) -> float | None:
        """The other way round."""
        return None if self._gap_us is None else host_us - self._gap_us
