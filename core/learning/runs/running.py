"""A whole run: seed after seed or side by side, its status for those who watch, and how it ended."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from core.errors import ConfigError, RallyscopeError
from core.jobs import ALONE, Engine
from core.jobs.threads import one_torch_thread
from core.learning.config import RunConfig
from core.learning.runs.control import (
    RunStatus,
    State,
    hold_run,
    read_control,
    read_status,
    write_control,
    write_status,
)
from core.learning.runs.run_files import read_run
from core.learning.runs.seed_process import SeedProcess, SeedProgress, run_not_written
from core.learning.runs.side_by_side import train_side_by_side
from core.learning.task.episode_backend import EpisodeBackend

Progress = Callable[[float], None]


def run_training(
    run: Path,
    *,
    progress: Progress = lambda share: None,
    stopped: Callable[[], bool] = lambda: False,
    backend: EpisodeBackend | None = None,
    engine: Engine = ALONE,
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
        process = RunProcess(run, config, progress)
        try:
            if read_control(run).command != "run":
                write_control(run, replace(read_control(run), command="run"))
            if not alone:
                return train_side_by_side(run, config, engine, progress, stopped)
            return process.train(SeedProcess(run, config, process.tell_progress, stopped, backend))
        except OSError as error:
            raised = run_not_written(run, error)
            process.tell_failed(str(raised))
            raise raised from error
        except BaseException as error:
            process.tell_failed(
                str(error) if isinstance(error, RallyscopeError) else f"{type(error).__name__}: {error}"
            )
            raise


class RunProcess:
    """The process side of a run: how far it is."""

    def __init__(self, run: Path, config: RunConfig, progress: Progress) -> None:
        self._run, self._config, self._progress = run, config, progress
        self._started_s = time.monotonic()
        self._first_share: float | None = None
        status = read_status(run)
        self._status = status or RunStatus(
            "running", os.getpid(), config.first_seed, 0, config.episodes, 0.0, 0.0, None
        )

    def train(self, seeds: SeedProcess) -> State:
        """Every seed in turn."""
        for seed in range(self._config.first_seed, self._config.first_seed + self._config.seeds):
            if not seeds.train(seed):
                self._tell("stopped")
                return "stopped"
        self._tell("finished", share=1.0, seconds_left=0.0)
        self._progress(1.0)
        return "finished"

    def tell_progress(self, seed: SeedProgress) -> None:
        """How far the seed is that is being trained."""
        whole = (seed.seed - self._config.first_seed + seed.share) / self._config.seeds
        if self._first_share is None:
            self._first_share = whole
        gone = whole - self._first_share
        left = (time.monotonic() - self._started_s) * (1 - whole) / gone if gone > 0 else None
        self._status = RunStatus(
            seed.state,
            os.getpid(),
            seed.seed,
            seed.episode,
            self._config.episodes,
            whole,
            seed.speed_mps,
            left and round(left, 1),
        )
        self._tell(seed.state)
        self._progress(whole)

    def tell_failed(self, message: str) -> None:
        """Why it ended, if that can still be written."""
        with suppress(OSError):
            self._tell("failed", message=message)

    def _tell(
        self, state: State, *, message: str = "", share: float | None = None, seconds_left: float | None = None
    ) -> None:
        now = self._status
        self._status = replace(
            now,
            state=state,
            pid=os.getpid(),
            message=message,
            share=now.share if share is None else share,
            seconds_left=seconds_left if seconds_left is not None else now.seconds_left,
        )
        write_status(self._run, self._status)
