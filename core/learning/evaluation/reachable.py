"""Share of balls that any stroke within a task's bounds can return: whether the bounds limit a player."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from core.errors import RallyscopeError
from core.learning.config import CHOSEN_MPS, EnvironmentConfig
from core.learning.randomisation import RandomisationConfig
from core.learning.task.environment import play, validation_balls

BALLS: Final = 64
TILTS, TURNS, SPEEDS = 21, 5, 10
"""Size of the grid of strokes that are tried on each ball."""
WORTH_SAYING: Final = 0.95
"""Share above which the bounds do not limit a player."""


@dataclass(frozen=True, slots=True)
class Reachable:
    """Result for balls of one speed."""

    speed_mps: float
    share: float
    """Share of the balls that at least one stroke returns."""
    height_m: float
    """Median of the ball's centre above the table's top, where it is to be hit."""
    falling_deg: float
    """Median angle below the horizontal at which it comes there."""
    bounds: str
    """Text of the racket's bounds."""
    recorded: bool = False
    """Whether these are recorded balls, of any speed."""

    @property
    def words(self) -> str:
        """One line of text; empty if nearly every ball can be returned."""
        if self.share >= WORTH_SAYING:
            return ""
        above = f"{abs(100 * self.height_m):.0f} cm {'above' if self.height_m >= 0 else 'below'} the table's top"
        which = "of these recorded balls" if self.recorded else f"of these serves at {self.speed_mps:g} m/s"
        return (
            f"The racket's bounds ({self.bounds}) allow about {100 * self.share:.0f} % {which} to be returned: they "
            f"come {above} and {self.falling_deg:.0f} degrees downwards (medians)."
        )


@functools.lru_cache(maxsize=64)
def reachable(environment: EnvironmentConfig, speed_mps: float, balls: int = BALLS) -> Reachable:
    """The share of balls of a speed for which a stroke on a grid within the bounds comes back; a lower bound.

    The balls are such as policies are chosen by, known exactly, in the usual world, and the racket is there in time.

    Raises:
        ConfigError: if there are no balls of this speed.
        RecordingError: if recorded balls cannot be read.
    """
    chooses = environment.racket == "chosen"
    known = dataclasses.replace(
        environment,
        state_source="truth",
        outcomes="told",
        engine="closed-form",
        randomise=RandomisationConfig(),
        racket="chosen" if chooses else "table",
    )
    drawn = validation_balls(speed_mps, balls, known)
    speeds = np.linspace(-1, 1, SPEEDS) if chooses else np.zeros(1)
    sides = np.linspace(-1, 1, TILTS), np.linspace(-1, 1, TURNS), speeds
    strokes = np.array([(0.0, b, c, v) for b in sides[0] for c in sides[1] for v in sides[2]])[:, : 4 if chooses else 3]
    left = np.arange(len(drawn))
    for stroke in strokes[np.random.default_rng(0).permutation(len(strokes))]:  # most are returned early
        if not len(left):
            break
        some = drawn[left]
        left = left[~play(some, np.tile(stroke, (len(left), 1)), known).returned]
    arriving = drawn.arrivals.states
    falling = np.degrees(np.arctan2(-arriving[:, 5], -arriving[:, 3]))
    limit = f"+-{environment.task.stroke.action_limit_deg:g} degrees"
    low, high = CHOSEN_MPS if chooses else (float(drawn.racket_speeds_mps.min()), float(drawn.racket_speeds_mps.max()))
    speed = f"{low:.1f} m/s" if math.isclose(low, high) else f"{low:.1f} to {high:.1f} m/s"
    return Reachable(
        speed_mps,
        1 - len(left) / len(drawn),
        float(np.median(arriving[:, 2])),
        float(np.median(falling)),
        f"{limit}, {speed}",
        bool(environment.recorded),
    )


def reachable_words(environment: EnvironmentConfig, speeds_mps: Iterable[float]) -> tuple[str, ...]:
    """A line for each speed at which the racket's bounds are what limits; none where the balls cannot be had."""
    try:
        found = [reachable(environment, speed).words for speed in sorted(set(speeds_mps))]
    except RallyscopeError:
        return ()
    return tuple(words for words in found if words)
