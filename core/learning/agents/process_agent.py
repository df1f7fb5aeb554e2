"""The landing model without networks: a Gaussian process of the stroke, and an actor that is solved for, not descended.

After each ball the process is fitted anew. Strokes that send drawn situations to drawn targets are found through it by
Newton's method, and the actor, one layer of fixed random features, is the ridge regression over them: a policy as any
other, in milliseconds and without torch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.agent import Losses, StageProgress
from core.learning.agents.feature_actor import FEATURES, FeatureActor
from core.learning.agents.gaussian_process_model import (
    GaussianProcessModel,
    landings_of,
    stroke_inputs,
    velocities_after,
)
from core.learning.agents.policy import Policy
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import GoalConfig, RunConfig
from core.learning.task.environment import draw_goals
from core.learning.task.normalise import STATE_SCALE

Array = NDArray[np.float64]

FEWEST_BALLS: Final = 4
"""Fewest balls that landed behind the net before strokes are solved for."""
MAX_BALLS: Final = 400
"""Most balls, the newest; the cost grows with the cube of their number."""
FEATURE_SCALE: Final = 0.3
"""Standard deviation of the features' weights (choice, as all here on seeds 100 to 104): wide, so smooth."""
RIDGE: Final = 1e-6
SITUATIONS: Final = 1200
"""Number of situations for which strokes are solved."""
BEYOND: Final = 0.2
"""Situations lie on lines through two balls, up to this share of their distance outside."""
JITTER: Final = 0.02
"""Jitter in units of the state's scale, so that situations differ in all directions even after few balls."""
NEWTON_STEPS: Final = 5
LONGEST_STEP: Final = 0.4
LARGEST_ACTION: Final = 1.1
"""Largest action of a solution, slightly more than the racket's range: the actor is clipped there but has to be
smooth."""
CLOSE_M: Final = 0.005
"""A solution farther from the target than this is not used as an example."""


class ProcessAgent:
    """Learns tilt and turn of the racket's face; it never rolls it, which changes nothing."""

    def __init__(self, config: RunConfig, rng: np.random.Generator) -> None:
        self._run, self._goal = config, config.environment.goal
        self._actor = FeatureActor(FEATURE_SCALE, rng)

    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """mu(s, v_racket, g), (N, 3)."""
        return self._actor.act(states, racket_speeds_mps, goals_m)

    def learn(self, buffer: ReplayBuffer, progress: StageProgress, rng: np.random.Generator) -> Losses:
        """Refit process and actor: after every ball early in a stage, less and less often later."""
        every = 1 + progress.episode // self._run.landing_model.full_episodes
        process, mean_off_m = None, math.nan
        if progress.episode % every == 0:
            process = _process_of(buffer)
        if process is not None:
            mean_off_m = self._solve(process, buffer, rng)
            return Losses(process.noise_mps, mean_off_m)
        return Losses(math.nan, math.nan)

    def _solve(self, process: GaussianProcessModel, buffer: ReplayBuffer, rng: np.random.Generator) -> float:
        """Solve for a new actor; returns its mean landing error by the process, m."""
        states, speeds = draw_situations(buffer, SITUATIONS, rng)
        goals = draw_goals(SITUATIONS, sampling_box(self._goal), rng)
        actions = self.act(states, speeds, goals)
        actions[:, 0] = 0.0
        off = np.empty((SITUATIONS, 2))
        for _ in range(NEWTON_STEPS):
            velocities, slopes = process(stroke_inputs(states, speeds, actions))
            off = landings_of(states, velocities) - goals
            eps = 1e-4
            moved = [(landings_of(states, velocities + eps * slopes[:, :, k]) - goals - off) / eps for k in (0, 1)]
            step = _solve_pairs(moved[0], moved[1], off)
            actions[:, 1:] = np.clip(
                actions[:, 1:] - np.clip(step, -LONGEST_STEP, LONGEST_STEP), -LARGEST_ACTION, LARGEST_ACTION
            )
        velocities, _ = process(stroke_inputs(states, speeds, actions))
        off_m = np.hypot(*(landings_of(states, velocities) - goals).T)
        solved = (off_m < CLOSE_M) & (np.abs(actions).max(axis=1) < LARGEST_ACTION)
        features = self._actor.features(states[solved], speeds[solved], goals[solved])
        normal = features.T @ features + RIDGE * np.eye(FEATURES + 1)
        self._actor.outputs[...] = np.linalg.solve(normal, features.T @ actions[solved])
        velocities, _ = process(stroke_inputs(states, speeds, self.act(states, speeds, goals)))
        return float(np.hypot(*(landings_of(states, velocities) - goals).T).mean())

    def policy(self) -> Policy:
        """The actor by itself."""
        return self._actor.policy(self._run)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """The actor; the process is made of the buffer."""
        return self._actor.to_arrays()

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Load what `to_arrays` gave.

        Raises:
            KeyError, ValueError: if they are another agent's.
        """
        self._actor.restore(arrays)


@dataclass(frozen=True, slots=True, eq=False)
class ReplayStates:
    """Balls that crossed the net and landed: their known states and outcomes."""

    states: Array
    racket_mps: Array
    actions: Array
    landings_m: Array
    net_z_m: Array


def replay_states(buffer: ReplayBuffer) -> ReplayStates:
    """Those of a buffer, the oldest first."""
    known = buffer.column("known").all(axis=1)
    columns = ("state", "racket_speed", "action", "next_state", "net_z")
    states, racket, actions, after, net_z = (buffer.column(name)[known].astype(np.float64) for name in columns)
    return ReplayStates(states, racket[:, 0], actions, after[:, :2], net_z[:, 0])


def _process_of(buffer: ReplayBuffer) -> GaussianProcessModel | None:
    """Model fitted to the newest balls that crossed the net and landed; None while there are too few."""
    balls = replay_states(buffer)
    velocities = velocities_after(balls.states, balls.landings_m, balls.net_z_m)
    which = np.flatnonzero(np.isfinite(velocities).all(axis=1))[-MAX_BALLS:]
    if len(which) < FEWEST_BALLS:
        return None
    return GaussianProcessModel(
        stroke_inputs(balls.states[which], balls.racket_mps[which], balls.actions[which]), velocities[which]
    )


def draw_situations(buffer: ReplayBuffer, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """States (count, 6) and racket speeds (count,) like those of the balls."""
    states, speeds = (buffer.column(name).astype(np.float64) for name in ("state", "racket_speed"))
    one, other = rng.integers(0, len(buffer), (2, count))
    share = rng.uniform(-BEYOND, 1 + BEYOND, (count, 1))
    drawn = states[one] + share * (states[other] - states[one])
    jitter = JITTER * STATE_SCALE * rng.standard_normal((count, 6))
    return drawn + jitter, (speeds[one] + share * (speeds[other] - speeds[one]))[:, 0]


def sampling_box(goal: GoalConfig) -> GoalConfig:
    """The whole box of targets, even if only its middle is the target."""
    return GoalConfig(low_x_m=goal.low_x_m, high_x_m=goal.high_x_m, half_width_m=goal.half_width_m)


def _solve_pairs(a: Array, b: Array, right: Array) -> Array:
    """(N, 2) x of a x_0 + b x_1 = right, all (N, 2); zero where that has no answer."""
    scale = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    scale = np.where(np.abs(scale) < 1e-9, np.inf, scale)
    first = (right[:, 0] * b[:, 1] - right[:, 1] * b[:, 0]) / scale
    return np.column_stack([first, (a[:, 0] * right[:, 1] - a[:, 1] * right[:, 0]) / scale])
