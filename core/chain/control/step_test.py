"""How long a command takes to become motion: the racket is sent to and fro, and when it is halfway tells.

A rest-to-rest motion is symmetric in time, so it is halfway in the middle between the instant at which the racket heard
of it and the one at which it is there. Nothing but the robot's own reported places is needed, no model of its motors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError

Array = NDArray[np.float64]

FEWEST: Final = 3
"""Steps of a test: fewer say nothing of the jitter."""


@dataclass(frozen=True, slots=True, eq=False)
class RacketStep:
    """One motion from rest to rest."""

    sent_s: float
    due_s: float
    """When it was to be there."""
    from_m: Array
    """(3,)."""
    to_m: Array
    """(3,)."""
    t_s: Array
    """(N,) of the reported places, until after it came to rest."""
    ps_m: Array
    """(N, 3)."""

    @property
    def late_s(self) -> float:
        """By how much it was late; nan if it never was halfway.

        Raises:
            ConfigError: if the step has no length.
        """
        way = self.to_m - self.from_m
        length = float(way @ way)
        if not length > 0:
            raise ConfigError("a step without a length", got=self.to_m.tolist(), where="step test")
        share = (self.ps_m - self.from_m) @ way / length
        past = np.flatnonzero(share >= 0.5)
        if not len(past) or past[0] == 0:
            return math.nan
        after = int(past[0])
        low, high = share[after - 1], share[after]
        halfway_s = self.t_s[after - 1] + (0.5 - low) / (high - low) * (self.t_s[after] - self.t_s[after - 1])
        return float(halfway_s - (self.sent_s + self.due_s) / 2)


@dataclass(frozen=True, slots=True)
class CommandLatency:
    """What a step test found."""

    mean_s: float
    sigma_s: float
    """Standard deviation of the mean."""
    jitter_s: float
    """Standard deviation from command to command."""
    steps: int


def command_latency(steps: Sequence[RacketStep]) -> CommandLatency:
    """From some steps.

    Raises:
        ConfigError: if too few of them went halfway.
    """
    late = np.array([step.late_s for step in steps])
    late = late[np.isfinite(late)]
    if len(late) < FEWEST:
        raise ConfigError("the racket did not move as it was told", expected=f"{FEWEST} steps", got=len(late))
    jitter = float(late.std(ddof=1))
    return CommandLatency(float(late.mean()), jitter / math.sqrt(len(late)), jitter, len(late))
