"""The one-step task as a Gymnasium environment, `rallyscope/OneStepReturn-v0`, for third-party agents."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from core.learning.config import EnvironmentConfig, RewardConfig
from core.learning.evaluation.episode_record import landing_errors_mm
from core.learning.task.environment import ServeBatch, draw_serve_batch
from core.learning.task.episode_backend import ClosedFormBackend, EpisodeBackend
from core.learning.task.normalise import STATE_SIZES, normal_observations
from core.learning.task.reward import episode_rewards, reward_weights
from core.physics.episode import Case, Outcomes

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

ENVIRONMENT_ID = "rallyscope/OneStepReturn-v0"
WIDEST = 10.0
"""Bound of an observation; `normal_states` clips there."""
BATCH = 256
"""Balls drawn at a time."""


class OneStepReturn(gymnasium.Env[Floats, Floats]):
    """Observation (8,), with spin (14,): state and target normalised; action (3,) in [-1, 1]; one step, one episode."""

    metadata = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own declaration

    def __init__(
        self,
        speed_mps: float = 5.0,
        environment: EnvironmentConfig | None = None,
        reward: RewardConfig | None = None,
        deliveries: ServeBatch | None = None,
        backend: EpisodeBackend | None = None,
    ) -> None:
        """With `deliveries` exactly these balls are played, in this order, again from the first after the last.

        A `backend` serves, shows and plays them elsewhere than in the closed-form simulator.
        """
        self.environment = environment if environment is not None else EnvironmentConfig(state_source="truth")
        self.reward = reward if reward is not None else RewardConfig(kind="case")
        self.speed_mps = speed_mps
        size = STATE_SIZES[self.environment.state] + 2
        self.observation_space = gymnasium.spaces.Box(-WIDEST, WIDEST, (size,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.episodes = 0
        """Number of episodes so far, which the time-weighted reward depends on."""
        self.outcome: Outcomes | None = None
        """Outcome of the last episode."""
        self._backend = backend or ClosedFormBackend(self.environment)
        self._fixed = deliveries
        self._dealt = deliveries
        self._next = 0
        self._now: ServeBatch | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Serve the next ball and observe it."""
        super().reset(seed=seed)
        if seed is not None and self._fixed is None:
            self._dealt = None
        if seed is not None:
            self._backend.begin(seed)
        if self._dealt is None or self._next >= len(self._dealt):
            self._dealt = self._fixed or draw_serve_batch(self.speed_mps, BATCH, self.environment, self.np_random)
            self._next = 0
        self._now = self._backend.observe(self._dealt[self._next : self._next + 1])
        self._next += 1
        return self._observation(), {}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Play the stroke; the next observation is the same ball's, as the episode ends.

        Raises:
            RuntimeError: before the first `reset`.
        """
        if self._now is None:
            raise RuntimeError("step before reset")
        now = self._now
        outcome = self._backend.play(now, np.asarray(action, np.float64).reshape(1, 3))
        self.outcome = outcome
        weights = reward_weights(self.episodes, self.reward)
        reward = float(episode_rewards(outcome, now.goals_m, weights, self.reward)[0])
        self.episodes += 1
        return self._observation(), reward, True, False, self._about(now, outcome)

    def close(self) -> None:
        """Close the backend."""
        self._backend.close()

    def _observation(self) -> Floats:
        assert self._now is not None
        return np.clip(normal_observations(self._now.states, self._now.goals_m)[0], -WIDEST, WIDEST)

    def _about(self, delivery: ServeBatch, outcome: Outcomes) -> dict[str, Any]:
        case = int(outcome.case[0])
        return {
            "case": case,
            "is_returned": case == Case.RETURNED,
            "error_mm": float(landing_errors_mm(outcome, delivery.goals_m)[0]),
        }


def register_environment() -> str:
    """Make the environment known to `gymnasium.make`, once; returns its name."""
    if ENVIRONMENT_ID not in gymnasium.registry:
        gymnasium.register(ENVIRONMENT_ID, entry_point="core.learning.gym_environment:OneStepReturn")
    return ENVIRONMENT_ID
