"""Performance of a live player: steps per second, share of a core, latencies."""

from __future__ import annotations

import time
from collections import deque
from typing import Final

import numpy as np

from core.live.live_snapshot import Percentiles, PlayerHealth

SPAN_S: Final = 2.0
EVERY_S: Final = 0.25
"""Percentiles are computed so often."""
SAMPLES: Final = 500
NOTHING: Final = Percentiles(float("nan"), float("nan"))
NO_HEALTH: Final = PlayerHealth(0.0, 0.0, NOTHING, NOTHING, NOTHING, 0, "", 0, 0)


def percentiles(values_ms: deque[float]) -> Percentiles:
    """Median and 99th percentile."""
    if not values_ms:
        return NOTHING
    p50, p99 = np.percentile(list(values_ms), (50, 99))
    return Percentiles(float(p50), float(p99))


class LiveMeter:
    """Counters, each written by one thread; slightly late reads are harmless."""

    def __init__(self) -> None:
        self._step_ms: deque[float] = deque(maxlen=SAMPLES)
        self.arrival_to_sent_ms: deque[float] = deque(maxlen=SAMPLES)
        self.window_to_sent_ms: deque[float] = deque(maxlen=SAMPLES)
        self.sent = self.blocks = self.dropped = 0
        self.last_refusal = ""
        self._steps = 0
        self._marks: deque[tuple[float, float, int]] = deque()
        self._made_s = 0.0
        self._health = NO_HEALTH

    def note_step(self, seconds: float) -> None:
        """A step of chain and controller took so long."""
        self._steps += 1
        self._step_ms.append(1e3 * seconds)

    def note_block(self) -> None:
        """A block was played."""
        self.blocks += 1

    def health(self) -> PlayerHealth:
        """The figures; called by the player's own thread, whose time on the processor it takes."""
        now_s = time.monotonic()
        if now_s - self._made_s < EVERY_S:
            return self._health
        self._made_s = now_s
        self._marks.append((now_s, time.thread_time(), self._steps))
        while len(self._marks) > 2 and now_s - self._marks[1][0] > SPAN_S:
            self._marks.popleft()
        then, last = self._marks[0], self._marks[-1]
        wall_s = max(last[0] - then[0], 1e-9)
        known = len(self._marks) > 1
        self._health = PlayerHealth(
            state_hz=(last[2] - then[2]) / wall_s if known else 0.0,
            core_share=(last[1] - then[1]) / wall_s if known else 0.0,
            step=percentiles(self._step_ms),
            arrival_to_sent=percentiles(self.arrival_to_sent_ms.copy()),
            window_to_sent=percentiles(self.window_to_sent_ms.copy()),
            commands_sent=self.sent,
            last_refusal=self.last_refusal,
            blocks=self.blocks,
            blocks_dropped=self.dropped,
        )
        return self._health
