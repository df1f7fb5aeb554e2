"""Scoring the configs of a batch on any backend; the scores are in the order of the configs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.detection import DetectorConfig
from core.jobs import JobBackend, TaskControl, TasksStoppedError, open_jobs
from core.recordings import Recording, open_recording
from core.tuning.objective import Cancelled, Objective, TuningStoppedError
from core.tuning.split_score import SplitScore

Evaluate = Callable[[Sequence[DetectorConfig], Callable[[int], None]], list[SplitScore]]
"""Function that scores configs; the callback gets the number done."""


@contextmanager
def evaluating(objective: Objective, engine: JobBackend, most: int, cancelled: Cancelled) -> Iterator[Evaluate]:
    """Yields what scores batches of at most so many configs, with an engine that sees the recording.

    It raises TuningStoppedError soon after `cancelled()` has become true, and JobsError if the engine fails. Ending
    this process, however it is done, ends the others.
    """
    with open_jobs(engine, most) as jobs:
        work = ScoreConfig(objective, jobs.share_file(objective.path))

        def evaluate(configs: Sequence[DetectorConfig], tell: Callable[[int], None]) -> list[SplitScore]:
            done = 0

            def count(number: int, score: SplitScore) -> None:
                nonlocal done
                done += 1
                tell(done)

            try:
                return jobs.run(work, configs, done=count, cancelled=cancelled)
            except TasksStoppedError as error:
                raise TuningStoppedError from error

        try:
            yield evaluate
        finally:
            _KEPT.close()


@dataclass(frozen=True, slots=True, eq=False)
class ScoreConfig:
    """Scores configs on a recording; each process opens it once."""

    objective: Objective
    path: Path

    def __call__(self, config: DetectorConfig, control: TaskControl) -> SplitScore:
        """The score of a config."""
        return self.objective.score(_KEPT.open(self.path), config, control.stopped)


class _Kept:
    """Cache of the last recording of a process; a changed file is reopened."""

    def __init__(self) -> None:
        self._recording: Recording | None = None
        self._what: tuple[object, ...] = ()

    def open(self, path: Path) -> Recording:
        now = path.stat()
        what = (path, now.st_ino, now.st_size, now.st_mtime_ns)
        if self._recording is None or self._what != what:
            self.close()
            self._recording, self._what = open_recording(path), what
        return self._recording

    def close(self) -> None:
        if self._recording is not None:
            self._recording.close()
        self._recording = None


_KEPT: Final = _Kept()
