"""Training process of one seed: files, pause, stop, and resuming after a kill."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import ConfigError
from core.learning.agents.policy import Policy, save_policy
from core.learning.config import RunConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.runs.checkpoints import load_checkpoint, save_checkpoint
from core.learning.runs.control import State, read_control
from core.learning.runs.run_files import SeedFiles, SeedWriter, read_lines, seed_files
from core.learning.runs.training import Training
from core.learning.task.episode_backend import EpisodeBackend

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


class SeedProcess:
    """Trains seeds of a run, each to its end or until a stop command."""

    def __init__(
        self,
        run: Path,
        config: RunConfig,
        tell: Callable[[SeedProgress], None],
        stopped: Callable[[], bool],
        backend: EpisodeBackend | None = None,
    ) -> None:
        self._run, self._config, self._backend = run, config, backend
        self._tell, self._stopped = tell, stopped
        self._evaluator = PolicyEvaluator(config.environment, config.evaluation_balls, backend)
        self._reported_s = 0.0

    def train(self, seed: int) -> bool:
        """Train a seed; whether it finished, rather than being stopped.

        Raises:
            ConfigError: if the run cannot be written.
        """
        ours = self._config.agent in ("ddpg", "landing-model")
        try:
            return self._train_own(seed) if ours else self._train_sb3(seed)
        except OSError as error:
            raise run_not_written(self._run, error) from error

    def _train_own(self, seed: int) -> bool:
        """Train our agent; whether it finished, rather than being stopped."""
        files = seed_files(self._run, seed)
        training = resume(files, self._config, seed, self._backend)
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
                self._tell(SeedProgress(seed, episode, share, speed_mps, state))
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
