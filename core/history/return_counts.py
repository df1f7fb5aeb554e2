"""Return counts by controller and scene."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from core.metrics.intervals import binomial_interval


@dataclass(frozen=True, slots=True)
class BallConditions:
    """Conditions of a ball."""

    controller: str
    """Name of the controller."""
    scene: str
    """Name of the scene; empty if unknown."""


@dataclass(frozen=True, slots=True)
class ReturnRate:
    """Balls of one controller in one scene."""

    conditions: BallConditions
    balls: int
    """At least one."""
    returned: int

    @property
    def share(self) -> float:
        """Share of returned balls, 0 to 1."""
        return self.returned / self.balls

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share."""
        return binomial_interval(self.share, self.balls)


class ReturnCounts:
    """Counts whole balls of a live rally. Safe to use from several threads.

    A ball counts only if all of it was seen, and if neither the controller nor the scene was changed during it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: dict[BallConditions, tuple[int, int]] = {}
        self._begun: BallConditions | None = None

    def begin_ball(self, conditions: BallConditions) -> None:
        """Start a ball."""
        with self._lock:
            self._begun = conditions

    def end_ball(self, conditions: BallConditions, *, returned: bool) -> None:
        """End the ball that was served last, with its outcome."""
        with self._lock:
            begun, self._begun = self._begun, None
            if begun == conditions:
                balls, back = self._counts.get(conditions, (0, 0))
                self._counts[conditions] = (balls + 1, back + returned)

    def drop_ball(self) -> None:
        """Do not count the current ball: its session is over."""
        with self._lock:
            self._begun = None

    def clear(self) -> None:
        """Begin anew; a ball that flies counts already."""
        with self._lock:
            self._counts.clear()

    def rates(self) -> tuple[ReturnRate, ...]:
        """Return rates, in the order of first occurrence."""
        with self._lock:
            return tuple(ReturnRate(one, balls, back) for one, (balls, back) in self._counts.items())
