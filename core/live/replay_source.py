"""A recording as a live source: its cameras' events and pictures in blocks, and nothing else.

After the end it begins again from its start, unless it plays once, and the time of the session runs on, by whole
blocks: what is recorded or frozen of it goes over the seam. While nobody listens it stands still.
"""

from __future__ import annotations

import dataclasses
import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from core.cameras import Camera
from core.errors import ConfigError, RallyscopeError, RecordingError
from core.events import Events
from core.live.link import messages as m
from core.live.link.live_source import LinkListener, LinkListeners, SourceStatus
from core.live.link.published import camera_batch, state_of_block, welcome_to
from core.physics.config import PhysicsConfig
from core.recordings import CameraStream, Recording
from core.recordings.frames import frames_of
from core.simulation.event_cameras.event_camera import BLOCK_US

logger = logging.getLogger(__name__)

SPEEDS: Final = (0.01, 20.0)
LATE_S: Final = 0.1
"""A delay above this is given up; a smaller one is caught up."""


class ReplaySource:
    """A LiveSource without robot, outcomes and truth. It owns the recording and closes it."""

    robot = None
    has_outcomes = False

    def __init__(
        self,
        recording: Recording,
        name: str,
        *,
        speed: float = 1.0,
        loop: bool = True,
        longest_us: int = m.LONGEST_US,
        clock: Callable[[], float] = time.monotonic,
        physics: PhysicsConfig | None = None,
    ) -> None:
        """Begin as soon as somebody listens; a session that has come to `longest_us` is followed by another.

        Without `loop` it ends after the last block, and its status is "lost".

        Args:
            recording: what is played.
            name: of it, for messages.
            speed: times real time.
            loop: whether it begins again.
            longest_us: length after which a session ends.
            clock: wall time, s.
            physics: of the rally, if known; the built-in controller takes the racket's rubber from it.

        Raises:
            ConfigError: if the speed is not in SPEEDS.
            RecordingError: if the recording has no cameras, or nothing happens in it.
        """
        check_speed(speed)
        if not recording.cameras:
            raise RecordingError("a recording without cameras cannot be replayed", where=name)
        if recording.duration_us < 1:
            raise RecordingError("an empty recording cannot be replayed", where=name)
        self.description = f"replay of {name}"
        self.state: m.WorldState | None = None
        self.physics = physics
        self.behind_s = 0.0
        self._recording, self._cameras, self._speed = recording, dict(recording.cameras), speed
        self._frames = {name: one for name, one in frames_of(recording).items() if len(one)}
        self._loop = loop
        # Rounded up: the last block of a loop may be short.
        self._blocks_per_loop = -(-recording.duration_us // BLOCK_US)
        self._longest_us, self._clock = longest_us, clock
        self._changed = threading.Condition()
        self._listeners = LinkListeners()
        self._listening, self._stop, self._recalibrated = True, False, False
        self._calibration = {name: one.calibration for name, one in (self._frames | self._cameras).items()}
        self._numbers = self._picture_numbers = 0
        self.welcome = self._new_session()
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)
        self._thread.start()

    @property
    def status(self) -> SourceStatus:
        """Lost only at its end or after a failure of its own: what cannot be read of a camera is that camera's loss."""
        return "connected" if self._thread.is_alive() else "lost"

    def recalibrate(self, cameras: Mapping[str, Camera]) -> None:
        """Replace calibrations; it restarts in a new session. Other cameras are unchanged."""
        with self._changed:
            self._calibration |= dict(cameras)
            self._recalibrated = True

    def add_listener(self, listener: LinkListener) -> None:
        """Add a listener; it gets the present session at once."""
        with self._changed:
            self._listeners.add(listener, self.welcome)
            self._changed.notify_all()

    def remove_listener(self, listener: LinkListener) -> None:
        """Remove a listener."""
        with self._changed:
            self._listeners.remove(listener)

    def listen(self, listening: bool) -> None:
        """Play, or pause."""
        with self._changed:
            self._listening = listening
            self._changed.notify_all()

    def close(self) -> None:
        """Stop, and close the recording."""
        with self._changed:
            self._stop = True
            self._changed.notify_all()
        self._thread.join()
        self._recording.close()

    # Its own thread.

    def _run(self) -> None:
        try:
            number = 0
            while True:
                since_s, begun = self._clock(), number
                while self._wait_until(since_s + (number + 1 - begun) * BLOCK_US * 1e-6 / self._speed):
                    if self._recalibrated or (number + 1) * BLOCK_US > self._longest_us:
                        self._begin_again()
                        since_s, begun, number = self._clock(), 0, 0
                        continue
                    self._publish(number)
                    number += 1
                    late_s = self._clock() - since_s - (number - begun) * BLOCK_US * 1e-6 / self._speed
                    if late_s > LATE_S:
                        self.behind_s += late_s
                        since_s += late_s
                    if not self._loop and number == self._blocks_per_loop:
                        return
                if self._stop:
                    return
        except Exception:
            logger.exception("the replay failed")

    def _wait_until(self, due_s: float) -> bool:
        """Whether the time has come while somebody listened; otherwise somebody listens again, or it is closed."""
        with self._changed:
            while self._attended() and not self._stop and (left_s := due_s - self._clock()) > 0:
                self._changed.wait(left_s)
            if self._attended() and not self._stop:
                return True
            self._changed.wait_for(lambda: self._stop or self._attended())
            return False

    def _attended(self) -> bool:
        return self._listening and bool(self._listeners)

    def _new_session(self) -> m.Reply:
        known = self._calibration
        return welcome_to(
            {name: (one.sensor, known[name]) for name, one in self._cameras.items()},
            {name: (one.sensor, known[name]) for name, one in self._frames.items()},
        )

    def _begin_again(self) -> None:
        with self._changed:
            self._recalibrated = False
            welcome = self._new_session()
            self.welcome, self._numbers, self._picture_numbers = welcome, 0, 0
            self._listeners.on_session(welcome)

    def _publish(self, number: int) -> None:
        """One block of all cameras that can be read, and the state that ends it."""
        session, start_us = self.welcome.session, number * BLOCK_US
        shift_us = number // self._blocks_per_loop * self._blocks_per_loop * BLOCK_US
        batches = []
        for name, stream in self._cameras.items():
            events = _read(stream, start_us - shift_us, shift_us)
            if events is not None:
                span_us = start_us, start_us + BLOCK_US
                batches.append(camera_batch(name, events, span_us, session, self._next()))
        pictures = list(self._pictures(start_us - shift_us, shift_us)) if self._listeners.want_pictures else []
        state = state_of_block(session, self._next(), (start_us, start_us + BLOCK_US), self._speed)
        with self._changed:
            for batch in batches:
                self._listeners.on_events(batch)
            for picture in pictures:
                self._listeners.on_picture(picture)
            self._listeners.on_state(state)
            self.state = state

    def _pictures(self, start_us: int, shift_us: int) -> Iterator[m.PictureMessage]:
        """Pictures whose exposure ends in the block that begins at `start_us` of the file, later by `shift_us`."""
        for name, stream in self._frames.items():
            for number in stream.ending_within(start_us, start_us + BLOCK_US):
                begins_us = int(stream.t_us[number] - stream.exposure_us[number] // 2)
                if shift_us and begins_us < 0:  # before the file began: it would overlap the end of the round before
                    continue
                try:
                    frame = stream.frame(number)
                except (RallyscopeError, OSError) as error:
                    logger.info("a picture of %s cannot be read: %s", name, error)
                    continue
                self._picture_numbers += 1
                later = dataclasses.replace(frame, t_us=frame.t_us + shift_us)
                yield m.PictureMessage.of(name, later, self.welcome.session, self._picture_numbers)

    def _next(self) -> int:
        self._numbers += 1
        return self._numbers


def check_speed(speed: float) -> None:
    """Check a replay speed.

    Raises:
        ConfigError: if it is not in SPEEDS.
    """
    low, high = SPEEDS
    if not low <= speed <= high:
        raise ConfigError("no such speed of a replay", expected=f"{low:g} to {high:g}", got=f"{speed:g}")


def _read(stream: CameraStream, start_us: int, shift_us: int) -> Events | None:
    """The block of a camera that begins at `start_us` of the file, later by `shift_us`; None if it cannot be read."""
    try:
        events = stream.slice(start_us, start_us + BLOCK_US)
    except (RallyscopeError, OSError) as error:
        logger.info("a block of %s cannot be read: %s", stream.name, error)
        return None
    return Events.from_columns(events.t_us + shift_us, events.x_px, events.y_px, events.on, events.sensor)
