"""Baselines that learn: PPO, A2C, TRPO, TD3 and SAC as stable-baselines3 and sb3-contrib have them, on the same balls.

They keep the libraries' defaults but for what 1,700 one-step episodes demand: PPO and TRPO update every 50 episodes
(the default of 2,048 is more than a run), and TD3 and SAC have our network size, batch and start. `matched` exploration
gives everyone the noise of our agents (0.1 at the start) and a learning rate of 0.001; on-policy methods otherwise
begin with a standard deviation of the whole action range.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.agents.agent import Losses
from core.learning.agents.networks import layers_of
from core.learning.agents.policy import Policy
from core.learning.agents.replay import ReplayStart
from core.learning.config import RunConfig
from core.learning.evaluation.policy_evaluator import episode_line
from core.learning.gym_environment import OneStepReturn
from core.learning.task.environment import BALLS, EpisodeBackend, ServeBatch, draw_serve_batch, racket_table
from core.learning.task.reward import episode_rewards, reward_weights

Floats = NDArray[np.float32]
AfterEpisode = Callable[[dict[str, object], bool], bool]
"""Called with an episode's line and whether its stage is over; returns whether to continue."""

ON_POLICY = ("ppo", "a2c", "trpo")
OWN_PACE = ("a2c", "trpo")
"""One step from each set of balls is what these methods are."""
START = 32
"""Transitions before TD3 and SAC learn, as with our agents."""
MATCHED_RATE = 1e-3


class Sb3Training:
    """One seed of an agent of these libraries, over all stages."""

    def __init__(self, config: RunConfig, seed: int, backend: EpisodeBackend | None = None) -> None:
        self.config = config
        self.seed = seed
        self.episode = 0
        """Episodes done in all stages."""
        self._world_backend = backend
        self._model: Any = None

    def train(self, after_episode: AfterEpisode) -> bool:
        """Play and learn to the end; False if `after_episode` stopped it.

        Raises:
            ConfigError: if the libraries are not installed.
        """
        return all(self._train_stage(stage, after_episode) for stage in range(len(self.config.curriculum.speeds_mps)))

    @property
    def policy(self) -> Policy:
        """The library's actor as one of our policies."""
        return extract_policy(self._model, self.config)

    def _train_stage(self, stage: int, after_episode: AfterEpisode) -> bool:
        curriculum, going = self.config.curriculum, True
        environment = Sb3Environment(self.config, self.seed, stage, self.episode, self._world_backend)
        if self._model is None:
            self._model = make_model(self.config, environment, self.seed)
        else:
            self._model.set_env(environment)
            if curriculum.replay == "discard" and self.config.agent not in ON_POLICY:
                self._model.replay_buffer.reset()

        def on_step(local: dict[str, Any], of_library: dict[str, Any]) -> bool:
            nonlocal going
            self.episode += 1
            going = after_episode(environment.line, environment.stage_episode >= curriculum.episodes[stage])
            return going

        self._model.learn(curriculum.episodes[stage], callback=on_step, reset_num_timesteps=stage == 0)
        return going


class Sb3Environment(OneStepReturn):
    """Environment of a stage with the same balls as our agents get with this seed; it records the episodes."""

    def __init__(
        self, config: RunConfig, seed: int, stage: int, first_episode: int, backend: EpisodeBackend | None = None
    ) -> None:
        speed, episodes = config.curriculum.speeds_mps[stage], config.curriculum.episodes[stage]
        rng = np.random.default_rng([seed, BALLS, stage])
        drawn = draw_serve_batch(speed, episodes, config.environment, rng)
        super().__init__(speed, config.environment, config.reward, drawn, backend)
        self.agent = f"the agent {config.agent}, seed {seed},"
        self.stage = stage
        self.stage_episode = 0
        self._first_episode = first_episode
        self.line: dict[str, object] = {}
        """Metrics of the last episode."""

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Step as the environment itself does; `line` then holds the episode."""
        answer = super().step(action)
        batch: ServeBatch | None = self._now
        assert batch is not None
        wanted = np.asarray(action, np.float64).reshape(1, 3)
        # Counted from the stage's begin like our agents' episodes, where the environment counts from its own.
        weights = reward_weights(self.stage_episode, self.reward)
        outcome = self.outcome
        assert outcome is not None
        self.line = episode_line(
            episode=self._first_episode + self.stage_episode,
            stage=self.stage,
            stage_episode=self.stage_episode,
            batch=batch,
            action=np.clip(wanted[0], -1, 1),
            noise=math.nan,
            is_random=False,
            outcome=outcome,
            reward=float(episode_rewards(outcome, batch.goals_m, weights, self.reward)[0]),
            weights=weights,
            buffer=0,
            kept=ReplayStart(0, 0) if self.stage_episode == 0 else None,
            losses=Losses(math.nan, math.nan),
        )
        self.stage_episode += 1
        return answer


def make_model(config: RunConfig, environment: Sb3Environment, seed: int) -> Any:
    """The library's model of the run's agent.

    Raises:
        ConfigError: if the libraries are not installed, or the method has no other number of gradient steps.
    """
    updates = config.rival.updates_per_episode
    if updates and config.agent in OWN_PACE:
        raise ConfigError("one gradient step from each set of balls", expected="0", got=updates, where=config.agent)
    try:
        import sb3_contrib
        import stable_baselines3 as sb3
        from stable_baselines3.common.noise import NormalActionNoise
    except ImportError as error:
        raise ConfigError(
            f"the agent {config.agent!r} needs stable-baselines3 and sb3-contrib",
            remedy="pip install 'rallyscope[baselines]'",
        ) from error
    matched = config.rival.exploration == "matched"
    scale, hidden = config.exploration.scale, config.rival.hidden
    shared: dict[str, Any] = {"env": environment, "seed": seed, "device": "cpu", "verbose": 0}
    if rate := config.rival.rate or (MATCHED_RATE if matched else 0.0):
        shared["learning_rate"] = rate
    if config.agent in ON_POLICY:
        start = {"log_std_init": math.log(scale)} if matched else {}
        shared["policy_kwargs"] = {"net_arch": [hidden, hidden], **start}
        steps = config.rival.on_policy_steps
        if config.agent == "ppo":
            if updates:  # a pass over a batch that holds all balls is one step
                shared["n_epochs"] = updates * steps
            return sb3.PPO("MlpPolicy", n_steps=steps, batch_size=steps, **shared)
        if config.agent == "trpo":
            return sb3_contrib.TRPO("MlpPolicy", n_steps=steps, batch_size=steps, **shared)
        return sb3.A2C("MlpPolicy", **shared)
    shared |= {"batch_size": 64, "learning_starts": START, "buffer_size": config.episodes + 1}
    shared["gradient_steps"] = updates or 1
    shared["policy_kwargs"] = {"net_arch": [hidden, hidden]}
    if config.agent == "td3":
        # The library has no noise by default; 0.1 is used by TD3's authors and our agents.
        noise = NormalActionNoise(np.zeros(3), np.full(3, scale))
        return sb3.TD3("MlpPolicy", action_noise=noise, **shared)
    if not matched:
        return sb3.SAC("MlpPolicy", **shared)
    model = sb3.SAC("MlpPolicy", ent_coef="auto_0.01", **shared)
    with torch.no_grad():
        model.policy.actor.log_std.weight.mul_(0.01)  # type: ignore[union-attr]
        model.policy.actor.log_std.bias.fill_(math.log(scale))  # type: ignore[union-attr]
    return model


def extract_policy(model: Any, config: RunConfig) -> Policy:
    """The deterministic actor of a library's model."""
    if config.agent in ON_POLICY:
        modules = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    elif config.agent == "td3":
        modules = list(model.policy.actor.mu)
    else:
        modules = [*model.policy.actor.latent_pi, model.policy.actor.mu]
    incoming, racket = racket_table(config)
    on_policy = config.agent in ON_POLICY
    return Policy(
        layers_of(modules),
        "tanh" if on_policy else "relu",
        "clip" if on_policy else "tanh",
        False,
        incoming,
        racket,
        config.environment.state,
    )
