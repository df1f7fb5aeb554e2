"""The sensor's readout: one queue for all pixels, which delays a burst and, past a limit, drops what is too late.

A readout passes on so many events per microsecond. Events that come faster wait in line and carry the time at which
they were read, as real sensors stamp them; one that would wait longer than the limit is lost, and counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from core.jit import njit
from core.simulation.sensor.noise import MergedEvents
from core.simulation.sensor.sensor import SensorConfig


@dataclass(frozen=True, slots=True)
class ReadoutCounts:
    """What the readout did to the events so far."""

    passed: int = 0
    delayed: int = 0
    """Stamped a microsecond or more after they happened."""
    dropped: int = 0
    longest_us: int = 0
    """The longest wait of an event that was not dropped."""

    def plus(self, later: ReadoutCounts) -> ReadoutCounts:
        """The counts of both together."""
        longest_us = max(self.longest_us, later.longest_us)
        delayed, dropped = self.delayed + later.delayed, self.dropped + later.dropped
        return ReadoutCounts(self.passed + later.passed, delayed, dropped, longest_us)


class Readout:
    """The queue of one sensor. Blocks of events go in by time and come out with the times at which they are read."""

    def __init__(self) -> None:
        self.counts = ReadoutCounts()
        self._free_us = -np.inf
        empty = np.empty(0, np.int64)
        self._waiting = MergedEvents(empty, empty.astype(np.uint16), empty.astype(np.uint16), empty.astype(np.bool_))

    def pass_on(self, events: MergedEvents, end_us: int, config: SensorConfig) -> MergedEvents:
        """Those of the earlier blocks and of this one that are read before `end_us`; the others wait."""
        stamps = np.empty(len(events.t_us), np.int64)
        each_us, limit_us = 1.0 / config.readout_mevps, config.readout_limit_us
        self._free_us, delayed, dropped, longest = _queue(events.t_us, each_us, limit_us, self._free_us, stamps)
        counts = self.counts
        self.counts = ReadoutCounts(
            counts.passed + len(stamps) - dropped,
            counts.delayed + delayed,
            counts.dropped + dropped,
            max(counts.longest_us, longest),
        )
        if not delayed and not dropped and not len(self._waiting.t_us):
            return events
        kept = stamps >= 0
        waiting = self._waiting
        t = np.concatenate([waiting.t_us, stamps[kept]])
        x, y = np.concatenate([waiting.x_px, events.x_px[kept]]), np.concatenate([waiting.y_px, events.y_px[kept]])
        on = np.concatenate([waiting.on, events.on[kept]])
        now = int(np.searchsorted(t, end_us))
        self._waiting = MergedEvents(t[now:], x[now:], y[now:], on[now:])
        return MergedEvents(t[:now], x[:now], y[:now], on[:now])


@njit
def _queue(t_us, each_us, limit_us, free_us, stamps):
    """Write the times at which events are read, -1 for a lost one; (free again, delayed, dropped, longest wait)."""
    delayed = dropped = longest = 0
    for index in range(len(t_us)):
        read_us = max(float(t_us[index]), free_us)
        stamp = int(read_us)
        wait = stamp - t_us[index]
        if wait > limit_us:
            stamps[index] = -1
            dropped += 1
            continue
        stamps[index] = stamp
        delayed += wait > 0
        longest = max(longest, wait)
        free_us = read_us + each_us
    return free_us, delayed, dropped, longest
