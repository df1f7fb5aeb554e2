"""A live source combined with an external robot, as one live source.

The session's times become the robot's by two comparisons: the session's with this machine's clock, by when blocks
arrive, and this machine's with the robot's, by pings. What the robot tells of its racket joins the source's states.
"""

from __future__ import annotations

import dataclasses
import threading
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from core.chain.control.hit_choice import RacketReach
from core.errors import LinkError
from core.live.link import messages as m
from core.live.link.live_source import LinkListener, LinkListeners, LiveSource, SourceStatus
from core.physics.config import PhysicsConfig
from core.robot.motion_check import reach_of
from core.robot.robot_client import RobotClient, host_us
from core.simulation.event_cameras.event_camera import BLOCK_US

SPAN_US: Final = 1_000_000
"""What arrived in this time is remembered. A block comes late, never early: the quickest one counts."""


class SessionClock:
    """Clock of one session; written by one thread, read by any."""

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
        """Our clock at a session time; None before the first block."""
        return None if self._gap_us is None else t_us + self._gap_us

    def session_us(self, host_us: float) -> float | None:
        """Inverse of `host_us`."""
        return None if self._gap_us is None else host_us - self._gap_us


REAL_TIME: float = 1.0


class SourceWithRobot:
    """A LiveSource with an external robot. It closes both."""

    def __init__(self, source: LiveSource, robot: RobotClient) -> None:
        """Attach to the source.

        Raises:
            LinkError: if the source has a robot of its own.
        """
        if source.robot is not None:
            raise LinkError("the source has a robot of its own", got=source.description, remedy="leave out --robot")
        self._source, self._client = source, robot
        self._lock = threading.Lock()
        self._listeners = LinkListeners()
        self._clock, self._reported_us = SessionClock(), 0
        self._welcome, self._state = source.welcome, source.state
        source.add_listener(self)

    @property
    def description(self) -> str:
        """The source's."""
        return self._source.description

    @property
    def welcome(self) -> m.Reply:
        """Welcome message of the session that listeners know."""
        return self._welcome

    @property
    def robot(self) -> SourceWithRobot:
        """Takes targets at times of the session."""
        return self

    @property
    def has_outcomes(self) -> bool:
        """Value of the source."""
        return self._source.has_outcomes

    @property
    def physics(self) -> PhysicsConfig | None:
        """Value of the source."""
        return self._source.physics

    @property
    def status(self) -> SourceStatus:
        """The source's; the robot has one of its own."""
        return self._source.status

    @property
    def state(self) -> m.WorldState | None:
        """The latest, with the racket."""
        return self._state

    @property
    def behind_s(self) -> float:
        """Value of the source."""
        return self._source.behind_s

    def add_listener(self, listener: LinkListener) -> None:
        """Add a listener; it gets the present session at once."""
        with self._lock:
            self._listeners.add(listener, self._welcome)

    def remove_listener(self, listener: LinkListener) -> None:
        """Remove a listener."""
        with self._lock:
            self._listeners.remove(listener)

    def listen(self, listening: bool) -> None:
        """Pass it to the source; the robot is always heard.

        The session's time stands still during a pause, so that its clock is compared anew after each.
        """
        with self._lock:
            self._clock = SessionClock()
        self._source.listen(listening)

    def close(self) -> None:
        """Stop the robot and close source and robot."""
        self._client.close()
        self._source.close()

    @property
    def reach(self) -> RacketReach | None:
        """The robot's limits; None before it said them."""
        limits = self._client.status.limits
        return None if limits is None else reach_of(limits)

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
            cameras: names of the cameras that the answer behind it is made of.

        Raises:
            LinkError: if it does not leave, or the robot does not take it, or does not say.
        """
        state, impact_us = self._state, self._clock.host_us(t_us)
        if state is None or impact_us is None:
            raise self._client.reject_locally("lost", "nothing has been heard of the source yet")
        if state.paused or state.speed_factor * state.kept_share != REAL_TIME:
            raise self._client.reject_locally("lost", "the source does not run in real time, and a robot does")
        self._client.aim(p_m, q_wxyz, v_mps, impact_us, cameras=cameras)
        taken_us = max(0, round(self._clock.session_us(host_us()) or 0))
        return m.Reply(id=0, ok=True, session=self._welcome.session, t_us=taken_us, block_us=BLOCK_US)

    # Callbacks of the source, in its thread.

    def on_session(self, welcome: m.Reply) -> None:
        """Reset the clock for a new session."""
        with self._lock:
            self._welcome, self._clock = welcome, SessionClock()
            self._listeners.on_session(welcome)

    def on_events(self, batch: m.EventBatch) -> None:
        """Hand it on."""
        with self._lock:
            self._listeners.on_events(batch)

    def on_picture(self, picture: m.PictureMessage) -> None:
        """Hand it on."""
        with self._lock:
            self._listeners.on_picture(picture)

    def on_state(self, state: m.WorldState) -> None:
        """Pass on the state with the robot's racket poses."""
        if state.ends_block:
            self._clock.add(state.t_us, host_us())
            state = self._with_racket(state)
        with self._lock:
            self._listeners.on_state(state)
            self._state = state

    def on_notice(self, notice: m.Notice) -> None:
        """Hand it on."""
        with self._lock:
            self._listeners.on_notice(notice)

    def _with_racket(self, state: m.WorldState) -> m.WorldState:
        """The state with rows of what has been heard of the racket since the last block, at times within this one."""
        states, offset = self._client.states_since(self._reported_us), self._client.status.clock
        if not states or offset is None:
            return state
        self._reported_us = states[-1].t_us
        states = states[-m.MAX_ROWS :]
        at_us = np.array([self._clock.session_us(offset.host_us(one.t_us)) for one in states])
        t_us = np.maximum.accumulate(np.clip(at_us, state.start_us, state.t_us - 1).astype(np.int64))
        racket = np.array([(*one.p_m, *one.q_wxyz, *one.v_mps) for one in states])
        return dataclasses.replace(state, racket_t_us=t_us, racket=racket)
