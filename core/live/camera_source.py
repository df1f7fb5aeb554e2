"""Event cameras as a live source: what each saw, on one clock, in blocks.

The time of the session is the first camera's own clock, from a whole block of it on: its stamps are never bent. Those
of the other cameras are shifted to it, unless a sync cable makes them the same. A block is told as soon as all have
said that they are past it; one that sends nothing, or is gone, is missing in that block.
While nobody listens the time of the session stands still, and the cameras' events are forgotten.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from core.cameras import Camera
from core.devices import CameraDevice, ClockEstimate
from core.devices.camera_feed import CameraFeed, FeedCounts
from core.devices.clock_fit import ClockShift
from core.errors import DeviceError
from core.events import Events
from core.live.link import messages as m
from core.live.link.live_source import LinkListener, LinkListeners, SourceStatus
from core.live.link.published import camera_batch, state_of_block, welcome_to
from core.physics.config import PhysicsConfig
from core.simulation.event_cameras.event_camera import BLOCK_US

logger = logging.getLogger(__name__)

PATIENCE_S: Final = 1.0
"""Longest wait for a camera that sends but has not reached the end of a block; then it is not waited for until it
has."""
WAIT_S: Final = 0.02
SETTLE_US: Final = 1_000_000
"""Clocks are watched for so long before the session begins; then the shifts between them are known."""
BEHIND_US: Final = 5_000_000
"""Backlog from which the oldest blocks are skipped."""
RESTING_US: Final = 100_000
"""Length of the past that is kept while there is no listener."""

_Ends = list[int | None]
"""End of a block on each camera's clock; None if unknown."""


@dataclass(frozen=True, slots=True)
class CameraReport:
    """Status of one camera."""

    name: str
    serial: str
    model: str
    counts: FeedCounts
    rate_hz: float
    clock: ClockEstimate | None
    """Its clock against this machine's."""
    clock_restarts: int
    problem: str
    """Why it was lost; empty while it is there."""


class CameraSource:
    """A LiveSource over one or more open cameras, which are its own and are closed with it."""

    robot = None
    has_outcomes = False
    behind_s = 0.0

    def __init__(
        self,
        devices: Mapping[str, CameraDevice],
        *,
        calibration: Mapping[str, Camera] | None = None,
        cable: bool = False,
        longest_us: int = m.LONGEST_US,
        behind_us: int = BEHIND_US,
        physics: PhysicsConfig | None = None,
    ) -> None:
        """Begin to read the cameras, by their names in the session; the first one's clock is the session's.

        `cable`: a sync cable gives the other cameras the first one's clock. `physics`: of the rally, if known; the
        built-in controller takes the racket's rubber from it.

        Raises:
            DeviceError: if there are none.
        """
        if not devices:
            raise DeviceError("no cameras", expected="one or more")
        names = " and ".join(f"{device.model.name} {device.serial}" for device in devices.values())
        self.description = f"live from {names}"
        self.state: m.WorldState | None = None
        self.physics = physics
        self.cable = cable
        self.blocks_skipped = 0
        """Blocks skipped because a listener was too slow."""
        self._calibration, self._longest_us, self._behind_us = dict(calibration or {}), longest_us, behind_us
        self._changed, self._telling = threading.Condition(), threading.RLock()
        self._feeds = [CameraFeed(name, device, self._changed) for name, device in devices.items()]
        self._shifts = [ClockShift()] + [
            ClockShift() if cable else ClockShift(feed.clock, self._feeds[0].clock) for feed in self._feeds[1:]
        ]
        self._taken_us: list[int | None] = [None] * len(self._feeds)
        """End of the last block on each camera's clock; None if it was missing."""
        self._waited_s = [0.0] * len(self._feeds)
        """Time since each camera was last past the end of a block, s."""
        self._zero_us: int | None = None
        """First camera's clock at the session's time 0."""
        self._listeners = LinkListeners()
        self._listening, self._stop, self._recalibrated = True, False, False
        self._seq = self._block = 0
        self.welcome = self._new_session()
        self._thread = threading.Thread(target=self._run, name="cameras", daemon=True)
        self._thread.start()

    @property
    def status(self) -> SourceStatus:
        """Connection status: lost when all cameras are."""
        gone = all(feed.problem is not None for feed in self._feeds)
        return "lost" if gone or not self._thread.is_alive() else "connected"

    @property
    def devices(self) -> dict[str, CameraDevice]:
        """The cameras by name, to set their biases."""
        return {feed.name: feed.device for feed in self._feeds}

    def reports(self) -> tuple[CameraReport, ...]:
        """Status of the cameras."""
        return tuple(
            CameraReport(
                feed.name, feed.device.serial, feed.device.model.name, feed.counts, feed.rate_hz,
                feed.clock.estimate, feed.clock.restarts, "" if feed.problem is None else str(feed.problem),
            )
            for feed in self._feeds
        )  # fmt: skip

    def recalibrate(self, cameras: Mapping[str, Camera]) -> None:
        """Replace calibrations; a new session begins with the next block. Other cameras are unchanged."""
        with self._telling:
            self._calibration |= dict(cameras)
            self._recalibrated = True

    def add_listener(self, listener: LinkListener) -> None:
        """Add a listener; it gets the present session at once."""
        with self._telling:
            self._listeners.add(listener, self.welcome)

    def remove_listener(self, listener: LinkListener) -> None:
        """Remove a listener."""
        with self._telling:
            self._listeners.remove(listener)

    def listen(self, listening: bool) -> None:
        """Publish the cameras' events, or drop them."""
        with self._changed:
            self._listening = listening
            self._changed.notify_all()

    def close(self) -> None:
        """Stop the threads and close the cameras."""
        with self._changed:
            self._stop = True
            self._changed.notify_all()
        self._thread.join()
        for feed in self._feeds:
            feed.close()

    # Its own thread.

    def _run(self) -> None:
        try:
            while not self._stop:
                with self._changed:
                    ends_us = self._wait()
                if ends_us is not None:
                    self._tell_block(ends_us)
        except Exception:
            logger.exception("the cameras cannot be followed")

    def _wait(self) -> _Ends | None:
        """End of the next block on each camera's clock, if it is complete; else call again soon."""
        if not (self._listening and self._listeners):
            for feed in self._feeds:
                feed.forget(feed.complete_us - RESTING_US)
            self._zero_us = None
            self._changed.wait(WAIT_S)
            return None
        if self._zero_us is None and not self._begin():
            any_started = any(feed.since_us is not None for feed in self._feeds)
            self._wait_for([any_started] * len(self._feeds))
            return None
        ends_us = self._skip(self._ends_us())
        if self.status == "lost":
            self._changed.wait(WAIT_S)
            return None
        # A camera that is silent is waited for at most PATIENCE_S, once: then the others go on without it.
        there = [
            end_us is not None and feed.complete_us >= end_us for feed, end_us in zip(self._feeds, ends_us, strict=True)
        ]
        for number, here in enumerate(there):
            self._waited_s[number] = 0.0 if here else self._waited_s[number]
        awaited = [
            not here and feed.awaited and waited_s < PATIENCE_S
            for feed, here, waited_s in zip(self._feeds, there, self._waited_s, strict=True)
        ]
        if any(awaited) or not (any(there) or self._is_over()):
            self._wait_for(awaited)
            return None
        return ends_us

    def _wait_for(self, awaited: list[bool]) -> None:
        began_s = time.monotonic()
        self._changed.wait(WAIT_S)
        passed_s = min(2.0 * WAIT_S, time.monotonic() - began_s)
        for number, feed in enumerate(self._feeds):
            if awaited[number]:
                feed.wait_more(passed_s)
                self._waited_s[number] += passed_s

    def _begin(self) -> bool:
        """Fix where the next block begins on the first camera's clock, as soon as all clocks are known."""
        first = self._feeds[0]
        if first.since_us is None or any(feed.since_us is None and feed.awaited for feed in self._feeds):
            return False
        since_us = first.since_us
        for feed, shift in zip(self._feeds[1:], self._shifts[1:], strict=True):
            if feed.since_us is None or not feed.awaited:
                continue
            if not self.cable and not all(_is_settled(one) for one in (first, feed)):
                for one in self._feeds:
                    one.forget(one.complete_us - RESTING_US)
                return False
            shift.settle()
            since_us = max(since_us, feed.since_us + (shift.shift_us(feed.since_us) or 0))
        begins_us = since_us // BLOCK_US * BLOCK_US
        self._zero_us = begins_us - self._block * BLOCK_US
        for feed, end_us in zip(self._feeds, self._ends_us(), strict=True):
            if end_us is not None:
                feed.forget(end_us - BLOCK_US)
        self._taken_us = [None] * len(self._feeds)
        self._waited_s = [0.0] * len(self._feeds)
        return True

    def _ends_us(self) -> _Ends:
        assert self._zero_us is not None
        end_us = self._zero_us + (self._block + 1) * BLOCK_US
        shifts_us = [shift.shift_us(feed.complete_us) for feed, shift in zip(self._feeds, self._shifts, strict=True)]
        return [None if shift_us is None else end_us - shift_us for shift_us in shifts_us]

    def _is_over(self) -> bool:
        """Whether the block is over by this machine's clock: time goes on, even if no camera says so."""
        estimate = self._feeds[0].clock.estimate
        if estimate is None or self._zero_us is None:
            return False
        end_us = self._zero_us + (self._block + 1) * BLOCK_US
        return (time.monotonic() - PATIENCE_S) * 1e6 > estimate.host_us(end_us)

    def _skip(self, ends_us: _Ends) -> _Ends:
        """Skip blocks that could not be published in time."""
        known = zip(self._feeds, ends_us, strict=True)
        waits_us = min((feed.complete_us - end_us for feed, end_us in known if end_us is not None), default=0)
        if waits_us <= self._behind_us:
            return ends_us
        count = waits_us // BLOCK_US
        self.blocks_skipped += count
        self._block += count
        self._taken_us = [None] * len(self._feeds)
        return [None if end_us is None else end_us + count * BLOCK_US for end_us in ends_us]

    def _tell_block(self, ends_us: _Ends) -> None:
        if self._recalibrated or (self._block + 1) * BLOCK_US > self._longest_us:
            self._begin_again()
            return
        session, start_us = self.welcome.session, self._block * BLOCK_US
        span_us = start_us, start_us + BLOCK_US
        with self._changed:
            taken = [self._take(number, end_us) for number, end_us in enumerate(ends_us)]
        batches = []
        for feed, events, end_us in zip(self._feeds, taken, ends_us, strict=True):
            if events is not None and end_us is not None:
                seen = _shifted(events, span_us[1] - end_us, start_us)
                batches.append(camera_batch(feed.name, seen, span_us, session, self._next()))
        state = state_of_block(session, self._next(), span_us, 1.0)
        with self._telling:
            for batch in batches:
                self._listeners.on_events(batch)
            self._listeners.on_state(state)
            self.state = state
        self._block += 1

    def _take(self, number: int, end_us: int | None) -> Events | None:
        """The events of a camera up to a time of its own clock; None if it is missing."""
        feed, known_us = self._feeds[number], self._taken_us[number]
        missing = end_us is None or feed.complete_us < end_us
        self._taken_us[number] = None if missing else end_us
        if missing or end_us is None:
            return None
        return feed.take(end_us - BLOCK_US if known_us is None else known_us, end_us)

    def _new_session(self) -> m.Reply:
        known = self._calibration
        return welcome_to({feed.name: (feed.device.model.sensor, known.get(feed.name)) for feed in self._feeds})

    def _begin_again(self) -> None:
        assert self._zero_us is not None
        self._zero_us += self._block * BLOCK_US
        self._block = self._seq = 0
        with self._telling:
            self._recalibrated = False
            self.welcome = self._new_session()
            self._listeners.on_session(self.welcome)

    def _next(self) -> int:
        self._seq += 1
        return self._seq


def _is_settled(feed: CameraFeed) -> bool:
    """Whether its clock is known well enough."""
    estimate = feed.clock.estimate
    return estimate is not None and (estimate.span_us >= SETTLE_US or not feed.awaited)


def _shifted(events: Events, shift_us: int, start_us: int) -> Events:
    """Times on the session's clock, at least `start_us`, as the shift may have shrunk since the last block."""
    rows = slice(0, m.MAX_EVENTS)
    t_us = np.maximum(events.t_us[rows] + shift_us, start_us)
    return Events.from_columns(t_us, events.x_px[rows], events.y_px[rows], events.on[rows], events.sensor)
