"""A simulation server as a backend of training: of an environment, where serve and racket commands go out and only
events come back, and of the one-step task, where it plays every ball.
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import CalibrationError, LinkError
from core.events import Events
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import ServeBatch, strokes_of
from core.live.link import messages as m
from core.live.link.client import HELLO_S, SimulationClient
from core.live.link.guard import ClientKeys
from core.outcomes.environment_backend import SeenBlock
from core.physics.episode import Outcomes
from core.simulation.episodes.ball_outcome import BallOutcome, outcomes_of
from core.simulation.episodes.racket import RacketConfig, RacketTarget, check_target, target_for_ball

Array = NDArray[np.float64]
PATIENCE_S: Final = 30.0
"""Longest wait for the events of one block, and for an answer to a command."""


class ServerWorld:
    """Steps the server block by block. Nobody else should command it meanwhile. `close` it.

    Ball rows, contacts, circles and outcomes that the server publishes are not looked at.
    """

    def __init__(self, address: str, keys: ClientKeys | None = None) -> None:
        """Connect and stop the server's own clock.

        Raises:
            LinkError: if there is no server.
            CalibrationError: if fewer than two of its cameras are calibrated.
        """
        self._received = threading.Condition()
        self._blocks: dict[int, dict[str, Events]] = {}
        self._client = SimulationClient(address, keys=keys, timeout_s=PATIENCE_S)
        try:
            self._cameras = self._client.welcome.calibrated()
            if len(self._cameras) < 2:
                got = ", ".join(self._cameras) or "none"
                raise CalibrationError("too few calibrated cameras", expected="two", got=got, where=address)
            self._client.auto_serve(0.0)
            self._client.wait_for_messages()  # else the first block could be published before the subscription arrives
            reply = self._client.pause()
        except (LinkError, CalibrationError):
            self._client.close()
            raise
        self._now_us, self._block_us, self._session = reply.t_us, reply.block_us, reply.session
        self._client.add_listener(self)

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Cameras by name, as the server reported."""
        return self._cameras

    @property
    def now_us(self) -> int:
        """End of the newest block."""
        return self._now_us

    def begin(self, seed: int) -> None:
        """Do nothing: the server draws its cameras' noise itself."""

    def serve(self, p_m: Array, v_mps: Array, spin_radps: Array) -> None:
        """Launch this ball on the server."""
        p, v, spin = (tuple(row.tolist()) for row in (p_m, v_mps, spin_radps))
        self._client.launch(p, v, spin)

    def aim(self, target: RacketTarget | None) -> None:
        """Send the racket there, or to rest.

        Raises:
            ConfigError: if it is out of bounds.
        """
        if target is None:
            self._client.rest_racket()
            return
        sent = check_target(target, RacketConfig())
        q_wxyz, v_mps = tuple(sent.q_wxyz.tolist()), tuple(sent.v_mps.tolist())
        self._client.aim_racket(tuple(sent.p_m.tolist()), q_wxyz, v_mps, round(1e6 * sent.t_s))

    def advance(self) -> SeenBlock:
        """Advance by one block, and wait for its events.

        Raises:
            LinkError: if the server is gone, began anew, or its events do not come.
        """
        start_us, end_us = self._now_us, self._now_us + self._block_us
        self._client.step(1)
        with self._received:
            came = self._received.wait_for(lambda: self._is_whole(end_us), PATIENCE_S)
            if not came or self._client.welcome.session != self._session:
                remedy = "is it still running, and does nobody else command it?"
                raise LinkError("no events of a block", where=self._client.address, remedy=remedy)
            events = self._blocks.pop(end_us)
            self._blocks = {t: one for t, one in self._blocks.items() if t > end_us}
        self._now_us = end_us
        return SeenBlock(start_us, end_us, events)

    def close(self) -> None:
        """Disconnect; the server's clock runs again."""
        self._client.remove_listener(self)
        _release(self._client)

    def _is_whole(self, end_us: int) -> bool:
        return self._blocks.get(end_us, {}).keys() == self._cameras.keys()

    def on_session(self, welcome: m.Reply) -> None:
        """Note a new session, reported at the next block."""

    def on_events(self, batch: m.EventBatch) -> None:
        """Store the events for the waiting thread."""
        if batch.camera not in self._cameras:
            return
        with self._received:
            self._blocks.setdefault(batch.end_us, {})[batch.camera] = batch.events()
            self._received.notify_all()

    def on_state(self, state: m.WorldState) -> None:
        """Not looked at: it holds the truth."""

    def on_notice(self, notice: m.Notice) -> None:
        """Not looked at: it holds the truth."""


def _release(client: SimulationClient) -> None:
    """Let the server's clock run again, and disconnect. A silent server may be gone: it is not waited for as long."""
    try:
        client.ask(lambda number: m.Resume(id=number), timeout_s=None if client.status == "connected" else HELLO_S)
    finally:
        client.close()


BLOCKS: Final = 300
"""Blocks per step command: 3 simulated seconds, longer than any ball."""
BALL_PATIENCE_S: Final = 60.0
"""Timeout for a ball; it takes about a second of computing."""


class ServerEpisodes:
    """Plays balls in a server: it serves exactly the balls that the training draws, so outcomes are those at home.

    The clock of the server is stepped as fast as it computes. Nobody else should command it meanwhile.
    """

    def __init__(self, environment: EnvironmentConfig, address: str, keys: ClientKeys | None = None) -> None:
        """Connect and stop the server's own clock.

        Raises:
            LinkError: if there is no server, its physics is another, or states are to come from its events.
        """
        if environment.state_source == "events":
            remedy = "train with --outcomes events, or on events without --source, or with another state source"
            raise LinkError("a server's events go with outcomes that they show", where="state_source", remedy=remedy)
        self._environment = environment
        self._notices: queue.SimpleQueue[m.OutcomeNotice] = queue.SimpleQueue()
        self._client = SimulationClient(address, keys=keys, timeout_s=PATIENCE_S)
        try:
            if self._client.welcome.physics not in (None, environment.task.physics):
                remedy = "give training and `sim-server` the same --physics"
                raise LinkError("the server's balls fly by another physics", where=address, remedy=remedy)
            self._client.auto_serve(0.0)
            self._client.wait_for_messages()  # else the first outcome could be missed
            self._client.pause()
        except LinkError:
            self._client.close()
            raise
        self._client.add_listener(self)

    def begin(self, seed: int) -> None:
        """Do nothing: the server's random numbers do not affect a training."""

    def observe(self, batch: ServeBatch) -> ServeBatch:
        """Return the batch, which already contains its observations."""
        return batch

    def play(self, batch: ServeBatch, action: Array) -> Outcomes:
        """Launch the ball, send the racket, wait for the notice of the outcome.

        Raises:
            LinkError: if the server refuses, or does not answer in time.
        """
        serves, target = batch.serves, self._target(batch, action)
        p, v, spin = (tuple(row[0].tolist()) for row in (serves.ps_m, serves.vs_mps, serves.spins_radps))
        self._client.rest_racket()
        launched_us = self._client.launch(p, v, spin).t_us
        if target is not None:
            q_wxyz, v_mps = tuple(target.q_wxyz.tolist()), tuple(target.v_mps.tolist())
            t_us = launched_us + round(1e6 * target.t_s)
            self._client.aim_racket(tuple(target.p_m.tolist()), q_wxyz, v_mps, t_us)
        self._client.step(BLOCKS)
        notice = self._wait_for(launched_us)
        self._client.pause()
        net_z, landing_m = notice.net_z_m, np.array(notice.landing_m)
        ball = BallOutcome(notice.case, notice.t_us * 1e-6, landing_m, np.array(notice.landing_v_mps), net_z)
        return outcomes_of(ball, launched_us * 1e-6)

    def close(self) -> None:
        """Disconnect; the server's clock runs again."""
        _release(self._client)

    def on_session(self, welcome: m.Reply) -> None:
        """A new session forgets the ball that is waited for: that shows as no answer in time."""

    def on_events(self, batch: m.EventBatch) -> None:
        """Not used here."""

    def on_state(self, state: m.WorldState) -> None:
        """Not used here."""

    def on_notice(self, notice: m.Notice) -> None:
        """Pass an outcome to the thread that waits."""
        if isinstance(notice, m.OutcomeNotice):
            self._notices.put(notice)

    def _target(self, batch: ServeBatch, action: Array) -> RacketTarget | None:
        """Where the racket goes, in seconds since the serve; None if the ball was not seen."""
        strokes = strokes_of(batch, action, self._environment)
        arrivals = batch.arrivals
        p_m = arrivals.states[0, :3] if strokes.aim_ps_m is None else strokes.aim_ps_m[0]
        t_s = float(arrivals.t_s[0] if strokes.aim_t_s is None else strokes.aim_t_s[0])
        if not batch.seen[0] or math.isnan(t_s):
            return None
        return target_for_ball(p_m, strokes.qs_wxyz[0], strokes.vs_mps[0], t_s)

    def _wait_for(self, served_us: int) -> m.OutcomeNotice:
        while True:
            try:
                notice = self._notices.get(timeout=BALL_PATIENCE_S)
            except queue.Empty:
                remedy = "is it still running, and does nobody else command it?"
                raise LinkError("no outcome of a ball", where=self._client.address, remedy=remedy) from None
            if notice.serve_us == served_us:
                return notice
