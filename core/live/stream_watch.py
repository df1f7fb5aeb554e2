"""Health of a live source, from its blocks: their rate, and what is missing of each camera."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from core.live.link import messages as m

SPAN_S: Final = 2.0
LOST_US: Final = 500_000
"""A camera missing for this long, in the source's time, counts as lost."""
SILENT_US: Final = 1_000_000
"""Time without any event after which a camera counts as silent; it always has some noise."""
STOPPED_S: Final = 1.0
"""Time without data after which a source counts as stopped, unless its speed is set that low."""
STOPPED_BLOCKS: Final = 3


@dataclass(frozen=True, slots=True)
class CameraHealth:
    """Health of one camera since the session began."""

    name: str
    blocks_missing: int
    """Blocks without a packet of this camera."""
    absent_us: int
    """Time since its last packet; 0 if the newest block had one."""
    silent_us: int
    """Time since its last event."""

    @property
    def lost(self) -> bool:
        """Whether it has sent nothing for LOST_US."""
        return self.absent_us >= LOST_US

    @property
    def silent(self) -> bool:
        """Whether its packets have been empty for SILENT_US."""
        return not self.lost and self.silent_us >= SILENT_US


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """Health of a live source."""

    pace: float | None
    """Source seconds per wall second, over the last 2 s; None while unknown."""
    quiet_s: float
    """Wall time since the last block or sign of life, or since it was first listened to."""
    stopped: bool
    """Whether the source has stopped."""
    blocks_lost: int
    """Blocks that never came, of this session: there was a gap between two."""
    cameras: tuple[CameraHealth, ...]


@dataclass(slots=True)
class _CameraCounts:
    seen_us: int
    """End of its last packet."""
    event_us: int
    """End of its last packet with an event."""
    missing: int = 0


class StreamWatch:
    """A LinkListener that counts. Safe to read from several threads."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._names: tuple[str, ...] = ()
        self._rests = False
        self._begin()

    def rest(self) -> None:
        """Nobody listens from now on: a source that sends nothing has not stopped, until `wake`."""
        with self._lock:
            self._rests = True

    def wake(self) -> None:
        """Restart the watch after a pause without listeners: what was sent meanwhile is not lost."""
        with self._lock:
            self._received_s = self._clock()
            self._marks.clear()
            self._rests, self._woken = False, True

    def health(self) -> StreamHealth:
        """The figures now."""
        with self._lock:
            cameras = tuple(
                CameraHealth(name, one.missing, self._t_us - one.seen_us, self._t_us - one.event_us)
                for name, one in self._cameras.items()
            )
            quiet_s = 0.0 if self._rests else self._clock() - self._received_s
            return StreamHealth(self._pace(), quiet_s, quiet_s >= self._patience_s, self._lost, cameras)

    def on_session(self, welcome: m.Reply) -> None:
        """Begin anew."""
        with self._lock:
            self._names = tuple(info.name for info in welcome.cameras)
            self._begin()

    def on_events(self, batch: m.EventBatch) -> None:
        """A packet of a camera."""
        with self._lock:
            if batch.camera in self._names:
                self._packets[batch.camera] = len(batch.since_us) > 0

    def on_state(self, state: m.WorldState) -> None:
        """A block is over, or the source lives."""
        with self._lock:
            now_s = self._clock()
            self._received_s = now_s
            if not state.ends_block:
                return
            if state.speed_factor:
                blocks_s = STOPPED_BLOCKS * (state.t_us - state.start_us) * 1e-6 / state.speed_factor
                self._patience_s = max(STOPPED_S, blocks_s)
            if not self._cameras:
                self._cameras = {name: _CameraCounts(state.start_us, state.start_us) for name in self._names}
            elif state.start_us > self._t_us and not self._woken:
                self._lost += (state.start_us - self._t_us) // (state.t_us - state.start_us)
            if self._woken:  # no camera was absent or silent while nobody listened
                for one in self._cameras.values():
                    one.seen_us, one.event_us = state.start_us, state.start_us
            self._woken = False
            self._t_us = state.t_us
            self._marks.append((now_s, state.t_us))
            while len(self._marks) > 2 and now_s - self._marks[1][0] > SPAN_S:
                self._marks.popleft()
            for name, one in self._cameras.items():
                if name not in self._packets:
                    one.missing += 1
                    continue
                one.seen_us = state.t_us
                if self._packets[name]:
                    one.event_us = state.t_us
            self._packets.clear()

    def on_notice(self, notice: m.Notice) -> None:
        """Nothing to count."""

    def _begin(self) -> None:
        self._cameras: dict[str, _CameraCounts] = {}
        self._packets: dict[str, bool] = {}
        """Current block: camera -> whether there are events in it."""
        self._marks: deque[tuple[float, int]] = deque()
        self._t_us = self._lost = 0
        self._woken = False
        self._patience_s = STOPPED_S
        self._received_s = self._clock()

    def _pace(self) -> float | None:
        if len(self._marks) < 2:
            return None
        (from_s, from_us), (to_s, to_us) = self._marks[0], self._marks[-1]
        return (to_us - from_us) * 1e-6 / (to_s - from_s) if to_s - from_s > 0.25 * SPAN_S else None
