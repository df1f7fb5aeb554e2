"""The one-step task on a simulation server, which plays every ball of a training."""

from __future__ import annotations

import math
import queue
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import LinkError
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import ServeBatch, strokes_of
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.live.link.keys import ClientKeys
from core.live.worlds.outcomes import outcomes_of
from core.physics.episode import Outcomes
from core.simulation.episodes.ball_outcome import BallOutcome
from core.simulation.episodes.racket import RacketTarget, target_for_ball

Array = NDArray[np.float64]

BLOCKS: Final = 300
"""Blocks per step command: 3 simulated seconds, longer than any ball."""
PATIENCE_S: Final = 60.0
"""Timeout for a ball; it takes about a second of computing."""


class LinkBackend:
    """Plays balls in a server: it serves exactly the balls that the training deals, so outcomes are those at home.

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
        self._client = SimulationClient(address, keys=keys)
        try:
            if self._client.welcome.physics not in (None, environment.task.physics):
                remedy = "give training and `sim-server` the same --physics"
                raise LinkError("the server's balls fly by another physics", where=address, remedy=remedy)
            self._client.auto_serve(0.0)
            self._client.pause()
        except LinkError:
            self._client.close()
            raise
        self._client.add_listener(self)

    def begin(self, seed: int) -> None:
        """Do nothing: the server's random numbers do not affect a training."""

    def observe(self, delivery: ServeBatch) -> ServeBatch:
        """Return the batch, which already contains its observations."""
        return delivery

    def play(self, delivery: ServeBatch, action: Array) -> Outcomes:
        """Launch the ball, send the racket, wait for the notice of the outcome.

        Raises:
            LinkError: if the server refuses, or does not answer in time.
        """
        serves, target = delivery.serves, self._target(delivery, action)
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
        try:
            self._client.resume()
        finally:
            self._client.close()

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

    def _target(self, delivery: ServeBatch, action: Array) -> RacketTarget | None:
        """Where the racket goes, in seconds since the serve; None if the ball was not seen."""
        strokes = strokes_of(delivery, action, self._environment)
        arrivals = delivery.arrivals
        p_m = arrivals.states[0, :3] if strokes.aim_ps_m is None else strokes.aim_ps_m[0]
        t_s = float(arrivals.t_s[0] if strokes.aim_t_s is None else strokes.aim_t_s[0])
        if not delivery.seen[0] or math.isnan(t_s):
            return None
        return target_for_ball(p_m, strokes.qs_wxyz[0], strokes.vs_mps[0], t_s)

    def _wait_for(self, served_us: int) -> m.OutcomeNotice:
        while True:
            try:
                notice = self._notices.get(timeout=PATIENCE_S)
            except queue.Empty:
                remedy = "is it still running, and does nobody else command it?"
                raise LinkError("no outcome of a ball", where=self._client.address, remedy=remedy) from None
            if notice.serve_us == served_us:
                return notice
