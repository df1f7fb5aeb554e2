"""Adaptive rate: a simulation that is too slow for the requested speed runs at 3/4, 1/2, 1/3 ... of it, and reports
that.

Without that it would run as fast as it can, now a little faster and now a little slower, and the ball would stutter. It
slows down when it lost time in two looks one after the other, or very much in one, and tries the fastest pace at which
its work would fit into the time. A try that fails makes it wait for twice as long before the next one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

LOOK_S: Final = 1.0
"""Length of a measurement, s; a ball flies for about as long."""
SLOW: Final = 0.9
"""A measurement below this share of the rate counts as slow."""
VERY_SLOW: Final = 0.6
"""A measurement below this share reduces the rate at once."""
EASY: Final = 0.8
"""Largest load at a faster rate for which it is tried."""
FIRST_TRIAL_BLOCKS: Final = 5
"""Consecutive blocks with low load before a faster rate is tried."""
MAX_TRIAL_BLOCKS: Final = 60
SETTLED_LOOKS: Final = 30
"""Measurements after which a tried rate counts as held."""
SHARES: Final = (1, 3 / 4, 1 / 2, 1 / 3, 1 / 4, 1 / 6, 1 / 8, 1 / 12, 1 / 16, 1 / 24, 1 / 32, 1 / 48, 1 / 64)
"""Shares of the requested speed that are tried; at 3 m/s and the last one a flight takes a minute."""
ROUNDING: Final = 1.01


@dataclass(slots=True)
class AdaptiveRate:
    """Chooses the share of the requested speed at which the simulation runs. Times are wall times in s."""

    share: float = 1.0
    """One of `SHARES`."""
    _patience: int = FIRST_TRIAL_BLOCKS
    _simulated_s: float = 0.0
    _worked_s: float = 0.0
    _waited_s: float = 0.0
    _slow: int = 0
    _easy: int = 0
    _looks: int = 0
    """Measurements at this rate."""
    _trying: bool = False
    """Whether this speed is being tried after a slower one."""

    def ask_anew(self) -> None:
        """Reset for another speed or scene."""
        self._patience = FIRST_TRIAL_BLOCKS
        self._change(1.0, trying=False)

    def note(self, block_s: float, worked_s: float, passed_s: float) -> bool:
        """A block of `block_s` at the present pace took `worked_s` of work, and `passed_s` until the next one began.

        Returns whether the pace has changed.
        """
        self._simulated_s += block_s
        self._worked_s += worked_s
        self._waited_s += passed_s
        if self._waited_s < LOOK_S:
            return False
        reached, load = self._simulated_s / self._waited_s, self._worked_s / max(self._simulated_s, 1e-9)
        self._simulated_s = self._worked_s = self._waited_s = 0.0
        return self._judge(reached, load)

    def _judge(self, reached: float, load: float) -> bool:
        """`reached` is a share of the pace, `load` work per time that it has for it."""
        faster = max((share for share in SHARES if load * share < EASY * self.share), default=self.share)
        self._looks += 1
        self._slow = self._slow + 1 if reached < SLOW else 0
        self._easy = self._easy + 1 if faster > self.share else 0
        if (self._slow >= 2 or reached < VERY_SLOW) and self.share > SHARES[-1]:
            in_vain = self._trying and self._looks <= SETTLED_LOOKS
            self._patience = min(2 * self._patience, MAX_TRIAL_BLOCKS) if in_vain else FIRST_TRIAL_BLOCKS
            kept = ROUNDING * self.share * max(reached, 0.5)
            self._change(max((share for share in SHARES if share <= kept), default=SHARES[-1]), trying=False)
            return True
        if self._easy >= self._patience:
            self._change(faster, trying=True)
            return True
        return False

    def _change(self, share: float, *, trying: bool) -> None:
        self.share, self._trying = share, trying
        self._simulated_s = self._worked_s = self._waited_s = 0.0
        self._slow = self._easy = self._looks = 0


def pace_words(factor: float) -> str:
    """Readable text of a rate: "real time", "3/4 speed", "1/2 speed", "3 x real time"."""
    if abs(factor - 1.0) < 1e-9:
        return "real time"
    if abs(factor - 0.75) < 1e-9:
        return "3/4 speed"
    if factor < 1.0:
        parts = 1.0 / factor
        return f"1/{parts:.0f} speed" if abs(parts - round(parts)) < 0.02 * parts else f"{factor:.2g} x real time"
    return f"{factor:g} x real time"
