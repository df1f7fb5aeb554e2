"""What a live rally comes from: cameras, and where there are some a robot, and word of what became of balls.

The simulation has all of it, a recording that is replayed only its cameras. Whoever listens takes what comes: the truth
is in no source's duty, and nothing that is not told may be needed. Everything is told in blocks: the packets of all
cameras that have one, then a state that ends the block.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Protocol, runtime_checkable

from core.cameras import Camera
from core.live.link import messages as m
from core.physics.config import PhysicsConfig

SourceStatus = Literal["connected", "lost"]


class LinkListener(Protocol):
    """Hears everything in the source's own thread, in order. `on_session` comes before anything of a session."""

    def on_session(self, welcome: m.Reply) -> None: ...
    def on_events(self, batch: m.EventBatch) -> None: ...
    def on_state(self, state: m.WorldState) -> None: ...
    def on_notice(self, notice: m.Notice) -> None: ...


class Robot(Protocol):
    """What takes the racket somewhere; where it is stands in the states."""

    def aim_racket(
        self, p_m: tuple[float, ...], q_wxyz: tuple[float, ...], v_mps: tuple[float, ...], t_us: int
    ) -> m.Reply:
        """Send the middle of the racket's face to a pose with a velocity at a time of the session.

        Raises:
            LinkError: if that is refused, or not answered in time.
        """
        ...


@runtime_checkable
class RecalibratedSource(Protocol):
    """A source whose cameras may be calibrated while it runs. One that knows its cameras exactly is none."""

    def recalibrate(self, cameras: Mapping[str, Camera]) -> None:
        """These are its cameras from now on: a new session begins with the next block. Others stay as they are."""
        ...


class LiveSource(Protocol):
    """Cameras that are heard by listeners. Safe to use from any thread."""

    @property
    def description(self) -> str:
        """What it is, in a few words."""
        ...

    @property
    def welcome(self) -> m.Reply:
        """The present session: its cameras, with their calibration where that is known."""
        ...

    @property
    def robot(self) -> Robot | None:
        """None: there is none, and states have no rows of a racket."""
        ...

    @property
    def has_outcomes(self) -> bool:
        """Whether it says what became of balls."""
        ...

    @property
    def physics(self) -> PhysicsConfig | None:
        """How balls fly and bounce; None where nobody knows, and the chain finds out."""
        ...

    @property
    def status(self) -> SourceStatus:
        """Whether anything is to be heard of it."""
        ...

    @property
    def state(self) -> m.WorldState | None:
        """The latest."""
        ...

    @property
    def behind_s(self) -> float:
        """Wall time by which it has fallen behind the speed that was asked for, in all, where it lets that count."""
        ...

    def add_listener(self, listener: LinkListener) -> None:
        """From now on; it hears of the present session at once."""
        ...

    def remove_listener(self, listener: LinkListener) -> None:
        """It hears nothing after this."""
        ...

    def listen(self, listening: bool) -> None:
        """Hear everything, or, where nobody needs it, only that the source is there: then it may rest."""
        ...

    def close(self) -> None:
        """Hang up."""
        ...
