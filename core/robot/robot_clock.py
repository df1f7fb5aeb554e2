"""How a robot's clock stands against ours, from the answers to pings: never sent before, never after they were."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

SAMPLES: Final = 40
"""Two seconds: in these, clocks drift apart by less than their answers can tell."""
ENOUGH: Final = 3
"""Answers that agree, before the clock counts as known."""
TOLERANCE_US: Final = 2000.0
"""Besides what the round trips leave open, for drift."""


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The robot's clock shows ours plus `offset_us`."""

    offset_us: float
    within_us: float
    """It cannot be farther off: half the quickest round trip."""

    def robot_us(self, host_us: float) -> int:
        """What the robot's clock shows at a time of ours."""
        return round(host_us + self.offset_us)

    def host_us(self, robot_us: float) -> float:
        """What ours shows at a time of the robot's."""
        return robot_us - self.offset_us


class RobotClock:
    """Of one robot; used by one thread."""

    def __init__(self) -> None:
        self.jumps = 0
        """How often it was set, or its answers otherwise made no sense."""
        self._samples: deque[ClockOffset] = deque(maxlen=SAMPLES)

    @property
    def estimate(self) -> ClockOffset | None:
        """By the quickest answer of late; None while it is not known."""
        return min(self._samples, key=lambda one: one.within_us) if len(self._samples) >= ENOUGH else None

    def forget(self) -> None:
        """It is another clock from now on."""
        self._samples.clear()

    def add(self, sent_us: float, heard_us: float, robot_us: float) -> bool:
        """Between these two times of ours its clock showed this; false if it has jumped, and is to be learned anew."""
        within_us = max(0.0, heard_us - sent_us) / 2
        sample = ClockOffset(robot_us - (sent_us + heard_us) / 2, within_us)
        jumped = any(
            abs(sample.offset_us - one.offset_us) > within_us + one.within_us + TOLERANCE_US for one in self._samples
        )
        if jumped:
            self.jumps += 1
            self._samples.clear()
        self._samples.append(sample)
        return not jumped
