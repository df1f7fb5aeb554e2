"""An honest pace: a simulation that is too slow for what is asked settles on 3/4, 1/2, 1/3 ... of it, and says so.

Without that it would run as fast as it can, now a little faster and now a little slower, and the ball would stutter. It
slows down when it lost time in two looks one after the other, or very much in one, and tries the fastest pace at which
its work would fit into the time. A try that fails makes it wait for twice as long before the next one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

LOOK_S: Final = 1.0
"""So long it looks before it judges; a ball flies for about as long."""
SLOW: Final = 0.9
"""A look in which it reached less than this share of its pace was slow."""
VERY_SLOW: Final = 0.6
"""One such look is enough."""
EASY: Final = 0.8
"""Share of the time that the work may take at a faster pace so that it looks possible."""
FIRST_TRIAL_BLOCKS: Final = 5
"""Easy looks one after the other before it tries a faster pace."""
MAX_TRIAL_BLOCKS: Final = 60
SETTLED_LOOKS: Final = 30
"""A try that lasted for so many looks did not fail."""
SHARES: Final = (1, 3 / 4, 1 / 2, 1 / 3, 1 / 4, 1 / 6, 1 / 8, 1 / 12, 1 / 16, 1 / 24, 1 / 32, 1 / 48, 1 / 64)
"""Shares of the requested speed that are tried; at 3 m/s and the last one a flight takes a minute."""
ROUNDING: Final = 1.01


@dataclass(slots=True)
class AdaptiveRate:
    """What share of the speed that is asked for the simulation runs at. Times are seconds on the wall."""

    share: float = 1.0
    """One of `SHARES`."""
    _patience: int = FIRST_TRIAL_BLOCKS
    _simulated_s: float = 0.0
    _worked_s: float = 0.0
    _waited_s: float = 0.0
    _slow: int = 0
    _easy: int = 0
    _looks: int = 0
    """At this pace."""
    _trying: bool = False
    """Whether this speed is being tried after a slower one."""

    def ask_anew(self) -> None:
        """Another speed is asked for, or another scene: forget what was learnt."""
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
    """A pace as people say it: "real time", "3/4 speed", "1/2 speed", "3 x real time"."""
    if abs(factor - 1.0) < 1e-9:
        return "real time"
    if abs(factor - 0.75) < 1e-9:
        return "3/4 speed"
    if factor < 1.0:
        parts = 1.0 / factor
        return f"1/{parts:.0f} speed" if abs(parts - round(parts)) < 0.02 * parts else f"{factor:.2g} x real time"
    return f"{factor:g} x real time"
