"""Controller with a learning policy and exploratory strokes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.chain.control.controller import RacketDecision
from core.learning.agents.policy import Policy
from core.learning.config import StateKind
from core.learning.runs.policy_controller import PolicyController
from core.physics import PhysicsConfig, TaskConfig
from core.trajectory.prediction import Stage

Array = NDArray[np.float64]
NAME = "learns while it plays"


@dataclass(frozen=True, slots=True, eq=False)
class ExploringPolicy:
    """Policy with exploration noise that is constant during the flight of one ball."""

    policy: Policy
    noise: Array
    """(3,), or (4,) with the racket's speed, added to the action."""
    random: Array | None
    """(3,) or (4,) in [-1, 1] in place of the policy's action."""

    @property
    def state(self) -> StateKind:
        """Kind of the ball's state that it needs."""
        return self.policy.state

    @property
    def chooses_speed(self) -> bool:
        """Whether its actions have the racket's speed."""
        return self.policy.chooses_speed

    def act(self, state: ArrayLike, goal_m: ArrayLike) -> Array:
        """The action, (3,) or (4,), for a state (6,) and a target (2,)."""
        if self.random is not None:
            return self.random
        return np.clip(self.policy.act(state, goal_m) + self.noise, -1.0, 1.0)

    def racket_speed_mps(self, state: ArrayLike) -> float:
        """Racket speed of the policy, m/s."""
        return self.policy.racket_speed_mps(state)


class StrokeSource(Protocol):
    """Gives the policy for each ball, and is notified of the decisions."""

    @property
    def task(self) -> TaskConfig:
        """Task of the learner."""
        ...

    def policy_for(self, t_c_s: float) -> ExploringPolicy:
        """The policy for the ball that is expected at the hitting plane at this time."""
        ...

    def decided(self, decision: RacketDecision) -> None:
        """Notify of a decision with that policy."""
        ...


class LearningController:
    """Plays with the learner's newest policy at the beginning of each flight."""

    name = NAME

    def __init__(self, source: StrokeSource, goal_m: ArrayLike) -> None:
        self._source = source
        self._goal = np.asarray(goal_m, np.float64)

    @property
    def goal_m(self) -> Array:
        """(2,) where balls are to land."""
        return self._goal

    def aimed_at(self, goal_m: ArrayLike) -> LearningController:
        """A controller of the same learner with another landing point."""
        return LearningController(self._source, goal_m)

    def for_physics(self, physics: PhysicsConfig) -> LearningController:
        """Itself: it learns the physics from the balls."""
        return self

    def decide(
        self,
        t_c_s: float,
        p_c_m: ArrayLike,
        v_c_mps: ArrayLike,
        *,
        stage: Stage,
        spin_radps: ArrayLike | None = None,
        spin_sigma_radps: ArrayLike | None = None,
    ) -> RacketDecision | None:
        """As a trained policy does; the spin is no part of what is learned.

        Args:
            t_c_s: when the ball is at the hitting plane, s.
            p_c_m: (3,) where, world.
            v_c_mps: (3,) its velocity there, world.
            stage: "pre" or "post": before or after the bounce.
            spin_radps: not used.
            spin_sigma_radps: not used.
        """
        policy = self._source.policy_for(t_c_s)
        decision = PolicyController(policy, self._source.task, self._goal).decide(t_c_s, p_c_m, v_c_mps, stage=stage)
        if decision is not None:
            self._source.decided(decision)
        return decision
