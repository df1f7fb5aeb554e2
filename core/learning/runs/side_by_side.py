"""Parallel training of a run's seeds, one task each, with the same files as in sequence."""

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
