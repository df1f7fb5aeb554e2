"""The landing model without networks, with the known law of reflection: for noisy states and rackets.

After each ball the model's numbers are fitted anew. The actor, one layer of fixed random features, then takes a step of
Gauss and Newton towards strokes that land, by the model and for the posterior mean of the state, near drawn targets. A
stroke beyond what the racket can do counts as the one that it can: at 9 m/s a seventh of all targets is out of reach.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.agent import Losses, StageProgress
from core.learning.agents.policy import Policy
from core.learning.agents.process_agent import (
    FeatureActor,
    draw_situations,
    landings_of,
    replay_states,
    sampling_box,
    velocities_after,
)
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import EnvironmentConfig, RunConfig
from core.learning.task.environment import draw_goals
from core.learning.task.normalise import STATE_CENTRE, STATE_SCALE
from core.physics.rotation import normals_from_orientations, orientations_from_actions
from core.physics.task import StrokeConfig

Array = NDArray[np.float64]

FEWEST_FOR_SPREAD: Final = 20
"""Fewest balls for an estimate of their spread."""
VARIED: Final = slice(1, 6)
"""Parts of the state that vary and are noisy: p_c lies in the hitting plane."""


class StatePosterior:
    """Maps perceived states to posterior means."""

    def __init__(self, perceived: Array, environment: EnvironmentConfig) -> None:
        """Fit the prior to states (N, 6) of earlier balls."""
        self._position_m, self._velocity = environment.position_noise_m, environment.velocity_noise
        self._knows_noise = environment.state_source == "truth+noise" and len(perceived) >= FEWEST_FOR_SPREAD
        if self._knows_noise:
            known = perceived[:, VARIED]
            self._mean = known.mean(axis=0)
            # Balls scatter at least as much as the noise alone.
            noise = self._variances(perceived).mean(axis=0)
            scale = np.sqrt(noise + 1e-12)
            values, vectors = np.linalg.eigh(np.cov(known.T) / np.outer(scale, scale))
            self._precision = (vectors / np.maximum(values, 1.0)) @ vectors.T / np.outer(scale, scale)

    def __call__(self, perceived: Array) -> Array:
        """Posterior means (N, 6) of perceived states (N, 6)."""
        if not self._knows_noise:
            return perceived
        believed = perceived.copy()
        believed[:, VARIED] -= self._variances(perceived) * ((perceived[:, VARIED] - self._mean) @ self._precision)
        return believed

    def _variances(self, perceived: Array) -> Array:
        """(N, 5) noise variance of each part."""
        speeds = np.linalg.norm(perceived[:, 3:6], axis=1, keepdims=True)
        position_m = np.full((len(perceived), 2), self._position_m)
        return np.hstack([position_m, np.repeat(self._velocity * speeds, 3, axis=1)]) ** 2


GUESS: Final = np.array([0.7, 0.6] + 12 * [0.0])
"""Prior: share of speed kept along the rubber, share given back across it, no spin."""
TRUST: Final = 1e-3
"""Weight of the prior in balls (choice, as all here on seeds 100 to 107)."""
ODD: Final = 4.0
"""A ball whose error is this many times the median error is an outlier and is dropped."""
MIN_MPS: Final = 0.005
"""Errors below this never make an outlier, m/s."""
ROUNDS: Final = 3
"""Rounds of rejecting outliers and fitting the rest."""


class ReflectionModel:
    """Predicts the velocity after a stroke, fitted to observed balls."""

    def __init__(
        self, states: Array, racket_mps: Array, actions: Array, velocities: Array, stroke: StrokeConfig
    ) -> None:
        """Fit to states (N, 6), racket speeds (N,), actions (N, 3) and velocities after the hit (N, 3).

        Args:
            states: (N, 6) position and velocity at the racket, m, m/s.
            racket_mps: (N,) racket speeds along +x.
            actions: (N, 3) in [-1, 1].
            velocities: (N, 3) of the ball after the hit, m/s.
            stroke: base orientation and action limit.
        """
        self._stroke = stroke
        parts = self._parts(states, racket_mps, actions)
        wanted = velocities - _along_x(racket_mps)
        sound = np.ones(len(states), np.bool_)
        for _ in range(ROUNDS):
            a, b = parts[sound].reshape(-1, len(GUESS)), wanted[sound].ravel()
            self.numbers = np.linalg.solve(a.T @ a + TRUST * np.eye(len(GUESS)), a.T @ b + TRUST * GUESS)
            off_mps = np.linalg.norm(wanted - parts @ self.numbers, axis=1)
            self.scatter_mps = float(np.median(off_mps[sound]))
            sound = off_mps < ODD * (self.scatter_mps + MIN_MPS)

    def __call__(self, states: Array, racket_mps: Array, actions: Array) -> Array:
        """(N, 3) velocities after the stroke."""
        return _along_x(racket_mps) + self._parts(states, racket_mps, actions) @ self.numbers

    def _parts(self, states: Array, racket_mps: Array, actions: Array) -> Array:
        """(N, 3, 14) regressors of the model's numbers, in the racket's frame."""
        normals = normals_from_orientations(orientations_from_actions(actions, self._stroke))
        arriving = states[:, 3:6] - _along_x(racket_mps)
        towards = (arriving * normals).sum(axis=1, keepdims=True) * normals
        turned = np.cross(np.eye(3)[:, None], normals)  # for spin about x, y, z
        scaled = (states[:, 3:6] - STATE_CENTRE[3:]) / STATE_SCALE[3:]
        with_velocity = [one * scaled[:, [k]] for one in turned for k in range(3)]
        return np.stack([arriving - towards, -towards, *turned, *with_velocity], axis=2)


def _along_x(speeds_mps: Array) -> Array:
    return np.column_stack([speeds_mps, np.zeros((len(speeds_mps), 2))])


FEWEST_BALLS: Final = 4
"""Fewest balls that landed behind the net before the actor is optimised."""
FEATURE_SCALE: Final = 0.2
"""Standard deviation of the features' weights (choice, as all here on seeds 100 to 107): wide, so smooth."""
SITUATIONS: Final = 1500
"""Number of situations, redrawn for every step."""
FIRST_STEPS, STEPS = 6, 1
"""Steps of the first optimisation, and after each further ball."""
NEAR_M: Final = 0.01
"""Farther from the target the distance counts, nearer its square: misses out of reach must not pull at all others."""
DAMPING: Final = 300.0
"""Damping of a step's change of the actions, so that the actor averages over many steps."""
RIDGE: Final = 1e-6
"""Keeps the normal equations regular."""
SLOPE_STEP: Final = 1e-4
"""Step of the finite differences of actions, which are in [-1, 1]."""


class ReflectionAgent:
    """Learns tilt and turn of the racket's face; it never rolls it."""

    def __init__(self, config: RunConfig, rng: np.random.Generator) -> None:
        self._run, self._goal = config, config.environment.goal
        self._actor = FeatureActor(FEATURE_SCALE, rng)

    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """mu(s, v_racket, g), (N, 3)."""
        return self._actor.act(states, racket_speeds_mps, goals_m)

    def learn(self, buffer: ReplayBuffer, progress: StageProgress, rng: np.random.Generator) -> Losses:
        """Refit the model and improve the actor: after every ball early in a stage, less and less often later."""
        every = 1 + progress.episode // self._run.landing_model.full_episodes
        if progress.episode % every != 0:
            return Losses(math.nan, math.nan)
        posterior = StatePosterior(buffer.column("state").astype(np.float64), self._run.environment)
        model = self._fit_model(buffer, posterior)
        if model is None:
            return Losses(math.nan, math.nan)
        off_m = math.nan
        for _ in range(STEPS if self._actor.outputs.any() else FIRST_STEPS):
            off_m = self._step(model, posterior, buffer, rng)
        return Losses(model.scatter_mps, off_m)

    def _fit_model(self, buffer: ReplayBuffer, posterior: StatePosterior) -> ReflectionModel | None:
        balls = replay_states(buffer)
        states = posterior(balls.states)
        velocities = velocities_after(states, balls.landings_m, balls.net_z_m)
        found = np.isfinite(velocities).all(axis=1)
        if found.sum() < FEWEST_BALLS:
            return None
        rackets, actions = balls.racket_mps[found], balls.actions[found]
        return ReflectionModel(states[found], rackets, actions, velocities[found], self._run.environment.task.stroke)

    def _step(
        self, model: ReflectionModel, posterior: StatePosterior, buffer: ReplayBuffer, rng: np.random.Generator
    ) -> float:
        """Improve the actor on new situations; returns its mean landing error, m."""
        perceived, rackets = draw_situations(buffer, SITUATIONS, rng)
        goals = draw_goals(SITUATIONS, sampling_box(self._goal), rng)
        states, features = posterior(perceived), self._actor.features(perceived, rackets, goals)
        wanted = features @ self._actor.outputs
        actions = np.clip(wanted, -1.0, 1.0)

        def off_m(played: Array) -> Array:
            return landings_of(states, model(states, rackets, played)) - goals

        off = off_m(actions)
        slopes = [_slope(off_m, actions, off, k) for k in (1, 2)]
        # Actions beyond the racket's range have no effect, unless the target pulls them back.
        for k, slope in enumerate(slopes, start=1):
            beyond = wanted[:, k] - actions[:, k]
            slope[beyond * (slope * off).sum(axis=1) < 0] = 0.0
        distances = np.hypot(*off.T)
        counts = 1 / np.sqrt(distances**2 + NEAR_M**2)
        self._actor.outputs[:, 1:] -= _damped_step(features, slopes, off, counts)
        return float(distances.mean())

    def policy(self) -> Policy:
        """The actor by itself."""
        return self._actor.policy(self._run)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """The actor; the model is made of the buffer."""
        return self._actor.to_arrays()

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Load what `to_arrays` gave.

        Raises:
            KeyError, ValueError: if they are another agent's.
        """
        self._actor.restore(arrays)


def _slope(off_m: Callable[[Array], Array], actions: Array, off: Array, k: int) -> Array:
    """(N, 2) derivative of `off` by action k, one-sided towards the middle of the range."""
    inwards = np.where(actions[:, k] > 0, -SLOPE_STEP, SLOPE_STEP)
    moved = actions.copy()
    moved[:, k] += inwards
    return (off_m(moved) - off) / inwards[:, None]


def _damped_step(features: Array, slopes: list[Array], off: Array, counts: Array) -> Array:
    """(F, 2) by which outputs lessen the counted squares of `off` (N, 2), given how it moves with each action."""
    f = features.shape[1]
    root = np.sqrt(counts)[:, None]
    # Both coordinates of a landing depend on both actions.
    x, y = (np.hstack([features * (root * slope)[:, [part]] for slope in slopes]) for part in (0, 1))
    normal = x.T @ x + y.T @ y
    still = DAMPING * features.T @ features / len(features)
    for k in (0, 1):
        one = slice(k * f, (k + 1) * f)
        normal[one, one] += still
    pull = x.T @ (root[:, 0] * off[:, 0]) + y.T @ (root[:, 0] * off[:, 1])
    step = np.linalg.solve(normal + RIDGE * np.eye(2 * f), pull)
    return np.asarray(step.reshape(2, f).T, np.float64)
