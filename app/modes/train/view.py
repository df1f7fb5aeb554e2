"""Data of the runs shown in Train, collected off the loop: states, curves, landings, log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.modes.train.curves import (
    CURVES,
    Curves,
    SeedResults,
    curves_of,
    interval_curves,
    mean_curve,
    on_axis,
    points_on_axis,
    seed_results,
    shared_axis,
    stage_borders,
    stages_of,
    with_borders,
)
from app.modes.train.plan_view import draw_offsets, draw_plan, encode_plan
from app.scene.prediction import REACH_M, SPOTS
from app.shared.rallies import has_policy
from app.shared.trainer import RunState, Trainer, read_log_tail
from app.shared.training_records import Metrics, MetricsStore, last_line
from app.shared.workspace import Workspace
from core.history.rally_picture import LandingSpot
from core.learning.config import RunConfig
from core.learning.evaluation.reachable import reachable_words
from core.learning.runs.run_files import seed_files
from core.physics.episode import Case

Array = NDArray[np.float64]
COMPARED: Final = 3
"""Most runs drawn beside the chosen one."""
PLAN_SPOTS: Final = 2000
SEEDS_DRAWN: Final = 50
"""Most lines of single seeds, those before the newest."""
LISTED: Final = 40
"""Most runs in the table."""


@dataclass(frozen=True, slots=True)
class ViewRequest:
    """A browser's request."""

    run: str | None
    """Name of the run; None: the one in training, or the last one."""
    compared: tuple[str, ...] | None
    """Runs to compare; None: those before it."""
    shown: object = None
    """The `key` of what is already shown."""


@dataclass(frozen=True, slots=True, eq=False)
class ChartData:
    """Aligned arrays of every chart."""

    axis: Array
    """Episodes of the run."""
    end: int
    """Planned number of episodes."""
    run: dict[str, Array]
    """Values of the chosen seed, by the names in CURVES."""
    evaluated: dict[str, Array]
    """`returned` and `error_mm` of the policy on the fixed balls; NaN between evaluations."""
    seeds_mean: dict[str, Array]
    """Mean over seeds; NaN for a run with one seed, as are both ends of its 95 % interval:"""
    seeds_low: dict[str, Array]
    seeds_high: dict[str, Array]
    seeds: dict[int, dict[str, Array]]
    """Seed -> values, of the other seeds that were started, at most SEEDS_DRAWN."""
    compared: tuple[dict[str, Array], ...]
    """Curves of exactly COMPARED runs; unused ones are all NaN."""
    borders: Array
    """Episodes with which another stage of the chosen seed began; the axis has each of them twice or more."""
    stages: tuple[tuple[float, float], ...]
    """First episode of each of its stages, 0 for the first one, and its speed in m/s."""


@dataclass(frozen=True, slots=True, eq=False)
class Details:
    """Details of the chosen run, made anew only when there is something new."""

    charts: ChartData
    counts: dict[Case, int]
    plan_png: bytes
    offsets_png: bytes
    spots: tuple[LandingSpot, ...]
    recent: tuple[dict[str, object], ...]
    evaluations: tuple[dict[str, object], ...]
    returned: float
    """Share returned of the last balls, %, with exploration noise; NaN before the first."""
    error_mm: float
    episodes_done: int
    seed: int
    stage_starts: tuple[dict[str, object], ...] = ()
    seed_results: SeedResults | None = None
    """Results of all seeds; None for a run with one seed."""


@dataclass(frozen=True, slots=True, eq=False)
class RunsView:
    """What Train shows of all runs."""

    runs: tuple[RunState, ...]
    results: dict[str, dict[str, object]]
    """Name of a run -> its last evaluation."""
    run: RunState | None
    compared: tuple[str, ...]
    log: tuple[str, ...]
    key: object
    details: Details | None
    """Details of the chosen run; None: unchanged."""
    playable: bool = False
    """Whether the run has ended and has a policy."""
    bounds: tuple[str, ...] = ()
    """Lines on limits of the run by the racket's bounds."""


class RunsViewer:
    """Answers the requests of one browser, one at a time."""

    def __init__(self, workspace: Workspace, trainer: Trainer, metrics: MetricsStore) -> None:
        self._workspace = workspace
        self._trainer = trainer
        self._metrics = metrics
        self._known: dict[str, tuple[float, dict[str, object] | None]] = {}

    def __call__(self, request: ViewRequest) -> RunsView:
        """Current view."""
        runs = self._trainer.runs()
        run = chosen_run(runs, request.run)
        if run is None:
            return RunsView(runs, {}, None, (), (), None, None)
        compared = compared_runs(runs, run, request.compared)
        seeds = started_seeds(run)
        metrics = {seed: self._metrics.read(self._workspace.run_path(run.name), seed) for seed in seeds}
        others = {other.name: self._first_seed(other) for other in compared}
        key = (
            run.name,
            tuple((seed, len(m), len(m.evaluations)) for seed, m in metrics.items()),
            tuple((name, len(m)) for name, m in others.items()),
            run.phase == "finished",
        )
        details = None
        if key != request.shown:
            finished = run.phase == "finished"
            details = make_details(metrics, list(others.values()), run.config.episodes, finished=finished)
        log = read_log_tail(self._workspace.run_path(run.name))
        playable = not run.active and has_policy(self._workspace, run.name)
        bounds = reachable_words(run.config.environment, run.config.curriculum.speeds_mps)
        return RunsView(runs, self._results(runs), run, tuple(others), log, key, details, playable, bounds)

    def _results(self, runs: tuple[RunState, ...]) -> dict[str, dict[str, object]]:
        for run in runs[:LISTED]:
            known = self._known.get(run.name)
            if known is None or known[0] != run.changed_s:
                seed = run.config.first_seed if run.status is None else run.status.seed
                line = last_line(seed_files(self._workspace.run_path(run.name), seed).evaluations)
                self._known[run.name] = (run.changed_s, line)
        return {name: line for name, (_, line) in self._known.items() if line is not None}

    def _first_seed(self, run: RunState) -> Metrics:
        return self._metrics.read(self._workspace.run_path(run.name), run.config.first_seed)


def chosen_run(runs: tuple[RunState, ...], name: str | None) -> RunState | None:
    """The named run; else the one in training; else the last one."""
    by_name = {run.name: run for run in runs}
    active = next((run for run in runs if run.active), None)
    return by_name.get(name or "") or active or (runs[0] if runs else None)


def compared_runs(runs: tuple[RunState, ...], run: RunState, names: tuple[str, ...] | None) -> tuple[RunState, ...]:
    """Runs to compare with: the named ones, or the last ones."""
    others = [other for other in runs if other.name != run.name]
    if names is not None:
        others = [other for other in others if other.name in names]
    return tuple(others[:COMPARED])


def started_seeds(run: RunState) -> tuple[int, ...]:
    """Seeds started so far; the last one is in training."""
    config: RunConfig = run.config
    last = config.first_seed if run.status is None else run.status.seed
    return tuple(range(config.first_seed, min(last, config.first_seed + config.seeds - 1) + 1))


def make_details(
    metrics: dict[int, Metrics], others: list[Metrics], planned: int, *, finished: bool = False
) -> Details:
    """Curves, spots and figures of a run's newest seed, beside the first seeds of other runs.

    `planned` is how many episodes the run is to have; what others did after as many is not drawn.
    `finished`: no seed goes on.
    """
    # The largest number: seeds begin in order.
    seed, newest = max(metrics.items())
    recent = newest.recent
    goal = recent[-1].get("goal_m") if recent else None
    cases, landings = newest.columns["case"], newest.landings_m
    curves = {number: curves_of(m) for number, m in metrics.items()}
    return Details(
        charts=_charts(curves, [curves_of(m) for m in others], planned, newest.columns["speed_mps"]),
        counts={case: int(np.count_nonzero(cases == case)) for case in Case},
        plan_png=encode_plan(
            draw_plan(cases[-PLAN_SPOTS:], landings[-PLAN_SPOTS:], np.array(goal) if isinstance(goal, list) else None)
        ),
        offsets_png=encode_plan(draw_offsets(landings[-PLAN_SPOTS:], newest.goals_m[-PLAN_SPOTS:])),
        spots=_spots(cases, landings),
        recent=recent,
        evaluations=newest.evaluations,
        returned=_last(curves[seed].values["returned"]),
        error_mm=_last(curves[seed].values["error_mm"]),
        episodes_done=len(newest),
        seed=seed,
        stage_starts=newest.stage_starts,
        seed_results=seed_results({n: m.evaluations for n, m in metrics.items()}, finished=finished),
    )


def _charts(by_seed: dict[int, Curves], others: list[Curves], planned: int, speeds_mps: Array) -> ChartData:
    """Charts of a run's seeds, the newest last, beside other runs; `speeds_mps` (N,) of the newest seed's balls."""
    curves, borders = list(by_seed.values()), stage_borders(speeds_mps)
    longest = max(len(c) for c in curves)
    # Two points at least: a chart with one may never show its ticks.
    axis = shared_axis(max(longest, min(planned, max((len(c) for c in others), default=0)), 2), len(curves))
    axis = with_borders(axis, borders)
    ours = curves[-1]
    nothing = np.full(len(axis), np.nan)
    several = len(curves) > 1
    bands = {name: interval_curves([c.values[name] for c in curves]) for name in CURVES} if several else {}
    shown = [{name: on_axis(c.values[name], axis) for name in CURVES} for c in others]
    single = list(by_seed.items())[:-1][-SEEDS_DRAWN:]
    return ChartData(
        axis,
        max(planned, longest),
        {name: on_axis(ours.values[name], axis) for name in CURVES},
        {name: points_on_axis(ours.evaluated_at, values, axis) for name, values in ours.evaluated.items()},
        {name: on_axis(mean_curve([c.values[name] for c in curves]), axis) if several else nothing for name in CURVES},
        {name: on_axis(bands[name][0], axis) if several else nothing for name in CURVES},
        {name: on_axis(bands[name][1], axis) if several else nothing for name in CURVES},
        {seed: {name: on_axis(c.values[name], axis) for name in CURVES} for seed, c in single},
        (*shown, *[dict.fromkeys(CURVES, nothing)] * (COMPARED - len(shown))),
        borders,
        stages_of(speeds_mps),
    )


def _spots(cases: Array, landings_m: Array) -> tuple[LandingSpot, ...]:
    known = np.isfinite(landings_m).all(axis=1) & (np.abs(np.nan_to_num(landings_m)).max(axis=1) < REACH_M)
    rows = np.flatnonzero(known)[-SPOTS:]
    return tuple(
        LandingSpot(float(landings_m[row, 0]), float(landings_m[row, 1]), Case(int(cases[row]))) for row in rows
    )


def _last(values: Array) -> float:
    return float(values[-1]) if len(values) else float("nan")
