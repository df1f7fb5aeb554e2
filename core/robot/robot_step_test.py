"""Step test of an external robot during a rally: only while no ball flies; its latency is compensated afterwards."""

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
"""Time without a ball before and during the test; a ball aborts it."""
STANDS_S: Final = 1.0
"""Time without data after which it is unknown whether a ball flies."""


@dataclass(frozen=True, slots=True)
class StepTestReport:
    """Report about the robot's latency."""

    running: bool = False
    done: float = 0.0
    """Share of the test that is running."""
    found: CommandLatency | None = None
    """Result of the last completed test."""
    problem: str = ""
    """Why the last test failed; empty if it did not."""


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
        """Wait for its end; stopping the robot ends it."""
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
        """Why a test is not allowed now; empty if it is."""
        snapshot, now_s = self._player.snapshot, time.monotonic()
        at = snapshot.session, snapshot.t_us
        if at != self._seen:
            self._seen, self._seen_s = at, now_s
        if now_s - self._seen_s > STANDS_S or not snapshot.session:
            return "nothing is seen: the source stands still"
        return "a ball flies" if ball_flies(snapshot) else ""


def ball_flies(snapshot: RallySnapshot) -> bool:
    """Whether a ball was triangulated recently."""
    return bool(snapshot.points) and snapshot.t_us - snapshot.points[-1].t_us < QUIET_US
