"""A trained policy as the controller of a live rally: the same state, action and racket speed as in its training."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.learning.agents.policy import Policy
from core.learning.runs.run_files import load_policy, read_run
from core.physics import PhysicsConfig, TaskConfig
from core.physics.rotation import base_orientation, orientations_from_actions
from core.rally.control.decision import RacketDecision
from core.simulation.episodes.racket import target_for_ball
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M
from core.trajectory.prediction import Stage

Array = NDArray[np.float64]


class PolicyController:
    """As in the paper: the racket moves early with its base orientation, the policy turns it after the bounce."""

    def __init__(self, policy: Policy, task: TaskConfig, goal_m: ArrayLike, name: str = "policy") -> None:
        """`task` is the one it was trained for: base orientation, action limit, hitting plane.

        Raises:
            ConfigError: if the goal (2,) is not on the opponent's half.
        """
        self.policy, self.task, self.name = policy, task, name
        goal = np.asarray(goal_m, np.float64)
        on_half = goal.shape == (2,) and 0 < goal[0] < TABLE_LENGTH_M / 2 and abs(goal[1]) < TABLE_WIDTH_M / 2
        if not on_half:
            raise ConfigError("not a goal", expected="x, y on the opponent's half", got=goal.tolist(), where="goal_m")
        self._goal = goal

    @property
    def goal_m(self) -> Array:
        """(2,) where balls are to land."""
        return self._goal

    def aimed_at(self, goal_m: ArrayLike) -> PolicyController:
        """The same policy with another goal."""
        return PolicyController(self.policy, self.task, goal_m, self.name)

    def for_physics(self, physics: PhysicsConfig) -> PolicyController:
        """The same: it knows what it was trained with."""
        return self

    def decide(
        self,
        t_c_s: float,
        p_c_m: ArrayLike,
        v_c_mps: ArrayLike,
        *,
        stage: Stage,
        spin_radps: ArrayLike | None = None,
    ) -> RacketDecision | None:
        """The decision for a ball predicted at the hitting plane; None for one that does not come.

        A policy does not know the spin: as in the paper, that is no part of its state.
        """
        p, v = np.asarray(p_c_m, np.float64), np.asarray(v_c_mps, np.float64)
        if not (math.isfinite(t_c_s) and np.isfinite(p).all() and np.isfinite(v).all() and v[0] < 0):
            return None
        state = np.concatenate([p, v])
        v_racket = np.array([self.policy.racket_speed_mps(state), 0.0, 0.0])
        q, action = base_orientation(self.task.stroke), np.zeros(3)
        if stage == "post":
            action = np.clip(self.policy.act(state, self._goal), -1.0, 1.0)
            q = orientations_from_actions(action, self.task.stroke)
        target = target_for_ball(p, q, v_racket, t_c_s)
        return RacketDecision(stage=stage, state=state, goal_m=self._goal, target=target, action=action)


def load_controller(
    run: Path,
    *,
    seed: int | None = None,
    which: Literal["last", "best"] = "last",
    goal_m: ArrayLike | None = None,
    name: str = "",
) -> PolicyController:
    """The policy of a training run as a controller, aimed at the middle of the run's targets unless told otherwise.

    Raises:
        ConfigError: if there is no such run, or it has no policy yet.
    """
    config = read_run(run)
    goal = config.environment.goal.centre_m if goal_m is None else goal_m
    policy = load_policy(run, seed, which)
    return PolicyController(policy, config.environment.task, goal, name or run.name)
