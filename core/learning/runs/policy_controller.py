"""A trained policy as the controller of a live rally: the same state, action and racket speed as in its training."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.chain.control.controller import BuiltInController, RacketDecision
from core.chain.control.hit_choice import StrokeModel
from core.errors import ConfigError
from core.learning.config import StateKind
from core.learning.runs.run_files import load_policy, read_run
from core.learning.task.environment import racket_speeds_of
from core.physics import PhysicsConfig, TaskConfig
from core.physics.rotation import base_orientation, orientations_from_actions
from core.physics.task import HitRule
from core.simulation.episodes.racket import target_for_ball
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M
from core.trajectory.prediction import Stage

Array = NDArray[np.float64]


class StrokePolicy(Protocol):
    """What a stroke needs of a policy."""

    @property
    def state(self) -> StateKind:
        """What it has to know of a ball."""
        ...

    @property
    def chooses_speed(self) -> bool:
        """Whether its actions have a fourth part, the racket's speed."""
        ...

    def act(self, state: ArrayLike, goal_m: ArrayLike) -> Array:
        """The action for one perceived ball and a target (2,)."""
        ...

    def racket_speed_mps(self, state: ArrayLike) -> float:
        """How fast the racket is to move along +x, where the action does not say."""
        ...


class PolicyController:
    """As in the paper: the racket moves early with its base orientation, the policy turns it after the bounce."""

    def __init__(
        self, policy: StrokePolicy, task: TaskConfig, goal_m: ArrayLike, name: str = "policy", hit: HitRule = "paper"
    ) -> None:
        """A controller of this policy; base orientation, action limit and hitting plane are those of `task`.

        Args:
            policy: what chooses the action for a state.
            task: the task that it was trained for.
            goal_m: (2,) x, y of the wanted landing, m, world.
            name: what messages call it.
            hit: where it was trained to meet balls.

        Raises:
            ConfigError: if the goal (2,) is not on the opponent's half.
        """
        self.policy, self.task, self.name = policy, task, name
        self.hit: HitRule = hit
        goal = np.asarray(goal_m, np.float64)
        on_half = goal.shape == (2,) and 0 < goal[0] < TABLE_LENGTH_M / 2 and abs(goal[1]) < TABLE_WIDTH_M / 2
        if not on_half:
            raise ConfigError("not a goal", expected="x, y on the opponent's half", got=goal.tolist(), where="goal_m")
        self._goal = goal
        self._model = BuiltInController(task).aimed_at(goal) if hit == "chosen" else None

    @property
    def goal_m(self) -> Array:
        """(2,) where balls are to land."""
        return self._goal

    @property
    def needs_spin(self) -> bool:
        """Whether it was trained on states with spin."""
        return self.policy.state == "spin"

    def aimed_at(self, goal_m: ArrayLike) -> PolicyController:
        """The policy with another landing point."""
        return PolicyController(self.policy, self.task, goal_m, self.name, self.hit)

    def strokes(self) -> StrokeModel | None:
        """How a ball could be hit at several places; None for a policy that was trained at the hitting plane only.

        The places are judged by the built-in controller's strokes, as in the training.
        """
        return None if self._model is None else self._model.strokes()

    def for_physics(self, physics: PhysicsConfig) -> PolicyController:
        """Itself: the policy keeps the physics that it was trained with."""
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
        """The decision for a ball predicted at the hitting plane; None for one that does not come.

        In the paper the spin is no part of the state. A policy whose states have it answers no ball without; a spin
        that comes without a standard deviation is exact.

        Args:
            t_c_s: when the ball is at the hitting plane, s.
            p_c_m: (3,) where, m, world.
            v_c_mps: (3,) its velocity there, m/s, world.
            stage: "pre" or "post": before or after the bounce.
            spin_radps: (3,) spin there, rad/s, world.
            spin_sigma_radps: (3,) its standard deviations; None: exact.
        """
        p, v = np.asarray(p_c_m, np.float64), np.asarray(v_c_mps, np.float64)
        if not (math.isfinite(t_c_s) and np.isfinite(p).all() and np.isfinite(v).all() and v[0] < 0):
            return None
        if self.needs_spin and spin_radps is None:
            return None
        state = np.concatenate([p, v])
        v_racket = np.array([self.policy.racket_speed_mps(state), 0.0, 0.0])
        q, action = base_orientation(self.task.stroke), np.zeros(3)
        # As in the paper: before the bounce the racket only moves there, the orientation is decided after it.
        if stage == "post":
            known = state
            if self.needs_spin:
                assert spin_radps is not None
                sigma = np.zeros(3) if spin_sigma_radps is None else np.asarray(spin_sigma_radps, np.float64)
                known = np.concatenate([state, np.asarray(spin_radps, np.float64), sigma])
            action = np.clip(self.policy.act(known, self._goal), -1.0, 1.0)
            if self.policy.chooses_speed:
                v_racket[0] = racket_speeds_of(action[None], v_racket[:1])[0]
                action = action[:3]
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

    Args:
        run: folder of the training run.
        seed: which of its seeds; None: the first.
        which: the policy at the end, or the one with the best evaluation.
        goal_m: (2,) x, y of the wanted landing, m; None: the middle of the run's targets.
        name: what messages call it.

    Raises:
        ConfigError: if there is no such run, or it has no policy yet.
    """
    config = read_run(run)
    goal = config.environment.goal.centre_m if goal_m is None else goal_m
    policy = load_policy(run, seed, which)
    if policy.state != config.environment.state:
        raise ConfigError(
            "a policy for other states than its run has",
            expected=config.environment.state,
            got=policy.state,
            where=run,
            remedy="take the run that it was trained in",
        )
    environment = config.environment
    return PolicyController(policy, environment.task, goal, name or run.name, environment.hit)
