"""Reads one camera in a thread of its own, and buffers its events."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from core.devices.camera_device import CameraDevice, CameraPacket
from core.devices.clock_fit import ClockFit
from core.errors import DeviceError, EventsError, RallyscopeError
from core.events import Events, concatenate_events

logger = logging.getLogger(__name__)

MAX_EVENTS: Final = 10_000_000
"""Most buffered events; older ones are dropped."""
RATE_S: Final = 1.0
QUIET_S: Final = 0.5
"""A camera that sent nothing for this long, not even the time, is not waited for."""


@dataclass(frozen=True, slots=True)
class FeedCounts:
    """Counts of one camera since it was opened."""

    events: int = 0
    packets_dropped: int = 0
    """USB packets dropped before they were read; their number of events is unknown."""
    gaps: int = 0
    """Gaps in the stream."""
    events_given_up: int = 0
    """Events dropped because they came too late or the buffer was full."""
    packets_refused: int = 0
    """Packets with events out of order or off the sensor."""


class CameraFeed:
    """Packets of one camera, which it owns and closes. Times are on the camera's clock."""

    def __init__(self, name: str, device: CameraDevice, changed: threading.Condition) -> None:
        """Start reading; `changed` is notified at every packet."""
        self.name, self.device = name, device
        self.clock = ClockFit()
        self.problem: DeviceError | None = None
        """Why the camera was lost; empty while it is there."""
        self.complete_us = 0
        """All events before this time have arrived."""
        self.since_us: int | None = None
        """Time from which events are buffered; None before the first packet."""
        self._changed = changed
        self._waiting: deque[Events] = deque()
        self._events_waiting = 0
        self._last_us = 0
        self._counts = dict.fromkeys(FeedCounts.__dataclass_fields__, 0)
        self._quiet_s = 0.0
        self._marks: deque[tuple[float, int]] = deque([(time.monotonic(), 0)])
        """When packets came, and how many events there were by then: the rate is of the last `RATE_S`."""
        self._stop = False
        self._thread = threading.Thread(target=self._run, name=f"camera-{name}", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> FeedCounts:
        """Counts of received and lost data."""
        with self._changed:
            return FeedCounts(**self._counts)

    @property
    def awaited(self) -> bool:
        """Whether more may come soon. A pause of this whole machine is no silence: only waiting counts."""
        return self.problem is None and self._quiet_s < QUIET_S

    @property
    def rate_hz(self) -> float:
        """Recent event rate, Hz."""
        with self._changed:
            then_s, then = self._marks[0]
            now_s = time.monotonic()
            return (self._counts["events"] - then) / max(now_s - then_s, 1e-3)

    def wait_more(self, seconds: float) -> None:
        """Somebody has waited for it; it begins to count again when something comes. The caller holds the condition."""
        self._quiet_s += seconds

    def take(self, start_us: int, end_us: int) -> Events:
        """Take the events of an interval; older ones are dropped. The caller holds the condition."""
        taken: list[Events] = []
        while self._waiting:
            part = self._waiting.popleft()
            self._events_waiting -= len(part)
            if len(part) and part.t_us[-1] >= end_us:
                later = part.between(end_us, int(part.t_us[-1]) + 1)
                self._waiting.appendleft(later)
                self._events_waiting += len(later)
                part = part.between(int(part.t_us[0]), end_us)
                if len(part):
                    taken.append(part)
                break
            taken.append(part)
        found = concatenate_events([part for part in taken if len(part)], self.device.model.sensor)
        late = int(np.searchsorted(found.t_us, start_us))
        self._counts["events_given_up"] += late
        self.since_us = max(end_us, self.since_us or end_us)
        return found.rows(slice(late, None))

    def forget(self, before_us: int) -> None:
        """Drop older events without counting a loss. The caller holds the condition."""
        if self.since_us is None:
            return
        given_up = self._counts["events_given_up"]
        self.take(before_us, before_us)
        self._counts["events_given_up"] = given_up

    def close(self) -> None:
        """Stop the thread, which closes the camera."""
        self._stop = True
        self._thread.join()

    # Its own thread.

    def _run(self) -> None:
        try:
            while not self._stop:
                packet = self.device.read()
                if packet is not None:
                    self._hear(packet)
        except DeviceError as error:
            self.problem = error
            logger.info("camera %s: %s", self.name, error)
        except Exception:
            logger.exception("camera %s failed", self.name)
            self.problem = DeviceError("this is a bug; the terminal shows where", where=self.name)
        finally:
            _quietly(self.device.close)
            with self._changed:
                self._changed.notify_all()

    def _hear(self, packet: CameraPacket) -> None:
        events = self._events(packet)
        self.clock.add(packet.stamp_us, packet.host_s * 1e6)
        with self._changed:
            counts = self._counts
            counts["packets_dropped"] = packet.packets_dropped
            counts["gaps"] += packet.gap
            received_s, self._quiet_s = time.monotonic(), 0.0
            if self.since_us is None:
                self.since_us = packet.stamp_us if not len(events) else min(int(events.t_us[0]), packet.stamp_us)
            if len(events):
                counts["events"] += len(events)
                self._waiting.append(events)
                self._events_waiting += len(events)
            while self._events_waiting > MAX_EVENTS and len(self._waiting) > 1:
                oldest = self._waiting.popleft()
                self._events_waiting -= len(oldest)
                counts["events_given_up"] += len(oldest)
            self.complete_us = max(self.complete_us, packet.complete_us)
            self._marks.append((received_s, counts["events"]))
            while len(self._marks) > 2 and received_s - self._marks[1][0] > RATE_S:
                self._marks.popleft()
            self._changed.notify_all()

    def _events(self, packet: CameraPacket) -> Events:
        """Columns of the packet's rows, none if they make no sense."""
        sensor, rows = self.device.model.sensor, packet.events
        if rows is None or not len(rows):
            return Events.empty(sensor)
        try:
            found = Events.from_columns(rows["t"].astype(np.int64), rows["x"], rows["y"], rows["on"], sensor)
            if found.t_us[0] < self._last_us:
                raise EventsError("a packet begins before the last one ended")
        except EventsError as error:
            logger.info("a packet of camera %s cannot be used: %s", self.name, error)
            with self._changed:
                self._counts["packets_refused"] += 1
            return Events.empty(sensor)
        self._last_us = int(found.t_us[-1])
        return found


def _quietly(act: Callable[[], None]) -> None:
    try:
        act()
    except (RuntimeError, RallyscopeError) as error:
        logger.info("a camera was not closed: %s", error)
