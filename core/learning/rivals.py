"""The rivals: PPO, A2C, TRPO, TD3 and SAC as stable-baselines3 and sb3-contrib have them, on the same balls.

They keep the libraries' defaults but for what 1,700 one-step episodes demand: PPO and TRPO update every 50 episodes
(the default of 2,048 is more than a run), and TD3 and SAC have our network size, batch and start. `matched` exploration
gives everyone the noise of our agents (0.1 at the start) and their learning rate; on-policy methods otherwise begin
with a standard deviation of the whole action range.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.agent import Losses
from core.learning.config import RunConfig
from core.learning.court import Court
from core.learning.environment import Deliveries, deliver
from core.learning.episode_record import episode_line
from core.learning.gym_environment import OneStepReturn
from core.learning.policy import Policy, save_policy
from core.learning.racket_table import racket_table
from core.learning.replay import Kept
from core.learning.reward import episode_rewards, reward_weights
from core.learning.run_files import seed_files
from core.learning.training import BALLS

if TYPE_CHECKING:
    from core.learning.running import RunProcess, SeedWriter

Floats = NDArray[np.float32]

ON_POLICY = ("ppo", "a2c", "trpo")
START = 32
"""Transitions before TD3 and SAC learn, as with our agents."""
RATE = 1e-3


def train_rival(process: RunProcess, seed: int) -> bool:
    """Whether the seed is finished (not stopped on the way). A rival that was stopped starts its seed again.

    Raises:
        ConfigError: if the libraries are not installed.
    """
    from core.learning.running import SeedWriter

    files = seed_files(process.run, seed)
    if files.checkpoint.exists():
        return True
    files.folder.mkdir(parents=True, exist_ok=True)
    for path in (files.metrics, files.evaluations, files.best):
        path.unlink(missing_ok=True)
    with SeedWriter(files) as writer:
        rival = Rival(process, seed, writer)
        for stage in range(len(process.config.curriculum.speeds_mps)):
            if not rival.train_stage(stage):
                return False
        writer.sizes()
        save_policy(rival.policy(), files.policy)
        save_policy(rival.policy(), files.checkpoint)
    return True


class Rival:
    """One seed of a rival: the library's model, and the books about it."""

    def __init__(self, process: RunProcess, seed: int, writer: SeedWriter) -> None:
        self.process = process
        self.config = process.config
        self.seed = seed
        self.writer = writer
        self.files = seed_files(process.run, seed)
        self.episode = 0
        self.stopped = False
        self._model: Any = None

    def train_stage(self, stage: int) -> bool:
        """Play and learn the episodes of one speed; False if stopped."""
        from stable_baselines3.common.callbacks import BaseCallback

        rival = self
        torch.set_num_threads(1)

        class Watch(BaseCallback):
            def _on_step(self) -> bool:
                return rival.after_episode(environment)

        ladder = self.config.curriculum
        environment = RivalEnvironment(self.config, self.seed, stage, self.episode, self.process.court)
        if self._model is None:
            self._model = make_model(self.config, environment, self.seed)
        else:
            self._model.set_env(environment)
            if ladder.replay == "discard" and self.config.agent not in ON_POLICY:
                self._model.replay_buffer.reset()
        self._model.learn(ladder.episodes[stage], callback=Watch(), reset_num_timesteps=stage == 0)
        return not self.stopped

    def after_episode(self, environment: RivalEnvironment) -> bool:
        """Write what was played; False to stop here."""
        self.episode += 1
        self.writer.metrics(environment.line)
        ladder = self.config.curriculum
        stage_is_over = environment.stage_episode >= ladder.episodes[environment.stage]
        if self.episode % self.config.checkpoint_every == 0 or stage_is_over:
            speed = ladder.speeds_mps[environment.stage]
            self.process.evaluate(self.policy(), self.episode, speed, self.files, self.writer)
        share = self.episode / self.config.episodes
        going = self.process.may_go_on(self.seed, self.episode, share, environment.speed_mps, self.writer)
        self.stopped = not going
        return going

    def policy(self) -> Policy:
        """The library's actor as one of our policies."""
        return extract_policy(self._model, self.config)


class RivalEnvironment(OneStepReturn):
    """The environment of a stage, dealing the balls that our agents get with this seed, and writing them down."""

    def __init__(
        self, config: RunConfig, seed: int, stage: int, first_episode: int, court: Court | None = None
    ) -> None:
        ladder = config.curriculum
        rng = np.random.default_rng([seed, BALLS, stage])
        speed = ladder.speeds_mps[stage]
        dealt = deliver(speed, ladder.episodes[stage], config.environment, rng)
        super().__init__(speed, config.environment, config.reward, dealt, court)
        self.stage = stage
        self.stage_episode = 0
        self._first_episode = first_episode
        self.line: dict[str, object] = {}
        """Of the last episode."""

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """As the environment itself; `line` then holds the episode."""
        answer = super().step(action)
        delivery: Deliveries | None = self._now
        assert delivery is not None
        wanted = np.asarray(action, np.float64).reshape(1, 3)
        weights = reward_weights(self.stage_episode, self.reward)
        outcome = self.outcome
        assert outcome is not None
        self.line = episode_line(
            episode=self._first_episode + self.stage_episode,
            stage=self.stage,
            stage_episode=self.stage_episode,
            delivery=delivery,
            action=np.clip(wanted[0], -1, 1),
            noise=math.nan,
            is_random=False,
            outcome=outcome,
            reward=float(episode_rewards(outcome, delivery.goals_m, weights, self.reward)[0]),
            weights=weights,
            buffer=0,
            kept=Kept(0, 0) if self.stage_episode == 0 else None,
            losses=Losses(math.nan, math.nan),
        )
        self.stage_episode += 1
        return answer


def make_model(config: RunConfig, environment: RivalEnvironment, seed: int) -> Any:
    """The library's model of the run's agent.

    Raises:
        ConfigError: if the libraries are not installed.
    """
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
    if matched:
        shared["learning_rate"] = RATE
    if config.agent in ON_POLICY:
        start = {"log_std_init": math.log(scale)} if matched else {}
        shared["policy_kwargs"] = {"net_arch": [hidden, hidden], **start}
        steps = config.rival.on_policy_steps
        if config.agent == "ppo":
            return sb3.PPO("MlpPolicy", n_steps=steps, batch_size=steps, **shared)
        if config.agent == "trpo":
            return sb3_contrib.TRPO("MlpPolicy", n_steps=steps, batch_size=steps, **shared)
        return sb3.A2C("MlpPolicy", **shared)
    shared |= {"batch_size": 64, "learning_starts": START, "buffer_size": config.episodes + 1}
    shared["policy_kwargs"] = {"net_arch": [hidden, hidden]}
    if config.agent == "td3":
        # The library has no noise unless told; 0.1 is what TD3's authors use, and ours.
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
    linear = [module for module in modules if isinstance(module, torch.nn.Linear)]
    layers = tuple((m.weight.detach().numpy().T.copy(), m.bias.detach().numpy().copy()) for m in linear)
    incoming, racket = racket_table(config)
    on_policy = config.agent in ON_POLICY
    return Policy(layers, "tanh" if on_policy else "relu", "clip" if on_policy else "tanh", False, incoming, racket)
