"""A whole run as a process lives it: seed after seed, files on disk, pause, stop, and going on after a kill."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from core.errors import ConfigError
from core.jobs.threads import one_torch_thread
from core.learning.agents.policy import Policy, save_policy
from core.learning.config import RunConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.runs.checkpoints import load_checkpoint, save_checkpoint
from core.learning.runs.control import (
    RunStatus,
    State,
    hold_run,
    read_control,
    read_status,
    write_control,
    write_status,
)
from core.learning.runs.run_files import SeedFiles, SeedWriter, read_lines, read_run, seed_files
from core.learning.runs.training import Training
from core.learning.task.episode_backend import EpisodeBackend

Progress = Callable[[float], None]

STATUS_EVERY_S = 0.2
"""How often the status is written, and how late a plot may be."""


def run_training(
    run: Path,
    *,
    progress: Progress = lambda share: None,
    stopped: Callable[[], bool] = lambda: False,
    backend: EpisodeBackend | None = None,
) -> State:
    """Train every seed of a run that `create_run` made, or go on where it ended; returns how it ended.

    `progress` hears the share that is done, `stopped` is asked before every episode. Whatever happens, the run can be
    gone on with from its last checkpoint, and gives the same numbers as if nothing had happened. A `backend` plays the
    balls elsewhere than in the closed-form simulator; what its cameras see after a kill is seen with other noise.

    Raises:
        ConfigError: if there is no such run, another process trains it, or it cannot be written.
    """
    config = read_run(run)
    with hold_run(run), one_torch_thread():
        if read_control(run).command != "run":
            try:
                write_control(run, replace(read_control(run), command="run"))
            except OSError as error:
                raise _not_written(run, error) from error
        process = RunProcess(run, config, progress, stopped, backend)
        try:
            return process.train()
        except OSError as error:
            with suppress(OSError):
                process.tell("failed", message=f"the run cannot be written: {error.strerror or error}")
            raise _not_written(run, error) from error
        except BaseException as error:
            with suppress(OSError):
                process.tell("failed", message=f"{type(error).__name__}: {error}")
            raise


def _not_written(run: Path, error: OSError) -> ConfigError:
    remedy = "free some space and resume the run: it goes on from its last checkpoint"
    return ConfigError("the run cannot be written", got=error.strerror or error, where=run, remedy=remedy)


class RunProcess:
    """The process side of a run: how far it is, what it was asked for."""

    def __init__(
        self,
        run: Path,
        config: RunConfig,
        progress: Progress,
        stopped: Callable[[], bool],
        backend: EpisodeBackend | None = None,
    ) -> None:
        self.run = run
        self.config = config
        self.backend = backend
        self.evaluator = PolicyEvaluator(config.environment, config.evaluation_balls, backend)
        self._progress = progress
        self._stopped = stopped
        self._started_s = time.monotonic()
        self._told_s = 0.0
        self._first_share: float | None = None
        status = read_status(run)
        self._status = status or RunStatus(
            "running", os.getpid(), config.first_seed, 0, config.episodes, 0.0, 0.0, None
        )

    def train(self) -> State:
        """Every seed in turn."""
        for seed in range(self.config.first_seed, self.config.first_seed + self.config.seeds):
            ours = self.config.agent in ("ddpg", "landing-model")
            if not (self._train_seed(seed) if ours else self._train_sb3_seed(seed)):
                self.tell("stopped")
                return "stopped"
        self.tell("finished", share=1.0, seconds_left=0.0)
        self._progress(1.0)
        return "finished"

    def _train_seed(self, seed: int) -> bool:
        """Whether the seed is finished (not stopped on the way)."""
        files = seed_files(self.run, seed)
        training = resume(files, self.config, seed, self.backend)
        with SeedWriter(files) as writer:
            while not training.finished:
                if not self.may_go_on(seed, training.episode, training.share, training.speed_mps, writer):
                    self._checkpoint(training, files, writer)
                    return False
                speed = training.speed_mps
                writer.metrics(training.play_episode())
                if training.episode % self.config.checkpoint_every == 0 or training.finished:
                    self.evaluate(training.policy, training.episode, speed, files, writer)
                    self._checkpoint(training, files, writer)
            if not files.policy.exists():
                save_policy(training.policy, files.policy)
        return True

    def _train_sb3_seed(self, seed: int) -> bool:
        """The same for an agent that trains itself: one that was stopped starts its seed again."""
        from core.learning.runs.sb3_baselines import Sb3Training  # late: the libraries are optional

        files = seed_files(self.run, seed)
        if files.checkpoint.exists():
            return True
        files.folder.mkdir(parents=True, exist_ok=True)
        for path in (files.metrics, files.evaluations, files.best):
            path.unlink(missing_ok=True)
        training = Sb3Training(self.config, seed, self.backend)
        with SeedWriter(files) as writer:

            def after_episode(line: dict[str, object], stage_is_over: bool) -> bool:
                writer.metrics(line)
                speed = float(str(line["speed_mps"]))
                if training.episode % self.config.checkpoint_every == 0 or stage_is_over:
                    self.evaluate(training.policy, training.episode, speed, files, writer)
                return self.may_go_on(seed, training.episode, training.episode / self.config.episodes, speed, writer)

            if not training.train(after_episode):
                return False
            writer.sizes()
            save_policy(training.policy, files.policy)
            save_policy(training.policy, files.checkpoint)
        return True

    def evaluate(self, policy: Policy, episode: int, speed_mps: float, files: SeedFiles, writer: SeedWriter) -> None:
        """Score the policy on the fixed balls of this speed and keep it: as a checkpoint, last, perhaps best.

        Which one is best is decided on balls of its own, never on those that figures are reported on.
        """
        score = self.evaluator.score(policy, speed_mps)
        chosen_by = self.evaluator.score(policy, speed_mps, "validation")
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

    def may_go_on(self, seed: int, episode: int, share: float, speed_mps: float, writer: SeedWriter) -> bool:
        """Between two episodes: tell how it goes, wait while paused or slowed down; False once asked to stop."""
        asked_s = time.monotonic()
        while True:
            control = read_control(self.run)
            if self._stopped() or control.command == "stop":
                return False
            if time.monotonic() - self._told_s >= STATUS_EVERY_S:
                writer.flush()
                self._tell_progress(
                    seed, episode, share, speed_mps, "paused" if control.command == "pause" else "running"
                )
            pace_s = 0.0 if control.episodes_per_s is None else 1 / control.episodes_per_s
            wait_s = asked_s + pace_s - time.monotonic()
            if control.command == "run" and wait_s <= 0:
                return True
            time.sleep(min(0.05, wait_s) if control.command == "run" else 0.05)

    def _tell_progress(self, seed: int, episode: int, share: float, speed_mps: float, state: State) -> None:
        whole = (seed - self.config.first_seed + share) / self.config.seeds
        if self._first_share is None:
            self._first_share = whole
        gone = whole - self._first_share
        left = (time.monotonic() - self._started_s) * (1 - whole) / gone if gone > 0 else None
        self._status = RunStatus(
            state, os.getpid(), seed, episode, self.config.episodes, whole, speed_mps, left and round(left, 1)
        )
        self.tell(state)
        self._progress(whole)

    def tell(
        self, state: State, *, message: str = "", share: float | None = None, seconds_left: float | None = None
    ) -> None:
        """Write the status for those who watch."""
        now = self._status
        self._status = replace(
            now,
            state=state,
            pid=os.getpid(),
            message=message,
            share=now.share if share is None else share,
            seconds_left=seconds_left if seconds_left is not None else now.seconds_left,
        )
        write_status(self.run, self._status)
        self._told_s = time.monotonic()


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
