"""Scoring the configs of a batch, here or in processes of their own; the scores are in the order of the configs."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from typing import Final

from core.detection import DetectorConfig
from core.errors import CommandError
from core.files import end_with_parent
from core.recordings import Recording, open_recording
from core.tuning.objective import Cancelled, Objective, TuningStoppedError
from core.tuning.split_score import SplitScore

LOOK_S: Final = 0.1
"""How often it is looked whether somebody has cancelled."""

Evaluate = Callable[[Sequence[DetectorConfig], Callable[[int], None]], list[SplitScore]]
"""The scores of configs; the callback hears how many are done."""


@contextmanager
def evaluating(objective: Objective, jobs: int, cancelled: Cancelled) -> Iterator[Evaluate]:
    """Yields what scores batches, with as many processes as `jobs`; 1 is this one.

    It raises TuningStoppedError soon after `cancelled()` has become true, and CommandError if a process dies. Ending
    this process, however it is done, ends the others.
    """
    if jobs > 1:
        yield from _in_processes(objective, jobs, cancelled)
        return
    with closing(open_recording(objective.path)) as recording:

        def evaluate(configs: Sequence[DetectorConfig], tell: Callable[[int], None]) -> list[SplitScore]:
            scores = []
            for config in configs:
                scores.append(objective.score(recording, config, cancelled))
                tell(len(scores))
            return scores

        yield evaluate


def _in_processes(objective: Objective, jobs: int, cancelled: Cancelled) -> Iterator[Evaluate]:
    context = multiprocessing.get_context("spawn")  # a fork would copy the threads' locks
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_start_worker, initargs=(objective,))

    def evaluate(configs: Sequence[DetectorConfig], tell: Callable[[int], None]) -> list[SplitScore]:
        futures = [pool.submit(_work, config) for config in configs]
        running = set(futures)
        while running:
            ended, running = wait(running, timeout=LOOK_S, return_when=FIRST_EXCEPTION)
            for future in ended:
                future.result()
            tell(sum(future.done() for future in futures))
            if cancelled():
                raise TuningStoppedError
        return [future.result() for future in futures]

    try:
        yield evaluate
    except BaseException as error:  # Ctrl-C too: do not wait for trials that take minutes
        for process in set(multiprocessing.active_children()) - others:
            process.kill()  # one that hangs, or was stopped, would not hear anything politer
        if not isinstance(error, BrokenProcessPool):
            raise
        raise CommandError("a process that scored configs died", remedy="run it again with fewer --jobs") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_task: tuple[Objective, Recording] | None = None
"""Of a worker: what it scores, and on what."""


def _start_worker(objective: Objective) -> None:
    """A worker leaves Ctrl-C to its parent, and ends when that has ended, even killed in the middle of a trial."""
    global _task
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    _task = objective, open_recording(objective.path)


def _work(config: DetectorConfig) -> SplitScore:
    assert _task is not None
    objective, recording = _task
    return objective.score(recording, config, lambda: False)
