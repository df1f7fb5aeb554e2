"""Trains what the plan asks for, each seed by itself, and keeps only the evaluations: an interrupted bench goes on.

Policies with the whole chain in the loop: played out before event cameras ball by ball, and perhaps trained there.

A ball takes a second or more of computing, so these trainings are few; each is kept, and an interrupted one goes on.

Numbers over seeds as text: mean, standard deviation, 95 % interval, paired differences on the same seeds, and a
row per training.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import shutil
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy import stats

from benchmarks.learning.plan import Counts, Experiment
from core.config import config_to_mapping
from core.errors import ConfigError
from core.files import read_json, write_json
from core.jobs import Jobs, TaskControl, TasksStoppedError
from core.learning.config import RunConfig, default_run
from core.learning.evaluation.policy_evaluator import PolicyEvaluator, PolicyScore, score_played
from core.learning.randomisation import RandomisationConfig
from core.learning.runs.run_files import create_run, load_policy, read_lines, seed_files
from core.learning.runs.running import run_training
from core.learning.runs.summary import spread_of
from core.learning.task.environment import evaluation_balls
from core.learning.task.recorded_balls import ball_state_files
from core.live.worlds.event_environment import EventCameraBackend, EventEnvironmentConfig
from core.text import markdown_table


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The policy of a seed after so many episodes, on the fixed balls."""

    episode: int
    speed_mps: float
    returned: float
    error_mm: float
    """Over all balls, a missed one as the table's length."""
    error_returned_mm: float
    missed: float
    """Share of balls that the racket did not meet."""


@dataclass(frozen=True, slots=True)
class SeedResult:
    """What one trained seed achieved."""

    seed: int
    evaluations: tuple[Evaluation, ...]
    transfers: dict[str, Evaluation]
    cpu_s: float
    """Processor time of training and its evaluations."""
    median_mm: float = math.nan
    """Error of the last policy at the last speed, over all balls."""

    def at(self, episode: int) -> Evaluation | None:
        """After exactly so many episodes."""
        return next((e for e in self.evaluations if e.episode == episode), None)

    def last(self, speed_mps: float) -> Evaluation | None:
        """At the end of the stage of a speed."""
        return next((e for e in reversed(self.evaluations) if e.speed_mps == speed_mps), None)

    def five_best_mm(self, speed_mps: float) -> float:
        """Mean of the five lowest errors at a speed: the paper's figure, and too kind (it looks at the answers)."""
        found = sorted(e.error_mm for e in self.evaluations if e.speed_mps == speed_mps and np.isfinite(e.error_mm))
        return float(np.mean(found[:5])) if found else math.nan


COUNTED: Final = "missed balls count 2740 mm"
"""Results that were counted otherwise are others."""
LATER: Final = {
    "environment": {
        "state": "plain",
        "recorded": "",
        "spin_noise_radps": 10.0,
        "hit": "paper",
        "racket": "table",
        "randomise": config_to_mapping(RandomisationConfig()),
    },
    "ddpg": {"rewards": "stored", "final_rate": 1.0, "edge_penalty": 0.0},
    "rival": {"updates_per_episode": 0, "rate": 0.0},
}
"""Settings that came later, by section: with these values results are, and are called, what they were before."""
Results = defaultdict[str, list[SeedResult]]
"""The seeds of every training, by its name; none of one that was not trained."""


def seeds_in_turn(experiments: Sequence[Experiment]) -> list[tuple[Experiment, int]]:
    """Every seed of every experiment: the first of each, then the second; what is stopped early can be paired so."""
    turns = range(max((one.config.seeds for one in experiments), default=0))
    return [(one, one.config.first_seed + turn) for turn in turns for one in experiments if turn < one.config.seeds]


def missing_seeds(wanted: Sequence[tuple[Experiment, int]], folder: Path) -> list[tuple[Experiment, int]]:
    """The seeds whose results are not in the folder already."""
    return [(experiment, seed) for experiment, seed in wanted if not _path(experiment, folder, seed).exists()]


def train_seed(wanted: tuple[Experiment, int], control: TaskControl) -> dict[str, object]:
    """Train one seed, in a folder that is gone afterwards; gives what `keep_seed` keeps.

    Raises:
        TasksStoppedError: if nobody wants it any more.
    """
    experiment, seed = wanted
    with tempfile.TemporaryDirectory(prefix="rallyscope-") as folder:
        return _train_seed(experiment, seed, Path(folder) / "run", control)


def keep_seed(wanted: tuple[Experiment, int], answer: dict[str, object], folder: Path) -> None:
    """Keep what came of a seed."""
    experiment, seed = wanted
    write_json(_path(experiment, folder, seed), answer)


def train_missing(
    jobs: Jobs, pieces: Sequence[tuple[Experiment, int]], folder: Path, progress: Callable[[float], None]
) -> None:
    """Train seeds that are not in the folder, and keep each as soon as it is done."""
    jobs.run(
        train_seed,
        pieces,
        name=lambda piece: f"{piece[0].name} seed {piece[1]}",
        done=lambda number, answer: keep_seed(pieces[number], answer, folder),
        progress=progress,
    )


def load_results(experiments: Sequence[Experiment], folder: Path) -> Results:
    """What there is of every experiment."""
    results: Results = defaultdict(list)
    for experiment in experiments:
        first = experiment.config.first_seed
        for seed in range(first, first + experiment.config.seeds):
            if answer := read_json(_path(experiment, folder, seed)):
                results[experiment.name].append(_result(seed, answer))
    return results


def _train_seed(experiment: Experiment, seed: int, run: Path, control: TaskControl) -> dict[str, object]:
    config = replace(experiment.config, seeds=1, first_seed=seed)
    create_run(run, config)
    started = time.process_time()
    if run_training(run, progress=control, stopped=control.stopped) == "stopped":
        raise TasksStoppedError
    cpu_s = time.process_time() - started
    lines, _ = read_lines(seed_files(run, seed).evaluations)
    policy = load_policy(run, seed)
    transfers: dict[str, object] = {}
    for name, environment in experiment.transfers:
        speed = config.curriculum.speeds_mps[-1]
        score = PolicyEvaluator(environment, config.evaluation_balls).score(policy, speed)
        found = Evaluation(
            config.episodes, speed, score.return_rate, score.error_mm, score.error_returned_mm, score.missed
        )
        transfers[name] = asdict(found)
    speed = config.curriculum.speeds_mps[-1]
    last = PolicyEvaluator(config.environment, config.evaluation_balls).score(policy, speed)
    median_mm = float(np.median(last.counted_mm))
    return {"evaluations": lines, "transfers": transfers, "cpu_s": cpu_s, "median_mm": median_mm}


def _path(experiment: Experiment, folder: Path, seed: int) -> Path:
    """Named by what is trained: a changed setting is another result."""
    return folder / f"{experiment.name}-{fingerprint(experiment.config)}" / f"seed-{seed}.json"


def fingerprint(config: RunConfig) -> str:
    """A hash of everything but the seeds, and of how results are counted; of recorded balls what is in the files."""
    mapping = config_to_mapping(replace(config, seeds=1, first_seed=0))
    environment = mapping["environment"]
    assert isinstance(environment, dict)
    if config.environment.recorded:
        data = b"".join(path.read_bytes() for path in ball_state_files(config.environment.recorded))
        environment["recorded"] = hashlib.sha256(data).hexdigest()
    for section, defaults in LATER.items():
        settings = mapping[section]
        assert isinstance(settings, dict)
        for name, default in defaults.items():
            if settings[name] == default:
                del settings[name]
    text = COUNTED + tomli_w.dumps(mapping)
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def _result(seed: int, answer: dict[str, object]) -> SeedResult:
    lines, transfers, cpu_s = answer["evaluations"], answer["transfers"], answer["cpu_s"]
    assert isinstance(lines, list) and isinstance(transfers, dict) and isinstance(cpu_s, float)
    named = {name: _evaluation(line) for name, line in transfers.items()}
    median_mm = answer.get("median_mm", math.nan)
    assert isinstance(median_mm, float)
    return SeedResult(seed, tuple(_evaluation(line) for line in lines), named, cpu_s, median_mm)


def _evaluation(line: dict[str, float | None]) -> Evaluation:
    values = {field.name: line[field.name] for field in fields(Evaluation)}
    return Evaluation(**{name: math.nan if value is None else value for name, value in values.items()})  # type: ignore[arg-type]


def values_at(results: Sequence[SeedResult], episode: int, what: str) -> list[float]:
    """One number per seed after so many episodes; what: a field of `Evaluation`."""
    return [getattr(evaluation, what) for result in results if (evaluation := result.at(episode)) is not None]


def values_at_end(results: Sequence[SeedResult], speed_mps: float, what: str) -> list[float]:
    """One number per seed at the end of the stage of a speed."""
    return [getattr(evaluation, what) for result in results if (evaluation := result.last(speed_mps)) is not None]


SPEED_MPS: Final = 5.0
SEEN_BALLS: Final = 20
"""Of the evaluations during the training, each seen by the cameras once: they are not reported."""


@dataclass(frozen=True, slots=True, eq=False)
class PlayedSeed:
    """What one trained seed did with balls that were played out before the cameras."""

    seed: int
    returned: NDArray[np.bool_]
    errors_mm: NDArray[np.float64]
    """(N,) NaN where the racket missed."""

    @property
    def score(self) -> PolicyScore:
        """The outcome as a score."""
        return PolicyScore(SPEED_MPS, self.returned, self.errors_mm)


@dataclass(frozen=True, slots=True)
class PlayedTraining:
    """A training whose policies are then played out before event cameras."""

    name: str
    config: RunConfig
    """Trained before the cameras if its states are from events, otherwise in closed form."""
    seeds: int
    balls: int
    """That each seed is evaluated on."""
    told: bool
    """Whether the chain is told the physics exactly; otherwise it finds out."""

    @property
    def trains_there(self) -> bool:
        """Before the cameras."""
        return self.config.environment.state_source == "events"

    @property
    def balls_played(self) -> int:
        """By one seed, before the cameras."""
        return self.balls + self.trains_there * self.config.episodes


def event_training(counts: Counts) -> PlayedTraining:
    """The landing model at 5 m/s, its states from events."""
    base = default_run("landing-model")
    config = replace(
        base,
        environment=replace(base.environment, state_source="events"),
        curriculum=replace(base.curriculum, speeds_mps=(SPEED_MPS,), episodes=(counts.event_episodes,)),
        checkpoint_every=max(1, min(50, counts.event_episodes)),
        evaluation_balls=min(SEEN_BALLS, counts.event_balls),
    )
    return PlayedTraining("events", config, counts.event_seeds, counts.event_balls, told=True)


def play_seed(training: PlayedTraining, folder: Path, seed: int) -> bool:
    """Train and evaluate one seed; False if it is in the folder already."""
    path = _played_path(training, folder, seed)
    if path.exists():
        return False
    config, run = replace(training.config, seeds=1, first_seed=seed), path.with_suffix(".run")
    if not (run / "config.toml").is_file():
        shutil.rmtree(run, ignore_errors=True)
        create_run(run, config)
    world_backend = replace(config.environment, state_source="events")
    with contextlib.closing(
        EventCameraBackend(world_backend, seed=seed, config=EventEnvironmentConfig(knows_physics=training.told))
    ) as seen:
        run_training(run, backend=seen if training.trains_there else None)
        balls = evaluation_balls(SPEED_MPS, training.balls, world_backend)
        score = score_played(seen, load_policy(run, seed), balls)
    errors = [None if math.isnan(error) else error for error in score.errors_mm.tolist()]
    write_json(path, {"returned": score.returned.tolist(), "errors_mm": errors})
    shutil.rmtree(run)
    return True


def load_played(training: PlayedTraining, folder: Path) -> list[PlayedSeed]:
    """What there is of its seeds."""
    found = []
    for seed in range(training.seeds):
        if answer := read_json(_played_path(training, folder, seed)):
            found.append(_played(seed, answer))
    return found


def _played(seed: int, answer: dict[str, object]) -> PlayedSeed:
    returned, errors = answer.get("returned"), answer.get("errors_mm")
    if not (isinstance(returned, Sequence) and isinstance(errors, Sequence) and len(returned) == len(errors) > 0):
        raise ConfigError("not a seed's balls", expected="outcome and error of each ball", where=f"events, seed {seed}")
    numbers = np.array([math.nan if error is None else error for error in errors], np.float64)
    return PlayedSeed(seed, np.array(returned, np.bool_), numbers)


def _played_path(training: PlayedTraining, folder: Path, seed: int) -> Path:
    """Named by what is trained and on how many balls it is judged."""
    name = f"{training.name}-{fingerprint(training.config)}-{training.balls}-balls"
    return folder / name / f"seed-{seed}.json"


Array = NDArray[np.float64]
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """Difference of pairs; no interval for fewer than two."""

    count: int
    """Number of pairs."""
    estimate: float
    low: float
    """Lower end of the 95 % interval."""
    high: float


def pair_by_seed(
    ours: Mapping[int, float], theirs: Mapping[int, float], *, where: str
) -> tuple[tuple[int, ...], Array, Array]:
    """Seeds (N,) in rising order, and the values of both sides in that order.

    Raises:
        ConfigError: if the seeds of the two sides are not the same.
    """
    if ours.keys() != theirs.keys():
        raise ConfigError(
            "not compared, the seeds differ",
            expected=f"the same seeds on both sides, here {seeds_as_text(ours.keys())}",
            got=seeds_as_text(theirs.keys()),
            where=where,
            remedy="train the seeds that are missing",
        )
    seeds = tuple(sorted(ours))
    return seeds, np.array([ours[s] for s in seeds], np.float64), np.array([theirs[s] for s in seeds], np.float64)


def paired_difference(ours: Array, theirs: Array) -> PairedDifference:
    """Mean of ours - theirs (N,) with Student's interval."""
    values = np.asarray(ours, np.float64) - np.asarray(theirs, np.float64)
    count = len(values)
    if count < 2:
        return PairedDifference(count, float(values.mean()) if count else math.nan, math.nan, math.nan)
    mean = float(values.mean())
    if np.ptp(values) <= 1e-12 * max(1.0, abs(mean)):  # no scatter: no test
        return PairedDifference(count, mean, mean, mean)
    test: Any = stats.ttest_1samp(values, 0.0)  # scipy has no types for it
    interval = test.confidence_interval(CONFIDENCE)
    return PairedDifference(count, mean, float(interval.low), float(interval.high))


def seeds_as_text(seeds: Iterable[int]) -> str:
    """Seeds with runs of them drawn together: 0-4, 7."""
    found = sorted(seeds)
    parts: list[str] = []
    start = 0
    for i, seed in enumerate(found):
        if i + 1 == len(found) or found[i + 1] != seed + 1:
            parts.append(str(seed) if start == i else f"{found[start]}-{seed}")
            start = i + 1
    return ", ".join(parts) or "none"


Column = Callable[[Sequence[SeedResult]], str]
"""What a table says of a training."""


def table_of_trainings(
    results: Results, title: str, trainings: Mapping[str, str], columns: Mapping[str, Column]
) -> str:
    """A row per training, by the words for it: how many seeds there are, and every column."""
    rows = [[words, str(len(results[name])), *(say(results[name]) for say in columns.values())]
            for words, name in trainings.items()]  # fmt: skip
    return markdown_table((title, "seeds", *columns), rows)


def at(episode: int, what: str) -> Column:
    """The figure after so many episodes; what: returned, error_mm, error_returned_mm or missed."""
    return lambda found: shown(what, values_at(found, episode, what))


def at_end(speed_mps: float, what: str) -> Column:
    """The figure at the end of the stage of a speed."""
    return lambda found: shown(what, values_at_end(found, speed_mps, what))


def five_best(speed_mps: float) -> Column:
    """The mean of the five lowest errors of each seed."""
    return lambda found: shown("error_mm", [result.five_best_mm(speed_mps) for result in found])


def shown(what: str, values: Sequence[float]) -> str:
    """Shares 0..1 as percent, 98.4 ± 1.2 [97.8, 99.0]; errors in mm, 148 ± 31 [133, 162].

    The interval ends where percentages do, and no distance is negative; there is no interval of one.
    """
    is_share = what in ("returned", "missed")
    scale, most = (100, 100.0) if is_share else (1, math.inf)
    spread = spread_of([scale * value for value in values])
    digits = 0 if not is_share and spread.mean >= 30 else 1
    if spread.count < 2:
        return f"{spread.mean:.{digits}f}" if spread.count else "-"
    low, high = max(spread.low, 0.0), min(spread.high, most)
    return f"{spread.mean:.{digits}f} ± {spread.std:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def paired(a: Sequence[SeedResult], b: Sequence[SeedResult], episode: int, what: str) -> str:
    """Mean difference a - b with its 95 % interval, in percentage points or millimetres; whether a claim holds is said
    where all claims are. Where the seeds of the two are not the same, that, and no number.
    """
    scale = 100 if what == "returned" else 1
    sides = [{r.seed: scale * getattr(e, what) for r in found if (e := r.at(episode)) is not None} for found in (a, b)]
    try:
        _, ours, theirs = pair_by_seed(*sides, where=f"@{episode}")
    except ConfigError as error:
        return str(error)
    found = paired_difference(ours, theirs)
    return f"{found.estimate:+.1f} [{found.low:+.1f}, {found.high:+.1f}]" if found.count > 1 else "-"
