"""Progress of online learning, one frozen row per ball; and a ball as a row of the replay buffer: state, action,
outcome.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from core.learning.config import CHOSEN_MPS, RunConfig
from core.learning.evaluation.policy_evaluator import really_seen
from core.learning.task.reward import episode_rewards, reward_weights
from core.live.live_snapshot import FinishedBall
from core.physics.episode import Case
from core.simulation.episodes.ball_outcome import BallOutcome, outcomes_of
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]
WINDOW: Final = 10
"""Number of balls in a median or share."""


@dataclass(frozen=True, slots=True)
class LearnedBall:
    """A ball that the learning policy played."""

    case: Case
    error_mm: float
    """From the target to the landing; NaN where the ball did not come down anywhere on its way."""
    learned: bool
    """Whether the policy chose the stroke, so that it could be learned from."""
    random: bool
    """Whether the stroke was a random one."""


@dataclass(frozen=True, slots=True, eq=False)
class LearningProgress:
    """Progress since learning began, or was reset."""

    start: str
    """Name of the run that it began from, or `start.NOTHING`."""
    balls: tuple[LearnedBall, ...]
    problem: str = ""
    """Why a ball was not learned from, if one was not for an unexpected reason."""

    @property
    def learned(self) -> int:
        """Balls that were learned from."""
        return sum(ball.learned for ball in self.balls)

    @property
    def returned(self) -> int:
        """Balls that came back."""
        return sum(ball.case is Case.RETURNED for ball in self.balls)

    @property
    def returned_lately(self) -> tuple[int, int]:
        """How many of the last balls came back, and how many those are."""
        last = self.balls[-WINDOW:]
        return sum(ball.case is Case.RETURNED for ball in last), len(last)

    def errors_mm(self) -> tuple[Array, Array]:
        """(N,) error of each ball and the median of it and those before it, `WINDOW` in all.

        A ball whose landing is not known counts there as farther away than any; NaN where the median is one of these.
        """
        errors = np.array([ball.error_mm for ball in self.balls], np.float64)
        far = np.where(np.isnan(errors), np.inf, errors)
        begun = [np.median(far[:end]) for end in range(1, min(WINDOW, len(far) + 1))]
        full = np.median(sliding_window_view(far, WINDOW), axis=1) if len(far) >= WINDOW else []
        medians = np.array([*begun, *full], np.float64)
        return errors, np.where(np.isfinite(medians), medians, np.nan)


LANDS: Final = (Case.OWN_HALF, Case.OUT, Case.RETURNED)
"""Cases of balls that land before they touch anything else."""


def landing_error_mm(ball: FinishedBall) -> float:
    """Distance from target to landing, mm; NaN for a ball that did not land, even if the simulation extrapolates it."""
    return 1000 * ball.error_m if ball.case in LANDS else math.nan


def transition_of_ball(
    ball: FinishedBall, config: RunConfig, actions: int, episode: int
) -> dict[str, NDArray[np.floating]]:
    """The row of a ball that was struck on a decision, with `actions` parts of an action; the `episode`-th, from 0."""
    decision = ball.decision
    assert decision is not None
    speed_mps = float(decision.target.v_mps[0])
    action = decision.action
    if actions == 4:
        low, high = CHOSEN_MPS
        action = np.append(action, 2 * (speed_mps - low) / (high - low) - 1)
    at = np.append(ball.landing_m, BALL_RADIUS_M)
    judged_ball = BallOutcome(ball.case, ball.t_us * 1e-6, at, np.full(3, np.nan), ball.net_z_m)
    outcome = outcomes_of(judged_ball, ball.serve_us * 1e-6)
    weights = reward_weights(episode, config.reward)
    return {
        "state": decision.state,
        "racket_speed": np.array([speed_mps]),
        "goal": ball.goal_m,
        "action": action,
        "reward": episode_rewards(outcome, ball.goal_m[None], weights, config.reward),
        # The landing velocity is unknown and not learned from, as is the position after a miss.
        "next_state": np.nan_to_num(outcome.landing_states[0, :6]),
        "case": np.array([float(ball.case)]),
        "net_z": outcome.net_z_m,
        "known": really_seen(outcome)[0].astype(np.float64),
    }
