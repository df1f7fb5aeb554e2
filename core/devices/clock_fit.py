"""Fit of a camera's clock to this machine's clock, from the arrival times of its packets.

A packet arrives some time after it was stamped, never before: USB and the operating system add a delay that is seldom
small and never negative. So the line of the clock lies below all points (stamp, arrival), and touches the few that
were hardly delayed. It is the line under all points with the least sum of distances to them: an edge of their lower
convex hull (Moon, Skelly and Towsley, "Estimation and removal of clock skew", INFOCOM 1999). The part of the delay
that every packet has cannot be seen by anybody; it stays in the offset.
"""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

BIN_US: Final = 250_000
"""Length of a bin: of all packets stamped in it only the least delayed one is kept."""
BINS: Final = 240
"""A minute: crystals drift with their temperature, and no faster."""
MAX_DRIFT: Final = 500e-6
"""Crystals are five times better; what looks like more is delay."""
JUMP_US: Final = 20_000.0
"""What lies so far below the line is no delay: one of the clocks was set."""
JUMP_BINS: Final = 12
"""Three seconds, all of them so far above the line: the same, in the other direction."""
RESIDUALS: Final = 256


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """A line: host time = stamp + offset + drift x (stamp - pivot), all in microseconds."""

    pivot_us: float
    offset_us: float
    drift: float
    """Seconds that the host's clock gains on the camera's in a second."""
    jitter_us: float
    """90th percentile of the recent packets' delay over the least delayed ones, us."""
    span_us: int
    """Time over which the clock was observed, at most a minute."""

    def host_us(self, stamp_us: float) -> float:
        """When the camera's clock showed this, on the host's."""
        return stamp_us + self.offset_us + self.drift * (stamp_us - self.pivot_us)

    def stamp_us(self, host_us: float) -> float:
        """What the camera's clock shows at a time of the host's."""
        return self.pivot_us + (host_us - self.pivot_us - self.offset_us) / (1.0 + self.drift)


class ClockFit:
    """Fits one camera's clock to arrival times. One thread adds; any may read `estimate`. Memory is bounded."""

    def __init__(self) -> None:
        self._estimate: ClockEstimate | None = None
        self.restarts = 0
        """Number of restarts: a clock was set, or the camera restarted."""
        self._forget()

    @property
    def estimate(self) -> ClockEstimate | None:
        """Newest estimate; None before the first packet."""
        return self._estimate

    def add(self, stamp_us: int, host_us: float) -> None:
        """A time of the camera's clock that had passed when something arrived at a time of the host's."""
        if self._bins and stamp_us < self._bins[-1][0] - 1_000_000:
            self._begin_again()
        gain_us = host_us - stamp_us
        known = self._estimate
        late_us = 0.0 if known is None else host_us - known.host_us(stamp_us)
        if late_us < -JUMP_US:
            self._begin_again()
            late_us, known = 0.0, None
        self._late_us.append(late_us)
        number = stamp_us // BIN_US
        if number != self._number:
            self._number = number
            if self._check_jump():
                known = None
            self._bins.append((stamp_us, gain_us))
            self._fit()
        elif gain_us < self._bins[-1][1]:
            self._bins[-1] = (stamp_us, gain_us)
            if known is None or late_us < 0.0:
                self._fit()

    def _forget(self) -> None:
        self._bins: deque[tuple[int, float]] = deque(maxlen=BINS)
        """(stamp, arrival - stamp) of the least delayed packet of each stretch."""
        self._late_us: deque[float] = deque(maxlen=RESIDUALS)
        self._number: int | None = None

    def _begin_again(self) -> None:
        self.restarts += 1
        self._forget()

    def _check_jump(self) -> bool:
        """Whether the last bins show that a clock was set; then only they are kept."""
        known = self._estimate
        if known is None or len(self._bins) <= JUMP_BINS:
            return False
        last = list(self._bins)[-JUMP_BINS:]
        if any(stamp_us + gain_us - known.host_us(stamp_us) < JUMP_US for stamp_us, gain_us in last):
            return False
        number = self._number
        self._begin_again()
        self._bins.extend(last)
        self._number = number
        return True

    def _fit(self) -> None:
        x = np.array([stamp_us for stamp_us, _ in self._bins], float)
        pivot_us = float(x.mean())
        x -= pivot_us
        y = np.array([gain_us for _, gain_us in self._bins])
        drift = min(MAX_DRIFT, max(-MAX_DRIFT, _slope_below(x, y)))
        offset_us = float((y - drift * x).min())
        late_us = np.fromiter(self._late_us, float)
        jitter_us = float(np.percentile(late_us, 90)) if len(late_us) else 0.0
        self._estimate = ClockEstimate(pivot_us, offset_us, drift, max(0.0, jitter_us), round(float(x[-1] - x[0])))


def _slope_below(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of the edge of the lower convex hull over x = 0, where x has its mean; 0 for a single point."""
    hull: list[int] = []
    for i in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (y[b] - y[a]) * (x[i] - x[a]) < (y[i] - y[a]) * (x[b] - x[a]):
                break
            hull.pop()
        hull.append(i)
    for a, b in itertools.pairwise(hull):
        if x[b] >= 0.0:
            return float((y[b] - y[a]) / (x[b] - x[a]))
    return 0.0


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
