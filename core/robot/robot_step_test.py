"""The step test of a robot of one's own while a rally is followed: only when no ball flies, and led by from then on."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass, replace
from typing import Final

from core.chain.control.step_test import CommandLatency
from core.errors import RallyscopeError, TargetRefusedError
from core.live.live_player import LivePlayer
from core.live.live_snapshot import RallySnapshot
from core.robot import RobotClient, measure_robot

logger = logging.getLogger(__name__)

QUIET_US: Final = 1_000_000
"""So long no ball may have been seen. It is asked all the time: a ball that comes ends the test."""
STANDS_S: Final = 1.0
"""Whoever has seen nothing for so long does not know whether a ball flies."""


@dataclass(frozen=True, slots=True)
class StepTestReport:
    """What is known of the robot's latency."""

    running: bool = False
    done: float = 0.0
    """Share of the test that is running."""
    found: CommandLatency | None = None
    """Result of the last completed test."""
    problem: str = ""
    """Why the last one did not."""


class RobotStepTest:
    """Step test of one live rally, shared by all browsers. Any thread may call its methods."""

    def __init__(self, player: LivePlayer, robot: RobotClient) -> None:
        self._player, self._robot = player, robot
        self._lock = threading.Lock()
        self._seen: tuple[str, int] = "", 0
        self._seen_s = float("-inf")
        self._thread: threading.Thread | None = None
        self.report = StepTestReport()

    def begin(self) -> None:
        """Run it on a thread of its own; the report says what came of it. If one is running, it goes on."""
        self._thread = threading.Thread(target=self._run_quietly, name="robot-step-test", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Wait for its end, which comes when the robot is stopped."""
        if self._thread is not None:
            self._thread.join()

    def run(self) -> CommandLatency:
        """Measure it, some twenty seconds, and have the player lead by it from then on.

        Raises:
            TargetRefusedError: if one is running, a ball flies, the robot is stopped, or does not take a step.
            NoAnswerError: if the robot does not answer.
            ConfigError: if it does not move as it is told.
        """
        if not self._lock.acquire(blocking=False):
            raise TargetRefusedError("stopped", "one is running already", where="step test")
        try:
            self.report = replace(self.report, running=True, done=0.0, problem="")
            self._seen_s = time.monotonic()
            found = measure_robot(self._robot, self._refuse, self._note)
            self._player.lead_by(found)
            self.report = StepTestReport(found=found)
        except RallyscopeError as error:
            self.report = replace(self.report, problem=error.what)
            raise
        finally:
            self.report = replace(self.report, running=False)
            self._lock.release()
        return found

    def _run_quietly(self) -> None:
        try:
            self.run()
        except RallyscopeError as error:
            logger.info("no step test: %s", error)

    def _note(self, share: float) -> None:
        self.report = replace(self.report, done=share)

    def _refuse(self) -> str:
        """Why the racket must not be moved for a test now; empty if it may."""
        snapshot, now_s = self._player.snapshot, time.monotonic()
        at = snapshot.session, snapshot.t_us
        if at != self._seen:
            self._seen, self._seen_s = at, now_s
        if now_s - self._seen_s > STANDS_S or not snapshot.session:
            return "nothing is seen: the source stands still"
        return "a ball flies" if ball_flies(snapshot) else ""


def ball_flies(snapshot: RallySnapshot) -> bool:
    """Whether a ball has been seen in space of late."""
    return bool(snapshot.points) and snapshot.t_us - snapshot.points[-1].t_us < QUIET_US
