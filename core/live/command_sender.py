"""Sends racket commands over the link from a thread of its own, as a reply takes up to two blocks.

Only the newest command waits to be sent; one that it replaces, or whose impact is over, counts as late.
"""

from __future__ import annotations

import logging
import threading
import time
from typing import NamedTuple

from core.chain.control.decision import RacketDecision
from core.errors import LinkError
from core.live.link.live_source import LiveSource, Robot
from core.live.live_meter import LiveMeter

logger = logging.getLogger(__name__)


class QueuedCommand(NamedTuple):
    """A decision to be sent to the racket."""

    session: str
    decision: RacketDecision
    window_s: float
    """End of its window on the monotonic clock, s; NaN if unknown, as while the simulation is stepped."""
    arrived_s: float
    """Arrival of the block on the monotonic clock, s."""


class CommandSender:
    """One slot and one thread."""

    def __init__(self, source: LiveSource, robot: Robot) -> None:
        self._source, self._robot = source, robot
        self._meter = LiveMeter()
        self._changed = threading.Condition()
        self._order: QueuedCommand | None = None
        self._stop = False
        self._thread = threading.Thread(target=self._run, name="racket-commands", daemon=True)
        self._thread.start()

    def begin_session(self, meter: LiveMeter) -> None:
        """Use a new meter; a queued command of the old session is dropped."""
        with self._changed:
            self._meter, self._order = meter, None

    def put(self, order: QueuedCommand) -> None:
        """Send this command next."""
        with self._changed:
            self._order = order
            self._changed.notify()

    def close(self) -> None:
        """Stop the thread; waits for a pending reply."""
        with self._changed:
            self._stop = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stop or self._order is not None)
                if self._stop:
                    return
                order, self._order, meter = self._order, None, self._meter
            assert order is not None
            self._send(order, meter)

    def _send(self, order: QueuedCommand, meter: LiveMeter) -> None:
        state, target = self._source.state, order.decision.target
        t_us = round(1e6 * target.t_s)
        if order.session != self._source.welcome.session or (state is not None and t_us <= state.t_us):
            return
        p, q, v = (tuple(a.tolist()) for a in (target.p_m, target.q_wxyz, target.v_mps))
        sent_s = time.monotonic()
        try:
            self._robot.aim_racket(p, q, v, t_us)
        except LinkError as error:
            meter.last_refusal = str(error)
            logger.info("racket target not taken: %s", error)
            return
        meter.sent += 1
        meter.arrival_to_sent_ms.append(1e3 * (sent_s - order.arrived_s))
        if order.window_s == order.window_s:
            meter.window_to_sent_ms.append(1e3 * (sent_s - order.window_s))
