"""Training of a whole run: seeds in sequence or in parallel, under one process's lock.

One process trains one seed: files, pause, stop, and resuming after a kill. In parallel each seed is one task, with the
same files as in sequence.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from core.errors import ConfigError, RallyscopeError
from core.jobs import ALONE, JobBackend, TaskControl, open_jobs
from core.jobs.control import one_torch_thread
from core.learning.agents.policy import Policy, save_policy
from core.learning.config import RunConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.registered_agents import AGENTS
from core.learning.runs.run_files import (
    Control,
    RunStatus,
    SeedFiles,
    SeedWriter,
    State,
    hold_run,
    load_checkpoint,
    read_control,
    read_lines,
    read_run,
    read_status,
    save_checkpoint,
    seed_files,
    write_control,
    write_status,
)
from core.learning.runs.training import Training
from core.learning.task.environment import EpisodeBackend

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
        itself = AGENTS[self._config.agent].trains_itself
        try:
            return self._train_sb3(seed) if itself else self._train_own(seed)
        except OSError as error:
            raise run_not_written(self._run, error) from error

    def _train_own(self, seed: int) -> bool:
        """Train an agent in our loop; whether it finished, rather than being stopped."""
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


class StatusWriter:
    """Writes the status of a run locked by this process; unknown fields keep their last values.

    Every method but `failed` raises OSError if the file cannot be written.
    """

    def __init__(self, run: Path, config: RunConfig) -> None:
        self._run, self._episodes = run, config.episodes
        self._began_s = time.monotonic()
        self._first_share: float | None = None
        fresh = RunStatus("running", os.getpid(), config.first_seed, 0, config.episodes, 0.0, 0.0, None)
        self._status = read_status(run) or fresh

    def tell(self, at: SeedProgress, share: float) -> None:
        """Write the current seed, and the share of all seeds that is done."""
        if self._first_share is None:
            self._first_share = share
        gone = share - self._first_share
        left_s = (time.monotonic() - self._began_s) * (1 - share) / gone if gone > 0 else None
        left_s = left_s and round(left_s, 1)
        now = RunStatus(at.state, os.getpid(), at.seed, at.episode, self._episodes, share, at.speed_mps, left_s)
        self._write(now)

    def ended(self, state: State) -> None:
        """Write that it was stopped or is finished."""
        whole = {"share": 1.0, "seconds_left": 0.0} if state == "finished" else {}
        self._write(replace(self._status, state=state, pid=os.getpid(), message="", **whole))

    def failed(self, message: str) -> None:
        """Write the error that ended it, if possible."""
        with suppress(OSError):
            self._write(replace(self._status, state="failed", pid=os.getpid(), message=message))

    def _write(self, status: RunStatus) -> None:
        self._status = status
        write_status(self._run, status)


REPORT_EVERY_S: Final = 1.0


def train_side_by_side(
    run: Path,
    config: RunConfig,
    engine: JobBackend,
    teller: StatusWriter,
    progress: Callable[[float], None],
    stopped: Callable[[], bool],
) -> State:
    """Train the seeds of a run that this process holds, where the engine says; returns how it ended.

    Workers read the run's control file as a single process does, so pause, pace and stop mean the same to all of them.

    Raises:
        ConfigError: if a worker cannot write the run.
        JobsError: if the workers of a seed keep dying, or a cluster cannot be used.
        OSError: if this process cannot write its status.
    """
    watch = _Watch(run, config, teller, progress, stopped)
    seeds = range(config.first_seed, config.first_seed + config.seeds)
    with open_jobs(engine, len(seeds)) as jobs:
        work = TrainSeed(jobs.share_folder(run))
        finished = jobs.run(work, seeds, name=_name, done=watch.done, progress=watch.tell, cancelled=watch.look)
    watch.tell_at_once("running")
    return "finished" if all(finished) else "stopped"


@dataclass(frozen=True, slots=True)
class TrainSeed:
    """Trains one seed of the run in a folder, or goes on with it."""

    run: Path

    def __call__(self, seed: int, control: TaskControl) -> bool:
        """Whether it finished, rather than being stopped; see `SeedProcess` for the errors."""
        with one_torch_thread():
            seeds = SeedProcess(
                self.run, read_run(self.run), lambda seed_progress: control(seed_progress.share), control.stopped
            )
            return seeds.train(seed)


def _name(seed: int) -> str:
    return f"seed {seed}"


class _Watch:
    """Writes the run's status while seeds train in parallel, and passes on a stop."""

    def __init__(
        self,
        run: Path,
        config: RunConfig,
        teller: StatusWriter,
        progress: Callable[[float], None],
        stopped: Callable[[], bool],
    ) -> None:
        self._run, self._config, self._teller = run, config, teller
        self._progress, self._stopped = progress, stopped
        self._left = list(range(config.first_seed, config.first_seed + config.seeds))
        self._share, self._reported_s = 0.0, -REPORT_EVERY_S
        self._any_stopped = False

    def done(self, number: int, finished: bool) -> None:
        """Record the end of a seed; a stopped one does not count as done."""
        if finished:
            self._left.remove(self._config.first_seed + number)
        self._any_stopped |= not finished

    def look(self) -> bool:
        """Pass a stop to the workers, which then save and end; always False: they are not killed."""
        if self._stopped() and read_control(self._run).command != "stop":
            write_control(self._run, Control("stop"))
        return False

    def tell(self, share: float) -> None:
        """Report the progress of all seeds together."""
        if self._any_stopped:
            return
        self._share = share
        self._progress(share)
        if time.monotonic() - self._reported_s >= REPORT_EVERY_S:
            self._reported_s = time.monotonic()
            self.tell_at_once("paused" if read_control(self._run).command == "pause" else "running")

    def tell_at_once(self, state: State) -> None:
        """Report the first unfinished seed, and the share of all."""
        config = self._config
        seed = self._left[0] if self._left else config.first_seed + config.seeds - 1
        lines, _ = read_lines(seed_files(self._run, seed).metrics)
        last = lines[-1] if lines else {}
        episode, speed_mps = last.get("episode"), last.get("speed_mps")
        at = SeedProgress(
            seed,
            episode if isinstance(episode, int) else 0,
            self._share,
            speed_mps if isinstance(speed_mps, float) else config.curriculum.speeds_mps[0],
            state,
        )
        self._teller.tell(at, self._share)


Progress = Callable[[float], None]


def run_training(
    run: Path,
    *,
    progress: Progress = lambda share: None,
    stopped: Callable[[], bool] = lambda: False,
    backend: EpisodeBackend | None = None,
    engine: JobBackend = ALONE,
) -> State:
    """Train every seed of a run that `create_run` made, or go on where it ended; returns how it ended.

    `progress` hears the share that is done, `stopped` is asked before every episode. Whatever happens, the run can be
    gone on with from its last checkpoint, and gives the same numbers as if nothing had happened. A `backend` plays the
    balls elsewhere than in the closed-form simulator; what its cameras see after a kill is seen with other noise. With
    an `engine` of several the seeds are trained side by side.

    Raises:
        ConfigError: if there is no such run, another process trains it, it cannot be written, or seeds are to be
            trained side by side with the one backend.
        JobsError: if the workers of a seed keep dying, or a cluster cannot be used.
    """
    config = read_run(run)
    alone = engine.cluster is None and engine.processes(config.seeds) == 1
    if backend is not None and not alone:
        raise ConfigError("seeds side by side need a backend each", remedy="train them one after the other")
    with hold_run(run), one_torch_thread():
        teller = StatusWriter(run, config)
        try:
            # A pause or stop of the last time would end this one at once.
            if read_control(run).command != "run":
                write_control(run, replace(read_control(run), command="run"))
            if alone:
                state = _train_in_turn(run, config, teller, progress, stopped, backend)
            else:
                state = train_side_by_side(run, config, engine, teller, progress, stopped)
            teller.ended(state)
        except OSError as error:
            raised = run_not_written(run, error)
            teller.failed(str(raised))
            raise raised from error
        except BaseException as error:
            teller.failed(str(error) if isinstance(error, RallyscopeError) else f"{type(error).__name__}: {error}")
            raise
    if state == "finished":
        progress(1.0)
    return state


def _train_in_turn(
    run: Path,
    config: RunConfig,
    teller: StatusWriter,
    progress: Progress,
    stopped: Callable[[], bool],
    backend: EpisodeBackend | None,
) -> State:
    def tell(at: SeedProgress) -> None:
        share = (at.seed - config.first_seed + at.share) / config.seeds
        teller.tell(at, share)
        progress(share)

    seeds = SeedProcess(run, config, tell, stopped, backend)
    numbers = range(config.first_seed, config.first_seed + config.seeds)
    return "finished" if all(seeds.train(seed) for seed in numbers) else "stopped"
