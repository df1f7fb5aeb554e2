"""A simulation server as an environment backend: serve and racket commands go out, only events come back."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import CalibrationError, LinkError
from core.events import Events
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.live.link.keys import ClientKeys
from core.outcomes.environment_backend import SeenBlock
from core.simulation.episodes.racket import RacketConfig, RacketTarget, check_target

Array = NDArray[np.float64]
PATIENCE_S: Final = 30.0
"""Longest wait for the events of one block."""


class LinkedBackend:
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
        self._client = SimulationClient(address, keys=keys)
        try:
            self._cameras = self._client.welcome.calibrated()
            if len(self._cameras) < 2:
                got = ", ".join(self._cameras) or "none"
                raise CalibrationError("too few calibrated cameras", expected="two", got=got, where=address)
            self._client.auto_serve(0.0)
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
        try:
            self._client.resume()
        finally:
            self._client.close()

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
