"""Interface of a live source: cameras, and optionally a robot and outcomes of balls.

The simulation has all of it, a recording that is replayed only its cameras, ordinary ones among them. Whoever listens
takes what comes: the truth is in no source's duty, and nothing that is not told may be needed. Everything is told in
blocks: the packets of all cameras that have one, pictures whose exposure ended in it, then a state that ends the block.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol, runtime_checkable

from core.cameras import Camera
from core.chain.control.hit_choice import RacketReach
from core.live.link import messages as m
from core.physics.config import PhysicsConfig

SourceStatus = Literal["connected", "lost"]


class LinkListener(Protocol):
    """Receives everything in the source's own thread, in order. `on_session` is called first in a session."""

    def on_session(self, welcome: m.Reply) -> None: ...
    def on_events(self, batch: m.EventBatch) -> None: ...
    def on_state(self, state: m.WorldState) -> None: ...
    def on_notice(self, notice: m.Notice) -> None: ...


class Robot(Protocol):
    """Moves the racket; its pose is in the states."""

    def aim_racket(
        self,
        p_m: tuple[float, ...],
        q_wxyz: tuple[float, ...],
        v_mps: tuple[float, ...],
        t_us: int,
        cameras: Sequence[str] = (),
    ) -> m.Reply:
        """Send the middle of the racket's face to a pose with a velocity at a time of the session.

        Args:
            p_m: (3,) middle of the face, world.
            q_wxyz: (4,) its orientation in the world.
            v_mps: (3,) its velocity, world.
            t_us: time of the session at which it is to be so.
            cameras: names of the cameras that the answer behind it is made of, for a robot that wants to know.

        Raises:
            LinkError: if that is refused, or not answered in time.
        """
        ...


@runtime_checkable
class PictureListener(Protocol):
    """A listener that wants pictures of ordinary cameras too: those of a block come before the state that ends it."""

    def on_picture(self, picture: m.PictureMessage) -> None: ...


@runtime_checkable
class LimitedRobot(Protocol):
    """A robot that says how far and how fast it moves; for others balls are met at the paper's plane only."""

    @property
    def reach(self) -> RacketReach | None:
        """Its limits; None before it said them."""
        ...


@runtime_checkable
class RecalibratedSource(Protocol):
    """A source whose cameras can be recalibrated while it runs."""

    def recalibrate(self, cameras: Mapping[str, Camera]) -> None:
        """Replace calibrations; a new session begins with the next block. Other cameras are unchanged."""
        ...


class LiveSource(Protocol):
    """A source of events for listeners. Thread-safe."""

    @property
    def description(self) -> str:
        """Short description."""
        ...

    @property
    def welcome(self) -> m.Reply:
        """The present session: its cameras, with their calibrations if known."""
        ...

    @property
    def robot(self) -> Robot | None:
        """The robot; None if there is none, and states then have no racket rows."""
        ...

    @property
    def has_outcomes(self) -> bool:
        """Whether it reports outcomes of balls."""
        ...

    @property
    def physics(self) -> PhysicsConfig | None:
        """Known physics; None if unknown, and the chain learns it."""
        ...

    @property
    def status(self) -> SourceStatus:
        """Connection status."""
        ...

    @property
    def state(self) -> m.WorldState | None:
        """Latest state."""
        ...

    @property
    def behind_s(self) -> float:
        """Total wall time by which it is behind the requested speed, if it measures that."""
        ...

    def add_listener(self, listener: LinkListener) -> None:
        """Add a listener; it gets the present session at once."""
        ...

    def remove_listener(self, listener: LinkListener) -> None:
        """Remove a listener."""
        ...

    def listen(self, listening: bool) -> None:
        """Hear everything, or, where nobody needs it, only that the source is there: then it may rest."""
        ...

    def close(self) -> None:
        """Disconnect."""
        ...


class LinkListeners:
    """What it hears, all of them hear, in the order in which they came.

    The source keeps it under a lock of its own: nobody comes or goes while something is told.
    """

    def __init__(self) -> None:
        self._all: list[LinkListener] = []

    def __bool__(self) -> bool:
        """Whether there is a listener."""
        return bool(self._all)

    def add(self, listener: LinkListener, welcome: m.Reply) -> None:
        """Add a listener; it gets the present session at once."""
        listener.on_session(welcome)
        self._all.append(listener)

    def remove(self, listener: LinkListener) -> None:
        """Remove a listener, if it is there."""
        if listener in self._all:
            self._all.remove(listener)

    def on_session(self, welcome: m.Reply) -> None:
        """Pass on a new session."""
        for listener in self._all:
            listener.on_session(welcome)

    def on_events(self, batch: m.EventBatch) -> None:
        """Pass on events."""
        for listener in self._all:
            listener.on_events(batch)

    @property
    def want_pictures(self) -> bool:
        """Whether one of them takes pictures."""
        return any(isinstance(listener, PictureListener) for listener in self._all)

    def on_picture(self, picture: m.PictureMessage) -> None:
        """Pass on a picture to those that take pictures."""
        for listener in self._all:
            if isinstance(listener, PictureListener):
                listener.on_picture(picture)

    def on_state(self, state: m.WorldState) -> None:
        """Pass on a state; it may end a block."""
        for listener in self._all:
            listener.on_state(state)

    def on_notice(self, notice: m.Notice) -> None:
        """Pass on a notice."""
        for listener in self._all:
            listener.on_notice(notice)
