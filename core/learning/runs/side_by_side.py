"""The seeds of a run side by side: each is a piece of work, with the same files as if they came one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.jobs import JobBackend, TaskControl, open_jobs
from core.jobs.threads import one_torch_thread
from core.learning.config import RunConfig
from core.learning.runs.control import Control, State, read_control, write_control
from core.learning.runs.run_files import read_lines, read_run, seed_files
from core.learning.runs.seed_process import SeedProcess, SeedProgress
from core.learning.runs.status_writer import StatusWriter

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
        """Whether it is finished, and not stopped on the way; see `SeedProcess` for the errors."""
        with one_torch_thread():
            seeds = SeedProcess(
                self.run, read_run(self.run), lambda seed_progress: control(seed_progress.share), control.stopped
            )
            return seeds.train(seed)


def _name(seed: int) -> str:
    return f"seed {seed}"


class _Watch:
    """What those who look at the run are told meanwhile, and what the workers are told of a stop."""

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
        if time.monotonic() - self._reported_s >= REPORT_EVERY_S:
            self._reported_s = time.monotonic()
            self.tell_at_once("paused" if read_control(self._run).command == "pause" else "running")

    def tell_at_once(self, state: State) -> None:
        """The first seed that is not finished, and the share of all."""
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
