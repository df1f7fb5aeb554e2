"""The search for better thresholds: start, proposals in batches that any backend scores, and the result as plain
values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from core.config import Setting, get_setting
from core.detection import DetectorConfig
from core.detection.methods import method_config
from core.errors import CommandError, ConfigError
from core.jobs import ALONE, JobBackend, TaskControl, TasksStoppedError, open_jobs
from core.recordings import Recording, open_recording
from core.tuning.objective import (
    WORST,
    Cancelled,
    Figures,
    Objective,
    SplitScore,
    TuningConfig,
    TuningStoppedError,
    figures_of,
)
from core.tuning.parameters import Parameter, config_with

if TYPE_CHECKING:
    from core.tuning.search import Search

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
        # The recording that this process kept open for its own share of the work.
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


_IMPOSSIBLE: Final = Figures(float("nan"), float("nan"), float("nan"), WORST, 0)


@dataclass(frozen=True, slots=True)
class TuningTrial:
    """One config and its score."""

    values: Mapping[str, Setting]
    """Values of the parameters, by name."""
    tuned: Figures
    held_out: Figures
    possible: bool = True
    """False if the values are inconsistent; nothing was run then."""


@dataclass(frozen=True, slots=True)
class TuningProgress:
    """Progress of a search."""

    done: int
    """Number of scored trials."""
    trials: int
    """Planned number of trials."""
    best: TuningTrial | None
    """Best score so far; None before the first batch."""


@dataclass(frozen=True, slots=True)
class TuningResult:
    """Result of a search. The best config is the start config if none was better on the tuned side."""

    start: DetectorConfig
    best: DetectorConfig
    best_trial: int
    """Number of the best trial; 0 is the start config."""
    trials: tuple[TuningTrial, ...]
    importance: Mapping[str, float]
    """Share of each parameter in what made trials differ, the largest first; empty if nothing can be said."""
    stopped: bool
    """Whether it was stopped early; it contains only complete batches."""

    @property
    def changed(self) -> dict[str, tuple[Setting, Setting]]:
        """Start and best value of the parameters that changed."""
        pairs = {}
        for name in self.trials[0].values:
            path = tuple(name.split("."))
            pairs[name] = (get_setting(self.start, path), get_setting(self.best, path))
        return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}

    @property
    def better_held_out(self) -> bool:
        """Whether the best config is also better on the held-out side."""
        return self.trials[self.best_trial].held_out.objective > self.trials[0].held_out.objective


def tune(
    objective: Objective,
    method: str,
    start: DetectorConfig,
    parameters: Sequence[Parameter],
    config: TuningConfig | None = None,
    *,
    engine: JobBackend = ALONE,
    progress: Callable[[TuningProgress], None] = lambda state: None,
    cancelled: Cancelled = lambda: False,
) -> TuningResult | None:
    """Search for values of the parameters with which the method is worth most, on the side of the split that is tuned.

    Trials are proposed in batches and answered in their order, so that the result depends on the seed and not on the
    engine that scores them. When `cancelled()` becomes true, it is that of the batches so far; None before the first.

    Raises:
        CommandError: without optuna.
        JobsError: if the engine fails.
        ConfigError: without parameters.
    """
    if not parameters:
        raise ConfigError("no parameters to tune")
    config, first = config or TuningConfig(), method_config(method, start)
    search = _search(parameters, first, config.seed)
    run = _Run(search, first, config.trials, progress)
    stopped = False
    try:
        with evaluating(objective, engine, config.batch, cancelled) as evaluate:
            run.batch(1, evaluate)
            while len(run.trials) < config.trials:
                run.batch(min(config.batch, config.trials - len(run.trials)), evaluate)
    except TuningStoppedError:
        stopped = True
    if not run.trials:
        return None
    number, trials = run.best, tuple(run.trials)
    best = first if number == 0 else config_with(first, trials[number].values)
    return TuningResult(first, best, number, trials, search.importance(), stopped)


class _Run:
    """The trials of one search so far."""

    def __init__(
        self, search: Search, start: DetectorConfig, count: int, progress: Callable[[TuningProgress], None]
    ) -> None:
        self.trials: list[TuningTrial] = []
        self._search = search
        self._start = start
        self._count = count
        self._progress = progress
        self._known: dict[DetectorConfig, tuple[Figures, Figures]] = {}

    @property
    def best(self) -> int:
        """The number of the best trial, the first of equals."""
        return max(range(len(self.trials)), key=lambda number: self.trials[number].tuned.objective)

    def batch(self, size: int, evaluate: Evaluate) -> None:
        """Propose, score and tell so many trials. The first of all is the config to start from, exactly as it is."""
        proposals = self._search.ask(size)
        configs = [self._config(values) for values in proposals] if self.trials else [self._start]
        new = [config for config in dict.fromkeys(configs) if config is not None and config not in self._known]
        done, known = len(self.trials), size - len(new)
        best = self.trials[self.best] if self.trials else None
        scores = evaluate(new, lambda ready: self._progress(TuningProgress(done + known + ready, self._count, best)))
        for config, score in zip(new, scores, strict=True):
            self._known[config] = figures_of(score.tuned), figures_of(score.held_out)
        for values, config in zip(proposals, configs, strict=True):
            figures = (_IMPOSSIBLE, _IMPOSSIBLE) if config is None else self._known[config]
            self.trials.append(TuningTrial(values, *figures, possible=config is not None))
        self._search.tell([trial.tuned.objective for trial in self.trials[done:]])
        self._progress(TuningProgress(len(self.trials), self._count, self.trials[self.best]))

    def _config(self, values: Mapping[str, Setting]) -> DetectorConfig | None:
        """Config with these values; None if they are inconsistent."""
        try:
            return config_with(self._start, values)
        except ConfigError:
            return None


def _search(parameters: Sequence[Parameter], start: DetectorConfig, seed: int) -> Search:
    try:
        from core.tuning.search import Search
    except ImportError as error:
        raise CommandError("tuning needs optuna", remedy="pip install 'rallyscope[tune]'") from error
    return Search(parameters, start, seed)


def report_of(result: TuningResult) -> dict[str, object]:
    """Report of a search: start and best config on both sides of the split, and the history.

    `changed` has [before, after] by name; `history` has the objective of each trial on [the tuned, the held-out] side.
    """
    return {
        "start": _sides(result.trials[0]),
        "best": _sides(result.trials[result.best_trial]),
        "best_trial": result.best_trial,
        "better_held_out": result.better_held_out,
        "stopped": result.stopped,
        "trials": len(result.trials),
        "impossible": sum(not trial.possible for trial in result.trials),
        "parameters": list(result.trials[0].values),
        "changed": {name: list(pair) for name, pair in result.changed.items()},
        "importance": dict(result.importance),
        "history": [[trial.tuned.objective, trial.held_out.objective] for trial in result.trials],
    }


def _sides(trial: TuningTrial) -> dict[str, object]:
    return {"tuned": asdict(trial.tuned), "held_out": asdict(trial.held_out)}
