"""Training of a whole run: seeds in sequence or in parallel, under one process's lock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from core.errors import ConfigError, RallyscopeError
from core.jobs import ALONE, JobBackend
from core.jobs.threads import one_torch_thread
from core.learning.config import RunConfig
from core.learning.runs.control import State, hold_run, read_control, write_control
from core.learning.runs.run_files import read_run
from core.learning.runs.seed_process import SeedProcess, SeedProgress, run_not_written
from core.learning.runs.side_by_side import train_side_by_side
from core.learning.runs.status_writer import StatusWriter
from core.learning.task.episode_backend import EpisodeBackend

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
