"""State of the rally in a live player: current flight, racket, finished balls.

Sends racket commands over the link from a thread of its own, as a reply takes up to two blocks.

Only the newest command waits to be sent; one that it replaces, or whose impact is over, counts as late.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import BallPoint
from core.chain.control.controller import LiveController, RacketDecision
from core.chain.control.player import PlayerState
from core.errors import LinkError
from core.live.link import messages as m
from core.live.link.live_source import LiveSource, Robot
from core.live.live_snapshot import STAGES, FinishedBall, LiveMeter, RacketPose, RallySnapshot, TrueBall
from core.live.urgency import go_first
from core.physics.episode import Case
from core.trajectory import Prediction
from core.trajectory.learned_constants import LearnedConstants

logger = logging.getLogger(__name__)


Array = NDArray[np.float64]

POINTS: Final = 1000
"""Two seconds of a ball that every window finds."""
FINISHED: Final = 500


def pose_of(state: m.WorldState) -> RacketPose | None:
    """The racket at its last row."""
    if not len(state.racket_t_us):
        return None
    row = state.racket[-1]
    return RacketPose(int(state.racket_t_us[-1]), row[:3], row[3:7], row[7:10])


def true_ball_of(state: m.WorldState) -> TrueBall | None:
    """The ball at its last row; None if there is none then."""
    if not len(state.ball_t_us) or not state.ball_visible[-1]:
        return None
    row = state.ball[-1]
    return TrueBall(int(state.ball_t_us[-1]), row[:3], row[3:6], row[6:9])


class LiveFlight:
    """The flight of one session. The player's thread writes it and takes snapshots."""

    def __init__(self) -> None:
        self._t_us = 0
        self._first_t_us: int | None = None
        self._phase = "idle"
        self._racket: RacketPose | None = None
        self._ball: TrueBall | None = None
        self._state: PlayerState | None = None
        self._points: deque[BallPoint] = deque(maxlen=POINTS)
        self._finished: deque[FinishedBall] = deque(maxlen=FINISHED)
        self._played = self._returned = 0
        self._last_decision: RacketDecision | None = None
        self._forget()

    def _forget(self) -> None:
        self._newest: Prediction | None = None

    @property
    def racket(self) -> RacketPose | None:
        """Its newest pose, as the source has it."""
        return self._racket

    def blocks_missing(self, state: m.WorldState) -> int:
        """Number of blocks lost between the last one and this."""
        if self._first_t_us is None:
            return 0
        return max(0, (state.start_us - self._t_us) // max(1, state.t_us - state.start_us))

    def see(self, state: m.WorldState) -> None:
        """Update with the state at a block's end."""
        self._first_t_us = state.start_us if self._first_t_us is None else self._first_t_us
        self._t_us, self._phase = state.t_us, state.phase
        self._racket, self._ball = pose_of(state) or self._racket, true_ball_of(state)

    def follow(self, state: PlayerState, *, playing: bool) -> RacketDecision | None:
        """Take a step of the player; returns the decision that was made in it. It counts for the ball if `playing`."""
        self._state, chain = state, state.chain
        if chain.verdict == "new flight":
            self._forget()
        if chain.point is not None:
            self._points.append(chain.point)
        found = chain.prediction
        if not chain.is_new or found is None:
            return None
        self._newest = found
        decision = state.decision
        if not state.is_new or decision is None:
            return None
        if playing:
            self._last_decision = decision
        return decision

    def finish(self, outcome: m.OutcomeNotice, goal_m: Array) -> FinishedBall:
        """Add the outcome of a ball."""
        last = self._last_decision
        decided = last if last is not None and outcome.serve_us <= last.t_us <= outcome.t_us else None
        self._played += 1
        self._returned += outcome.case == Case.RETURNED
        ball = FinishedBall(
            t_us=outcome.t_us,
            serve_us=outcome.serve_us,
            speed_mps=outcome.speed_mps,
            case=outcome.case,
            landing_m=np.array(outcome.landing_m[:2]),
            goal_m=goal_m if decided is None else decided.goal_m,
            net_z_m=outcome.net_z_m if math.isfinite(outcome.net_z_m) else float("nan"),
            decision=decided,
        )
        self._finished.append(ball)
        return ball

    def snapshot(
        self,
        number: int,
        session: str,
        controller: LiveController,
        playing: bool,
        meter: LiveMeter,
        problem: str,
        learned: LearnedConstants | None = None,
    ) -> RallySnapshot:
        """Frozen snapshot."""
        return RallySnapshot(
            number=number,
            session=session,
            t_us=self._t_us,
            controller=controller.name,
            playing=playing,
            goal_m=controller.goal_m,
            state=self._state,
            points=tuple(self._points),
            newest=self._newest,
            racket=self._racket,
            ball=self._ball,
            phase=self._phase,
            finished=tuple(self._finished),
            played=self._played,
            returned=self._returned,
            health=meter.health(),
            problem=problem,
            learned=learned,
        )


class QueuedCommand(NamedTuple):
    """A decision to be sent to the racket."""

    session: str
    decision: RacketDecision
    window_s: float
    """End of its window on the monotonic clock, s; NaN if unknown, as while the simulation is stepped."""
    arrived_s: float
    """Arrival of the block on the monotonic clock, s."""
    decode_s: float = float("nan")
    """Time of reading the events of its block; NaN if unknown."""
    step: PlayerState | None = None
    """The step that decided it, with the times of its stages."""
    put_s: float = float("nan")
    """When it was handed over, on the monotonic clock, s."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras that its step's answer is made of, sorted; empty if the step is not known."""
        return () if self.step is None else tuple(sorted(self.step.chain.used))

    def stages_ms(self, sent_s: float, answered_s: float) -> tuple[float, ...]:
        """A duration for each of `STAGES`, ms; NaN where it is unknown. The times are on the monotonic clock, s."""
        if self.step is None:
            return (float("nan"),) * len(STAGES)
        took = self.step.chain.seconds
        computed_s = took.total + self.step.control_s
        queue_s = self.put_s - self.arrived_s - self.decode_s - computed_s
        seconds = (
            *(self.arrived_s - self.window_s, queue_s, self.decode_s, took.detect, took.triangulate, took.predict),
            *(self.step.control_s, sent_s - self.put_s, answered_s - sent_s),
        )
        return tuple(1e3 * one for one in seconds)


class CommandSender:
    """One slot and one thread."""

    def __init__(self, source: LiveSource, robot: Robot) -> None:
        self._source, self._robot = source, robot
        self._meter = LiveMeter()
        self._changed = threading.Condition()
        self._order: QueuedCommand | None = None
        self._sending = self._stop = False
        self._thread = threading.Thread(target=self._run, name="racket-commands", daemon=True)
        self._thread.start()

    def begin_session(self, meter: LiveMeter) -> None:
        """Use a new meter; a queued command of the old session is dropped."""
        with self._changed:
            self._meter, self._order = meter, None

    @property
    def idle(self) -> bool:
        """Whether no command waits or is under way."""
        with self._changed:
            return self._order is None and not self._sending

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
        go_first()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stop or self._order is not None)
                if self._stop:
                    return
                order, self._order, meter = self._order, None, self._meter
                self._sending = True
            assert order is not None
            try:
                self._send(order, meter)
            finally:
                self._sending = False

    def _send(self, order: QueuedCommand, meter: LiveMeter) -> None:
        state, target = self._source.state, order.decision.target
        t_us = round(1e6 * target.t_s)
        if order.session != self._source.welcome.session or (state is not None and t_us <= state.t_us):
            return
        p, q, v = (tuple(a.tolist()) for a in (target.p_m, target.q_wxyz, target.v_mps))
        sent_s = time.monotonic()
        try:
            self._robot.aim_racket(p, q, v, t_us, order.cameras)
        except LinkError as error:
            meter.last_refusal = str(error)
            logger.info("racket target not taken: %s", error)
            return
        meter.command_stages_ms.append(order.stages_ms(sent_s, time.monotonic()))
        meter.sent += 1
        meter.arrival_to_sent_ms.append(1e3 * (sent_s - order.arrived_s))
        if order.window_s == order.window_s:
            meter.window_to_sent_ms.append(1e3 * (sent_s - order.window_s))
