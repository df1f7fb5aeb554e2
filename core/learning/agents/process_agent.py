"""The landing model without networks: a Gaussian process of the stroke, and an actor that is solved for, not descended.

After each ball the process is fitted anew. Strokes that send drawn situations to drawn targets are found through it by
Newton's method, and the actor, one layer of fixed random features, is the ridge regression over them: a policy as any
other, in milliseconds and without torch.

Model of the stroke as a Gaussian process, learned from balls; only gravity is given. Where a ball came down and how
high it crossed the net tell with what velocity it left the racket. That velocity is a smooth function of the one it
came with, of the racket's angles and of its speed: the law of reflection, which is learned here and not told.
(Regression as in Rasmussen and Williams 2006, chapters 2 and 5.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.agent import Losses, StageProgress
from core.learning.agents.policy import Policy
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import GoalConfig, RunConfig
from core.learning.task.environment import draw_goals, racket_table
from core.learning.task.normalise import STATE_CENTRE, STATE_SCALE, normal_observations, normal_racket_speeds
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]

FEATURES: Final = 256


class FeatureActor:
    """mu(s, v_racket, g) from features tanh(W o + b); `outputs` (FEATURES + 1, 3) are zero at first."""

    def __init__(self, scale: float, rng: np.random.Generator) -> None:
        """Weights of the features have this standard deviation."""
        self._weights = rng.normal(0.0, scale, (9, FEATURES))
        self._biases = rng.normal(0.0, 1.0, FEATURES)
        self.outputs: Array = np.zeros((FEATURES + 1, 3))

    def features(self, states: Array, speeds_mps: Array, goals_m: Array) -> Array:
        """(N, FEATURES + 1) of states (N, 6), racket speeds (N,) and goals (N, 2); the last one is 1."""
        observations = normal_observations(states, goals_m, speeds_mps).astype(np.float64)
        return np.column_stack([np.tanh(observations @ self._weights + self._biases), np.ones(len(states))])

    def act(self, states: Array, speeds_mps: Array, goals_m: Array) -> Array:
        """(N, 3) actions, within the racket's range."""
        return np.clip(self.features(states, speeds_mps, goals_m) @ self.outputs, -1.0, 1.0)

    def policy(self, run: RunConfig) -> Policy:
        """The actor as a policy for a run's policy file."""
        incoming, racket = racket_table(run)
        hidden = self._weights.astype(np.float32), self._biases.astype(np.float32)
        output = self.outputs[:-1].astype(np.float32), self.outputs[-1].astype(np.float32)
        return Policy((hidden, output), "tanh", "clip", True, incoming, racket)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Complete state, for a checkpoint."""
        return {"weights": self._weights, "biases": self._biases, "outputs": self.outputs}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Load what `to_arrays` gave.

        Raises:
            KeyError, ValueError: if they are another agent's.
        """
        for name, now in self.to_arrays().items():
            now[...] = arrays[name]


AMPLITUDE_MPS: Final = 3.0
"""Prior standard deviation of the velocity's constant, linear and curved part each (choice: wide)."""
LENGTHS: Final = (2.0, 4.0)
"""Candidate length scales, in units of the inputs, which are about 1; the likelier one is used."""
NOISES_MPS: Final = (1e-3, 1e-2, 0.03, 0.1, 0.3)
"""Candidates of the residual noise, chosen likewise: 1 mm/s with the true state, some cm/s with a perceived state."""
ODD: Final = 5.0
"""A ball more standard deviations than this from its leave-one-out prediction is an outlier and is dropped."""
SLOWEST_MPS: Final = 0.3
"""Lower bound of the speed: slower balls do not come near the net."""


def stroke_inputs(states: Array, racket_mps: Array, actions: Array) -> Array:
    """(N, 7) velocity, angles and racket speed, scaled, of states (N, 6), speeds (N,) and actions (N, 3)."""
    velocities = (states[:, 3:6] - STATE_CENTRE[3:]) / STATE_SCALE[3:]
    speeds = normal_racket_speeds(racket_mps)[:, None].astype(np.float64)
    return np.concatenate([velocities, actions, speeds], axis=1)


def velocities_after(states: Array, landings_m: Array, net_z_m: Array) -> Array:
    """(N, 3) with which balls left the racket at (N, 6), came down at (N, 2) and crossed the net at a height (N,).

    NaN where no parabola does that.
    """
    p, drop_m = states[:, :3], BALL_RADIUS_M - states[:, 2]
    away_m = landings_m - p[:, :2]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = -p[:, 0] / away_m[:, 0]  # of the flight, at the net
        rise_m = net_z_m - p[:, 2] - share * drop_m
        t = np.sqrt(2 * rise_m / (GRAVITY_MPS2 * share * (1 - share)))
        return np.column_stack([away_m / t[:, None], drop_m / t + GRAVITY_MPS2 * t / 2])


def landings_of(states: Array, velocities: Array) -> Array:
    """(N, 2) where balls that leave states (N, 6) with velocities (N, 3) come down to the table's plane."""
    up = velocities[:, 2]
    down = np.sqrt(np.maximum(up**2 + 2 * GRAVITY_MPS2 * (states[:, 2] - BALL_RADIUS_M), SLOWEST_MPS**2))
    return states[:, :2] + velocities[:, :2] * ((up + down) / GRAVITY_MPS2)[:, None]


class GaussianProcessModel:
    """Predicts the velocity after a stroke from at least two observed balls."""

    def __init__(self, inputs: Array, velocities: Array) -> None:
        """Fit to `stroke_inputs` (N, 7) and `velocities_after` (N, 3), all finite."""
        self._fit(inputs, velocities)
        if (sound := ~self._odd_ones()).sum() >= 2 and not sound.all():
            self._fit(inputs[sound], velocities[sound])

    def _fit(self, inputs: Array, velocities: Array) -> None:
        self._inputs, self._mean = inputs, velocities.mean(0)
        off, likeliest = velocities - self._mean, -np.inf
        for length in LENGTHS:
            prior = _covariances(inputs, inputs, length)
            for noise in NOISES_MPS:
                root = np.linalg.cholesky(prior + noise**2 * np.eye(len(inputs)))
                inverse = np.linalg.inv(root)
                weights = inverse.T @ (inverse @ off)
                evidence = -0.5 * (off * weights).sum() - off.shape[1] * np.log(np.diag(root)).sum()
                if evidence > likeliest:
                    likeliest, self.length, self.noise_mps = evidence, length, noise
                    self._weights, self._precision = weights, (inverse**2).sum(0)

    def _odd_ones(self) -> NDArray[np.bool_]:
        """(N,) whether each ball is an outlier by leave-one-out prediction."""
        off_sigmas = np.abs(self._weights) / np.sqrt(self._precision)[:, None]
        return (off_sigmas > ODD).any(axis=1)

    def __call__(self, inputs: Array) -> tuple[Array, Array]:
        """(M, 3) velocities, and (M, 3, 2) their derivatives by the last two angles."""
        curved = _curved(inputs, self._inputs, self.length)
        linear = AMPLITUDE_MPS**2 * self._inputs.T @ self._weights
        constant = self._mean + AMPLITUDE_MPS**2 * self._weights.sum(0)
        slopes = []
        for k in (4, 5):
            towards = curved * (self._inputs[:, k] - inputs[:, k, None])
            slopes.append(towards @ self._weights / self.length**2 + linear[k])
        return constant + inputs @ linear + curved @ self._weights, np.stack(slopes, axis=2)


def _curved(a: Array, b: Array, length: float) -> Array:
    square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    return AMPLITUDE_MPS**2 * np.exp(-0.5 * np.maximum(square, 0.0) / length**2)


def _covariances(a: Array, b: Array, length: float) -> Array:
    return _curved(a, b, length) + AMPLITUDE_MPS**2 * (1 + a @ b.T)


FEWEST_BALLS: Final = 4
"""Fewest balls that landed behind the net before strokes are solved for."""
MAX_BALLS: Final = 400
"""Most balls, the newest; the cost grows with the cube of their number."""
FEATURE_SCALE: Final = 0.3
"""Standard deviation of the features' weights (choice, as all here on seeds 100 to 104): wide, so smooth."""
RIDGE: Final = 1e-6
"""Keeps the normal equations regular where two features are alike."""
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
    """The balls of a buffer that crossed the net and landed, the oldest first."""
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
