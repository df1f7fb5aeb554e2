"""Training of a whole run: seeds in sequence or in parallel, under one process's lock.

`run_training` holds the run and trains its seeds one after the other, or each as a task of its own. What happens in
one seed, from its episodes to its files, is in `training.py`.
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
from core.learning.config import RunConfig
from core.learning.runs.run_files import (
    Control,
    RunStatus,
    State,
    hold_run,
    read_control,
    read_lines,
    read_run,
    read_status,
    seed_files,
    write_control,
    write_status,
)
from core.learning.runs.training import SeedProgress, SeedTrainer, run_not_written
from core.learning.task.environment import EpisodeBackend

REPORT_EVERY_S: Final = 1.0
"""Interval of status reports of seeds that train in parallel, s."""
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

    `progress` gets the share that is done, `stopped` is asked before every episode. Whatever happens, the run can be
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
        status = StatusWriter(run, config)
        try:
            # A pause or stop of the last time would end this one at once.
            if read_control(run).command != "run":
                write_control(run, replace(read_control(run), command="run"))
            if alone:
                state = _train_in_turn(run, config, status, progress, stopped, backend)
            else:
                state = train_side_by_side(run, config, engine, status, progress, stopped)
            status.ended(state)
        except OSError as error:
            raised = run_not_written(run, error)
            status.failed(str(raised))
            raise raised from error
        except BaseException as error:
            status.failed(str(error) if isinstance(error, RallyscopeError) else f"{type(error).__name__}: {error}")
            raise
    if state == "finished":
        progress(1.0)
    return state


def _train_in_turn(
    run: Path,
    config: RunConfig,
    status: StatusWriter,
    progress: Progress,
    stopped: Callable[[], bool],
    backend: EpisodeBackend | None,
) -> State:
    def on_progress(at: SeedProgress) -> None:
        share = (at.seed - config.first_seed + at.share) / config.seeds
        status.progress(at, share)
        progress(share)

    seeds = SeedTrainer(run, config, on_progress, stopped, backend)
    numbers = range(config.first_seed, config.first_seed + config.seeds)
    return "finished" if all(seeds.train(seed) for seed in numbers) else "stopped"


def train_side_by_side(
    run: Path,
    config: RunConfig,
    engine: JobBackend,
    status: StatusWriter,
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
    reports = _ParallelStatus(run, config, status, progress, stopped)
    seeds = range(config.first_seed, config.first_seed + config.seeds)
    with open_jobs(engine, len(seeds)) as jobs:
        work = TrainSeed(jobs.share_folder(run))
        finished = jobs.run(
            work, seeds, name=_name, done=reports.done, progress=reports.on_progress, cancelled=reports.pass_stop_on
        )
    reports.write("running")
    return "finished" if all(finished) else "stopped"


@dataclass(frozen=True, slots=True)
class TrainSeed:
    """Trains one seed of the run in a folder, or goes on with it."""

    run: Path

    def __call__(self, seed: int, control: TaskControl) -> bool:
        """Whether it finished, rather than being stopped; see `SeedTrainer` for the errors."""
        with one_torch_thread():
            seeds = SeedTrainer(
                self.run, read_run(self.run), lambda seed_progress: control(seed_progress.share), control.stopped
            )
            return seeds.train(seed)


def _name(seed: int) -> str:
    return f"seed {seed}"


class _ParallelStatus:
    """Writes the run's status while seeds train in parallel, and passes on a stop."""

    def __init__(
        self,
        run: Path,
        config: RunConfig,
        status: StatusWriter,
        progress: Callable[[float], None],
        stopped: Callable[[], bool],
    ) -> None:
        self._run, self._config, self._status = run, config, status
        self._progress, self._stopped = progress, stopped
        self._left = list(range(config.first_seed, config.first_seed + config.seeds))
        self._share, self._reported_s = 0.0, -REPORT_EVERY_S
        self._any_stopped = False

    def done(self, number: int, finished: bool) -> None:
        """Record the end of a seed; a stopped one does not count as done."""
        if finished:
            self._left.remove(self._config.first_seed + number)
        self._any_stopped |= not finished

    def pass_stop_on(self) -> bool:
        """Pass a stop to the workers, which then save and end; always False: they are not killed."""
        if self._stopped() and read_control(self._run).command != "stop":
            write_control(self._run, Control("stop"))
        return False

    def on_progress(self, share: float) -> None:
        """Report the progress of all seeds together."""
        if self._any_stopped:
            return
        self._share = share
        self._progress(share)
        if time.monotonic() - self._reported_s >= REPORT_EVERY_S:
            self._reported_s = time.monotonic()
            self.write("paused" if read_control(self._run).command == "pause" else "running")

    def write(self, state: State) -> None:
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
        self._status.progress(at, self._share)


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

    def progress(self, at: SeedProgress, share: float) -> None:
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
