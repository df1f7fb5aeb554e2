"""One seed of a run: its files, pause, stop and resuming after a kill; then the curriculum, episode by episode.

Read it with `ddpg.py` (the networks) and `reward.py`: together they are the paper's method.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.agents.agent import Agent, Losses, StageProgress
from core.learning.agents.ddpg import DdpgAgent
from core.learning.agents.landing_model import LandingModelAgent
from core.learning.agents.policy import Policy, save_policy
from core.learning.agents.process_agent import ProcessAgent
from core.learning.agents.reflection_agent import ReflectionAgent
from core.learning.agents.replay import ReplayBuffer, ReplayStart, start_stage
from core.learning.config import RunConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator, episode_line, transition_of
from core.learning.registered_agents import AGENTS, MakeAgent
from core.learning.runs.run_files import (
    SeedFiles,
    SeedWriter,
    State,
    load_checkpoint,
    pack_arrays,
    read_control,
    read_lines,
    restore_arrays,
    save_checkpoint,
    seed_files,
)
from core.learning.task.environment import (
    BALLS,
    CHOICES,
    ClosedFormBackend,
    EpisodeBackend,
    ServeBatch,
    action_size,
    check_actions,
    draw_serve_batch,
)
from core.learning.task.reward import episode_rewards, reward_weights
from core.physics.episode import Case

STATUS_EVERY_S: Final = 0.2
"""Interval of progress reports, s."""


@dataclass(frozen=True, slots=True)
class SeedProgress:
    """Progress of a seed."""

    seed: int
    episode: int
    """Episodes done."""
    share: float
    speed_mps: float
    state: State


def run_not_written(run: Path, error: OSError) -> ConfigError:
    """Error for a run that cannot be written to disk."""
    remedy = "free some space and resume the run: it goes on from its last checkpoint"
    return ConfigError("the run cannot be written", got=error.strerror or error, where=run, remedy=remedy)


class SeedTrainer:
    """Trains seeds of a run, each to its end or until a stop command."""

    def __init__(
        self,
        run: Path,
        config: RunConfig,
        on_progress: Callable[[SeedProgress], None],
        stopped: Callable[[], bool],
        backend: EpisodeBackend | None = None,
    ) -> None:
        self._run, self._config, self._backend = run, config, backend
        self._on_progress, self._stopped = on_progress, stopped
        self._evaluator = PolicyEvaluator(config.environment, config.evaluation_balls, backend)
        self._reported_s = 0.0

    def train(self, seed: int) -> bool:
        """Train a seed; whether it finished, rather than being stopped.

        Raises:
            ConfigError: if the run cannot be written.
        """
        itself = AGENTS[self._config.agent].trains_itself
        try:
            return self._train_sb3(seed) if itself else self._train_own(seed)
        except OSError as error:
            raise run_not_written(self._run, error) from error

    def _train_own(self, seed: int) -> bool:
        """Train an agent in our loop; whether it finished, rather than being stopped."""
        files = seed_files(self._run, seed)
        training = resume(files, self._config, seed, self._backend)
        if training.episode == 0:
            save_policy(training.policy, files.policy_at(0))  # what Train compares the trained one with
        with SeedWriter(files) as writer:
            while not training.finished:
                if not self._may_go_on(seed, training.episode, training.share, training.speed_mps, writer):
                    self._checkpoint(training, files, writer)
                    return False
                speed = training.speed_mps
                writer.metrics(training.play_episode())
                if training.episode % self._config.checkpoint_every == 0 or training.finished:
                    self._evaluate(training.policy, training.episode, speed, files, writer)
                    self._checkpoint(training, files, writer)
            if not files.policy.exists():
                save_policy(training.policy, files.policy)
        return True

    def _train_sb3(self, seed: int) -> bool:
        """Train a Stable-Baselines3 agent; a stopped one starts its seed again."""
        from core.learning.runs.sb3_baselines import Sb3Training  # late: the libraries are optional

        files = seed_files(self._run, seed)
        if files.checkpoint.exists():
            return True
        files.folder.mkdir(parents=True, exist_ok=True)
        for path in (files.metrics, files.evaluations, files.best):
            path.unlink(missing_ok=True)
        training = Sb3Training(self._config, seed, self._backend)
        with SeedWriter(files) as writer:

            def after_episode(line: dict[str, object], stage_is_over: bool) -> bool:
                writer.metrics(line)
                speed = float(str(line["speed_mps"]))
                if training.episode % self._config.checkpoint_every == 0 or stage_is_over:
                    self._evaluate(training.policy, training.episode, speed, files, writer)
                return self._may_go_on(seed, training.episode, training.episode / self._config.episodes, speed, writer)

            if not training.train(after_episode):
                return False
            writer.sizes()
            save_policy(training.policy, files.policy)
            save_policy(training.policy, files.checkpoint)
        return True

    def _evaluate(self, policy: Policy, episode: int, speed_mps: float, files: SeedFiles, writer: SeedWriter) -> None:
        """Score the policy on the fixed balls of this speed and keep it: as a checkpoint, last, perhaps best.

        Which one is best is decided on balls of its own, never on those that figures are reported on.
        """
        score = self._evaluator.score(policy, speed_mps)
        chosen_by = self._evaluator.score(policy, speed_mps, "validation")
        line = {
            "episode": episode,
            "speed_mps": speed_mps,
            "balls": len(score.returned),
            "returned": round(score.return_rate, 6),
            "error_mm": _number(score.error_mm),
            "error_returned_mm": _number(score.error_returned_mm),
            "missed": round(score.missed, 6),
            "validation_mm": _number(chosen_by.error_mm),
        }
        lines, _ = read_lines(files.evaluations)
        before = [line.get("validation_mm") for line in lines if line["speed_mps"] == speed_mps]
        writer.evaluation(line)
        save_policy(policy, files.policy_at(episode))
        save_policy(policy, files.policy)
        known = [float(error) for error in before if isinstance(error, (int, float))]
        if not known or chosen_by.error_mm < min(known):
            save_policy(policy, files.best)

    def _checkpoint(self, training: Training, files: SeedFiles, writer: SeedWriter) -> None:
        arrays, about = training.to_checkpoint()
        save_checkpoint(files.checkpoint, arrays, about | writer.sizes())

    def _may_go_on(self, seed: int, episode: int, share: float, speed_mps: float, writer: SeedWriter) -> bool:
        """Between two episodes: report progress, wait while paused or slowed down; False on a stop command."""
        asked_s = time.monotonic()
        while True:
            control = read_control(self._run)
            if self._stopped() or control.command == "stop":
                return False
            if time.monotonic() - self._reported_s >= STATUS_EVERY_S:
                writer.flush()
                state: State = "paused" if control.command == "pause" else "running"
                self._on_progress(SeedProgress(seed, episode, share, speed_mps, state))
                self._reported_s = time.monotonic()
            pace_s = 0.0 if control.episodes_per_s is None else 1 / control.episodes_per_s
            wait_s = asked_s + pace_s - time.monotonic()
            if control.command == "run" and wait_s <= 0:
                return True
            time.sleep(min(0.05, wait_s) if control.command == "run" else 0.05)


def resume(files: SeedFiles, config: RunConfig, seed: int, backend: EpisodeBackend | None = None) -> Training:
    """The training of a seed from its checkpoint, or from the start; lines written after the checkpoint are cut off."""
    files.folder.mkdir(parents=True, exist_ok=True)
    if not files.checkpoint.exists():
        files.metrics.unlink(missing_ok=True)
        files.evaluations.unlink(missing_ok=True)
        return Training(config, seed, backend)
    arrays, about = load_checkpoint(files.checkpoint)
    for path, name in ((files.metrics, "metrics_bytes"), (files.evaluations, "evaluations_bytes")):
        if path.exists():
            os.truncate(path, int(about[name]))  # type: ignore[call-overload]
    return Training.from_checkpoint(config, seed, arrays, about, backend)


def _number(value: float) -> float | None:
    return round(value, 6) if value == value else None


class Training:
    """A seed of a run, always between two episodes."""

    def __init__(self, config: RunConfig, seed: int, backend: EpisodeBackend | None = None) -> None:
        self.config = config
        self.seed = seed
        self._backend = backend or ClosedFormBackend(config.environment)
        self._backend.begin(seed)
        self._rng = np.random.default_rng([seed, CHOICES])
        self._agent = make_agent(config, self._rng)
        self._action_size = action_size(config.environment)
        self._buffer = ReplayBuffer(config.episodes, config.environment.state, self._action_size)
        self.episode = 0
        """Episodes done in all stages."""
        self._stage = 0
        self._stage_episode = 0
        self._recent = np.zeros(config.curriculum.converged_window, np.bool_)
        self._kept: ReplayStart | None = None
        self._batch = self._draw_batch()

    @property
    def finished(self) -> bool:
        """Whether the last stage is over."""
        return self._stage == len(self.config.curriculum.speeds_mps)

    @property
    def share(self) -> float:
        """Share of the run that is done, an upper bound: stages that converge early shorten it."""
        curriculum = self.config.curriculum
        return (sum(curriculum.episodes[: self._stage]) + self._stage_episode) / self.config.episodes

    @property
    def speed_mps(self) -> float:
        """Serve speed of this stage; of the last one at the end."""
        speeds = self.config.curriculum.speeds_mps
        return speeds[min(self._stage, len(speeds) - 1)]

    @property
    def policy(self) -> Policy:
        """Current policy."""
        return self._agent.policy()

    def play_episode(self) -> dict[str, object]:
        """One serve, one action, one outcome, and what is learned from it; returns its line for the metrics."""
        n, stage = self._stage_episode, self._stage
        exploration, curriculum = self.config.exploration, self.config.curriculum
        noise = exploration.noise_at(n)
        is_random = self.episode < exploration.random_episodes
        batch = self._backend.observe(self._batch[n : n + 1])
        action = self._exploratory_action(batch, noise, is_random)
        check_actions(action, self._action_size, f"the agent {self.config.agent}, seed {self.seed},", self.episode)
        outcome = self._backend.play(batch, action)
        weights = reward_weights(n, self.config.reward)
        where = f"episode {self.episode}, seed {self.seed}"
        reward = float(episode_rewards(outcome, batch.goals_m, weights, self.config.reward, where=where)[0])
        losses = Losses(float("nan"), float("nan"))
        # A ball that perception missed has no state to learn from.
        if batch.seen[0]:
            self._buffer.add(transition_of(batch, action[0], outcome, reward))
        if len(self._buffer):
            progress = StageProgress(n, n / curriculum.episodes[stage], weights)
            losses = self._agent.learn(self._buffer, progress, self._rng)
        line = episode_line(
            episode=self.episode,
            stage=stage,
            stage_episode=n,
            batch=batch,
            action=action[0],
            noise=noise,
            is_random=is_random,
            outcome=outcome,
            reward=reward,
            weights=weights,
            buffer=len(self._buffer),
            kept=self._kept if n == 0 else None,
            losses=losses,
        )
        self._recent[n % len(self._recent)] = outcome.case[0] == Case.RETURNED
        self.episode += 1
        self._stage_episode += 1
        if self._stage_is_over():
            self._next_stage()
        return line

    def _exploratory_action(self, batch: ServeBatch, noise: float, is_random: bool) -> NDArray[np.float64]:
        """The policy's action with noise, or a random one; both are always drawn, so that options can be compared."""
        size = (1, self._action_size)
        uniform, normal = self._rng.uniform(-1, 1, size), self._rng.standard_normal(size)
        if is_random:
            return uniform
        action = self._agent.act(batch.states, batch.racket_speeds_mps, batch.goals_m)
        return np.clip(action + noise * normal, -1, 1)

    def _stage_is_over(self) -> bool:
        curriculum = self.config.curriculum
        if self._stage_episode == curriculum.episodes[self._stage]:
            return True
        enough = self._stage_episode >= len(self._recent)
        return curriculum.advance == "converged" and enough and bool(self._recent.mean() >= curriculum.converged_rate)

    def _next_stage(self) -> None:
        self._stage += 1
        self._stage_episode = 0
        self._recent[:] = False
        if not self.finished:
            self._kept = start_stage(self._buffer, self.config.curriculum)
            self._batch = self._draw_batch()

    def _draw_batch(self) -> ServeBatch:
        """Draw all balls of this stage, the same for every agent with this seed."""
        curriculum = self.config.curriculum
        rng = np.random.default_rng([self.seed, BALLS, self._stage])
        return draw_serve_batch(
            curriculum.speeds_mps[self._stage], curriculum.episodes[self._stage], self.config.environment, rng
        )

    def to_checkpoint(self) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
        """Arrays and plain values from which training continues bit-exactly."""
        arrays = pack_arrays(self._agent, self._buffer)
        arrays["recent"] = self._recent.copy()
        about: dict[str, object] = {
            "seed": self.seed,
            "episode": self.episode,
            "stage": self._stage,
            "stage_episode": self._stage_episode,
            "kept": None if self._kept is None else [self._kept.kept, self._kept.dropped],
            "random": self._rng.bit_generator.state,
        }
        if self._kept is not None and self._kept.cases:
            about["kept_cases"] = [list(row) for row in self._kept.cases]
        if self.config.environment.state != "plain":
            about["state"] = self.config.environment.state
        return arrays, about

    @classmethod
    def from_checkpoint(
        cls,
        config: RunConfig,
        seed: int,
        arrays: dict[str, NDArray[np.generic]],
        about: dict[str, object],
        backend: EpisodeBackend | None = None,
    ) -> Training:
        """The training that gave the checkpoint.

        Raises:
            ConfigError: if it is another run's.
        """
        training = cls(config, seed, backend)
        try:
            training._restore(arrays, about)
        except (KeyError, ValueError, TypeError, RuntimeError) as error:
            raise ConfigError("a checkpoint of another run", got=str(error), where=f"seed {seed}") from error
        return training

    def _restore(self, arrays: dict[str, NDArray[np.generic]], about: dict[str, object]) -> None:
        if about["seed"] != self.seed:
            raise ValueError(f"seed {about['seed']}")
        trained, wanted = about.get("state", "plain"), self.config.environment.state
        if trained != wanted:
            raise ValueError(f"it was trained on states of the kind {trained}, the run has {wanted}")
        restore_arrays(arrays, self._agent, self._buffer)
        self._recent[:] = arrays["recent"]
        self.episode = int(about["episode"])  # type: ignore[call-overload]
        self._stage = int(about["stage"])  # type: ignore[call-overload]
        self._stage_episode = int(about["stage_episode"])  # type: ignore[call-overload]
        kept = about["kept"]
        cases = tuple((int(case), int(k), int(d)) for case, k, d in about.get("kept_cases", ()))  # type: ignore[union-attr]
        self._kept = None if kept is None else ReplayStart(*kept, cases)  # type: ignore[misc]
        self._rng.bit_generator.state = about["random"]  # type: ignore[assignment]
        if not self.finished and self._stage > 0:
            self._batch = self._draw_batch()


def _make_landing_model(config: RunConfig, rng: np.random.Generator) -> Agent:
    heads: dict[str, MakeAgent] = {"process": ProcessAgent, "reflection": ReflectionAgent}
    return heads.get(config.landing_model.head, LandingModelAgent)(config, rng)


OURS: Final[dict[str, MakeAgent]] = {"ddpg": DdpgAgent, "landing-model": _make_landing_model}


def make_agent(config: RunConfig, rng: np.random.Generator) -> Agent:
    """A new agent by the config's name.

    Raises:
        ConfigError: if it is one of stable-baselines3, which trains itself.
    """
    make = AGENTS[config.agent].make or OURS.get(config.agent)
    if make is None:
        others = ", ".join(name for name, agent in AGENTS.items() if not agent.trains_itself)
        raise ConfigError("an agent that trains itself", expected=others, got=config.agent)
    return make(config, rng)
