"""The seeds of a run side by side: each is a piece of work, with the same files as if they came one after the other."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.jobs import Engine, PieceControl, open_jobs
from core.jobs.threads import one_torch_thread
from core.learning.config import RunConfig
from core.learning.runs.control import Control, RunStatus, State, read_control, write_control, write_status
from core.learning.runs.run_files import read_lines, read_run, seed_files
from core.learning.runs.seed_process import SeedProcess, run_not_written

TOLD_EVERY_S: Final = 1.0


def train_side_by_side(
    run: Path,
    config: RunConfig,
    engine: Engine,
    progress: Callable[[float], None] = lambda share: None,
    stopped: Callable[[], bool] = lambda: False,
) -> State:
    """Train the seeds of a run that this process holds, where the engine says; returns how it ended.

    Workers read the run's control file as a single process does, so pause, pace and stop mean the same to all of them.

    Raises:
        ConfigError: if the run cannot be written.
        JobsError: if the workers of a seed keep dying, or a cluster cannot be used.
    """
    watch = _Watch(run, config, progress, stopped)
    seeds = range(config.first_seed, config.first_seed + config.seeds)
    with open_jobs(engine, len(seeds)) as jobs:
        work = TrainSeed(jobs.share_folder(run))
        finished = jobs.run(work, seeds, name=_name, done=watch.done, progress=watch.tell, cancelled=watch.look)
    state: State = "finished" if all(finished) else "stopped"
    watch.write(state)
    return state


@dataclass(frozen=True, slots=True)
class TrainSeed:
    """Trains one seed of the run in a folder, or goes on with it."""

    run: Path

    def __call__(self, seed: int, control: PieceControl) -> bool:
        """Whether it is finished, and not stopped on the way; see `SeedProcess` for the errors."""
        with one_torch_thread():
            seeds = SeedProcess(self.run, read_run(self.run), lambda told: control(told.share), control.stopped)
            return seeds.train(seed)


def _name(seed: int) -> str:
    return f"seed {seed}"


class _Watch:
    """What those who look at the run are told meanwhile, and what the workers are told of a stop."""

    def __init__(
        self, run: Path, config: RunConfig, progress: Callable[[float], None], stopped: Callable[[], bool]
    ) -> None:
        self._run, self._config, self._progress, self._stopped = run, config, progress, stopped
        self._left = list(range(config.first_seed, config.first_seed + config.seeds))
        self._began_s, self._first_share, self._share = time.monotonic(), -1.0, 0.0
        self._told_s = -TOLD_EVERY_S
        self._any_stopped = False

    def done(self, number: int, finished: bool) -> None:
        """A seed has ended; one that was stopped is done for this time, and no share of the whole."""
        if finished:
            self._left.remove(self._config.first_seed + number)
        self._any_stopped |= not finished

    def look(self) -> bool:
        """Whether workers are to be cut off: never. A stop is told to them, and they save what they have."""
        if self._stopped() and read_control(self._run).command != "stop":
            write_control(self._run, Control("stop"))
        return False

    def tell(self, share: float) -> None:
        """How far all seeds together are."""
        if self._any_stopped:
            return
        self._share = share
        self._progress(share)
        if self._first_share < 0:
            self._first_share = share
        if time.monotonic() - self._told_s >= TOLD_EVERY_S:
            self.write("paused" if read_control(self._run).command == "pause" else "running")

    def write(self, state: State) -> None:
        """The status file: of the first seed that is not finished, and the share of all.

        Raises:
            ConfigError: if it cannot be written.
        """
        config, self._told_s = self._config, time.monotonic()
        seed = self._left[0] if self._left else config.first_seed + config.seeds - 1
        lines, _ = read_lines(seed_files(self._run, seed).metrics)
        last = lines[-1] if lines else {}
        episode, speed_mps = last.get("episode"), last.get("speed_mps")
        gone = self._share - self._first_share
        left_s = (self._told_s - self._began_s) * (1 - self._share) / gone if gone > 0 else None
        status = RunStatus(
            state,
            os.getpid(),
            seed,
            episode if isinstance(episode, int) else 0,
            config.episodes,
            1.0 if state == "finished" else self._share,
            speed_mps if isinstance(speed_mps, float) else config.curriculum.speeds_mps[0],
            0.0 if state == "finished" else left_s and round(left_s, 1),
        )
        try:
            write_status(self._run, status)
        except OSError as error:
            raise run_not_written(self._run, error) from error
