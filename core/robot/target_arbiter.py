"""Arbiter of a robot's targets: which it accepts, and how long it follows one.

No target is carried out that is stale, older than one before, of before a stop, or outside of the limits: however
late, often or out of order it arrives.
"""

from __future__ import annotations

from typing import Final

from core.robot.motion_check import FaceMotion, MotionFault, find_fault
from core.robot.robot_messages import RobotLimits, RobotTarget

AHEAD_US: Final = 20_000
"""Tolerance for targets sent in the future by our clock, whose sender does not know the clock."""
OLDEST_US: Final = 150_000
"""Largest age of a target at its start, whatever its own validity."""
FOLLOW_US: Final = 80_000
"""A target is followed this long after the impact, for a late ball."""
SILENT_US: Final = 500_000
"""Silence of the commander after which its target is dropped."""
NOT_STARTED: Final = "not started yet: a person has to"


class TargetArbiter:
    """Decides which target one robot follows, on its clock; used by one thread. It starts stopped."""

    def __init__(self, limits: RobotLimits) -> None:
        self.limits = limits
        self.stopped, self.reason = "robot", NOT_STARTED
        """Who stopped it ("" if it is not stopped), and why."""
        self._target: RobotTarget | None = None
        self._newest_id = 0
        self._received_us: int | None = None
        self._looked_us = 0

    def hear(self, now_us: int) -> None:
        """Note a sign of life of the commander."""
        self._received_us = now_us

    def begin_anew(self) -> None:
        """Reset for a new commander: the target is dropped, and a person has to start the robot."""
        self._newest_id = 0
        self.stop(self.stopped or "robot", self.reason or NOT_STARTED)

    def offer(self, target: RobotTarget, motion: FaceMotion, now_us: int) -> MotionFault | None:
        """Accept a target, or return the fault. `motion` is how the racket moves now."""
        is_newer = target.id > self._newest_id
        self._newest_id = max(self._newest_id, target.id)
        fault = self._fault(target, motion, now_us, is_newer=is_newer)
        if fault is None:
            self._target = target
        return fault

    def target(self, now_us: int) -> RobotTarget | None:
        """The one to carry out now; None: there is none, hold still or go to rest."""
        found, looked_us, self._looked_us = self._target, self._looked_us, now_us
        if found is None:
            return None
        gone = self._received_us is None or now_us - self._received_us > SILENT_US
        if self.stopped or gone or now_us < looked_us or now_us > found.impact_us + FOLLOW_US:
            self._target = None
        return self._target

    def stop(self, by: str, reason: str, number: int = 0) -> None:
        """Drop what is carried out, and take nothing until `start`."""
        self._newest_id = max(self._newest_id, number)
        self._target = None
        self.stopped, self.reason = by, reason

    def start(self, number: int) -> bool:
        """A person wants it to play: what was sent before that is over. False for one from before a later request."""
        if number <= self._newest_id:
            return False
        self._newest_id = number
        self.stopped = self.reason = ""
        return True

    def _fault(self, target: RobotTarget, motion: FaceMotion, now_us: int, *, is_newer: bool) -> MotionFault | None:
        if self.stopped:
            return MotionFault("stopped", f"stopped by {self.stopped}: {self.reason}")
        if not is_newer:
            return MotionFault("older", "a newer one was here before")
        if target.sent_us > now_us + AHEAD_US:
            return MotionFault("clock", f"sent in {(target.sent_us - now_us) / 1e3:.0f} ms from now, by our clock")
        if now_us > min(target.valid_until_us, target.sent_us + OLDEST_US):
            return MotionFault("stale", f"under way for {(now_us - target.sent_us) / 1e3:.0f} ms, too late to begin")
        goal = FaceMotion.of(target.p_m, target.q_wxyz, target.v_mps)
        return find_fault(goal, target.turn_radps, target.impact_us - now_us, motion, self.limits)
