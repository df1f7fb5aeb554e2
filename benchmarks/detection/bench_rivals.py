"""Every method with equal chances: the same number of trials on the same flights of each kind shown, then scored on
others.

A method is shown with its settings as they come and with the tuned ones; the delay of sensor and method is taken out
of both (`benchmarks.detection.equal_tuning`). Recordings, tuned settings and scores are kept in the folder: an
interrupted bench goes on where it was. After a change of a method's code, remove the folders `tuned` and `scores`.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.detection.bench_drawn_scenes import SCORED_FROM
from benchmarks.detection.equal_tuning import (
    KINDS,
    FlightCamera,
    Kind,
    TunedMethod,
    answers_of,
    drawn_rows,
    flight_cameras,
    score_answers,
    tune_equally,
)
from benchmarks.machine import describe_machine, machine_words
from core.config import config_to_mapping, replace_setting
from core.detection import DetectorConfig
from core.detection.methods import Method, method_config
from core.detection.saved import load_detector, save_detector
from core.files import read_json, replace_file, write_json
from core.metrics.grid_score import GridScore
from core.text import markdown_table

FOLDER: Final = Path("rallyscope-data/bench-rivals")
REPORT: Final = Path("docs/measured/rivals-report.md")
METHODS: Final[tuple[Method, ...]] = ("paper", "auto", "refined", "ebpp", "fe-fusion")
TRIALS: Final = 24
COUNT: Final = 4
"""Flights of each kind that are scored."""
TUNED_ON: Final = 3
"""Flights of each kind that are tuned on, the first camera of each: half of the time for other flights."""
TUNED_FROM: Final = 2000
"""Number of the first of these. No default was found with them, nor with those that are scored."""
SCORED: Final = SCORED_FROM + 1000
SEED: Final = 0
"""Seed of the search."""
FRESH: Final[dict[Method, tuple[str, str]]] = {
    "ebpp": ("ebpp", "fresh_min"),
    "fe-fusion": ("fe_fusion", "fresh_min"),
}
"""The settings that refuse an answer without new events."""
FRESH_SETTINGS: Final = ("as they come", "any")
RESAMPLES: Final = 1000
TITLES: Final = ("scenes", "method", "settings", "precision", "recall", "error median px", "p95", "delay us")
FRESH_TITLES: Final = ("scenes", "method", "new events", "precision", "recall", "answers", "false")

Scores = dict[Kind, list[GridScore]]
"""By kind, a score for each flight, both cameras together."""


def run(
    progress: Callable[[float], None],
    *,
    folder: Path = FOLDER,
    report: Path = REPORT,
    count: int = COUNT,
    trials: int = TRIALS,
) -> dict[str, object]:
    """A row per kind of scene, method and settings, those on new events, the settings found, and the machine."""
    tuned: list[TunedMethod] = []
    for number, method in enumerate(METHODS):

        def tuning_progress(share: float, number: int = number) -> None:
            progress(0.8 * (number + share) / len(METHODS))

        tuned.append(_kept_tuning(method, trials, folder, tuning_progress))
    configs = {(one.method, name): getattr(one, key) for one in tuned for name, key in SETTINGS.items()}
    for method, path in FRESH.items():
        configs[method, "any"] = replace_setting(configs[method, "as they come"], path, 0.0)
    found: dict[tuple[Method, str], Scores] = {}
    for done, ((method, name), config) in enumerate(configs.items()):
        found[method, name] = score_config(method, config, count, folder)
        progress(0.8 + 0.2 * (done + 1) / len(configs))
    rows = [_row(kind, one, name, found) for kind in KINDS for one in tuned for name in SETTINGS]
    fresh = [_fresh_row(kind, method, name, found) for kind in KINDS for method in FRESH for name in FRESH_SETTINGS]
    machine = describe_machine("numba", "opencv-python-headless", "optuna", clock="none: counts and pixels")
    page = write_report(rows, fresh, tuned, count, trials, machine)
    replace_file(report, page.encode(), durable=False)
    places = {one.method: str(_settings_path(one.method, folder)) for one in tuned}
    return {"rows": rows, "new_events": fresh, "settings": places, "report": str(report), "machine": machine}


SETTINGS: Final = {"as they come": "start", "tuned": "best"}
"""Names of the settings that are scored, and which of `TunedMethod` they are."""


@functools.cache
def _tuned_on(folder: Path) -> dict[Kind, list[FlightCamera]]:
    """The first camera of each flight that is tuned on, read once for all methods."""
    drawn = {kind: drawn_rows(kind, TUNED_FROM, TUNED_ON) for kind in KINDS}
    there = folder / "recordings"
    return {kind: [flight_cameras(row, number, there)[0] for row, number in rows] for kind, rows in drawn.items()}


def _settings_path(method: Method, folder: Path) -> Path:
    return folder / "tuned" / f"{method}.toml"


def _kept_tuning(method: Method, trials: int, folder: Path, progress: Callable[[float], None]) -> TunedMethod:
    """The tuning of a method, done now, or kept from the same number of trials and the same settings to start from."""
    settings, about = _settings_path(method, folder), folder / "tuned" / f"{method}.json"
    asked = {"trials": trials, "seed": SEED, "flights": TUNED_ON, "from": TUNED_FROM, "start": _stamp(method)}
    kept: dict[str, Any] = read_json(about)
    if kept.get("asked") == asked and settings.is_file():
        start = load_detector(folder / "tuned" / f"{method}-as-it-comes.toml").config
        figures = (kept["start_objective"], kept["best_objective"], trials, tuple(kept["searched"]))
        return TunedMethod(method, start, load_detector(settings).config, *figures)
    one = tune_equally(method, _tuned_on(folder), trials, SEED, progress)
    settings.parent.mkdir(parents=True, exist_ok=True)
    save_detector(method, one.start, folder / "tuned" / f"{method}-as-it-comes.toml")
    save_detector(method, one.best, settings)
    figures = {"start_objective": one.start_objective, "best_objective": one.best_objective, "searched": one.searched}
    write_json(about, {"asked": asked, **figures})
    return one


def _stamp(method: Method, config: DetectorConfig | None = None) -> str:
    """A name for settings."""
    settings = config_to_mapping(method_config(method, config))
    return hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode()).hexdigest()[:10]


def score_config(method: Method, config: DetectorConfig, count: int, folder: Path) -> Scores:
    """Scores of a config on the flights that nothing was tuned on."""
    near_us = method_config(method).window.window_us
    found: Scores = {}
    for kind in KINDS:
        for row, number in drawn_rows(kind, SCORED, count):
            path = folder / "scores" / f"{row}-{number}-{method}-{_stamp(method, config)}.json"
            if not path.is_file():
                score = GridScore()
                for camera in flight_cameras(row, number, folder / "recordings"):
                    score += score_answers(camera, answers_of(camera, method, config), near_us)
                write_json(path, {name: _plain(value) for name, value in asdict(score).items()})
            stored: dict[str, Any] = read_json(path)
            arrays = {name: np.array(value, np.float64) for name, value in stored.items() if isinstance(value, list)}
            found.setdefault(kind, []).append(GridScore(**{**stored, **arrays}))
    return found


def _plain(value: object) -> object:
    """A field of a score as JSON; the error along no motion is not a number there."""
    return np.round(np.nan_to_num(value), 4).tolist() if isinstance(value, np.ndarray) else value


FIGURES: Final[dict[str, Callable[[GridScore], float]]] = {
    "precision": lambda one: one.precision,
    "recall": lambda one: one.recall,
    "median_px": lambda one: one.error_at(50),
    "p95_px": lambda one: one.error_at(95),
}


def with_intervals(flights: Sequence[GridScore]) -> dict[str, tuple[float, float, float]]:
    """Each figure over all answers of the flights together, and its 95 % bootstrap interval over the flights."""
    rng = np.random.default_rng(0)
    draws = rng.integers(0, len(flights), (RESAMPLES, len(flights)))
    drawn: dict[str, list[float]] = {name: [] for name in FIGURES}
    # The order within a draw changes nothing: of few flights there are few different draws.
    kinds, counts = np.unique(np.sort(draws, axis=1), axis=0, return_counts=True)
    for draw, times in zip(kinds, counts.tolist(), strict=True):
        whole = sum((flights[k] for k in draw), GridScore())
        for name, figure in FIGURES.items():
            drawn[name] += times * [figure(whole)]
    whole = sum(flights, GridScore())
    return {name: (figure(whole), *_middle(drawn[name])) for name, figure in FIGURES.items()}


def _middle(values: Sequence[float]) -> tuple[float, float]:
    """Between what 95 % of the known values lie; nan if there are none."""
    known = [value for value in values if not np.isnan(value)]
    low, high = np.percentile(known, (2.5, 97.5)).tolist() if known else (float("nan"), float("nan"))
    return low, high


def _row(kind: Kind, one: TunedMethod, name: str, found: Mapping[tuple[Method, str], Scores]) -> dict[str, object]:
    flights = found[one.method, name][kind]
    config = getattr(one, SETTINGS[name])
    row: dict[str, object] = {"scenes": kind, "method": one.method, "settings": name}
    for figure, (value, low, high) in with_intervals(flights).items():
        row |= {figure: value, f"{figure}_interval": (low, high)}
    return row | {"delay_us": one.delay_of(config)}


def _fresh_row(kind: Kind, method: Method, name: str, found: Mapping[tuple[Method, str], Scores]) -> dict[str, object]:
    whole = sum(found[method, name][kind], GridScore())
    return {
        "scenes": kind,
        "method": method,
        "new_events": "not asked for" if name == "any" else "asked for",
        "precision": whole.precision,
        "recall": whole.recall,
        "answers": whole.answers,
        "false": whole.false,
    }


CONDITIONS: Final = """
Made by `rallyscope bench rivals --trials {trials} --count {count}`. Every method is tuned by one protocol: {trials}
trials (the settings as they come, 16 near them, then a tree-structured Parzen estimator; search seed {seed}) on the
same {tuned} flights of each kind (numbers {tuned_from} to {tuned_to}, the left camera), one config for both kinds.
Scored on {count} other flights of each kind (numbers {scored_from} to {scored_to}, both cameras). No default was found
with any of them. Flights are drawn (`draw_flight`): placement, speed of 5 to 9 m/s, direction, spin; 1280x720, the
standard sensor.
`ball only`: 0.1, 1 or 5 noise events a second and pixel. `people`: a person or a head, and two persons or a rally, in
turn.

The searched settings are those that `rallyscope tune` searches by default, except delays. Sensor and method delay an
answer. One rule for all: the median lag (error along the motion over speed, balls above 0.5 px/ms) on the flights tuned
on becomes the method's delay, in every trial and of the settings as they come too. What is maximised: the mean over
both kinds of F1 less 0.02 per pixel of median error.

Precision: every answer without the ball within 8 px at its own time is false. Recall: of the milliseconds at which the
whole disc is in view and has been for 10 ms, those with a right answer within half a window. Figures are over all
answers of the flights together, not means of flights; in brackets the 95 % bootstrap interval over the {count} flights.
"""


def write_report(
    rows: Sequence[Mapping[str, Any]],
    fresh: Sequence[Mapping[str, Any]],
    tuned: Sequence[TunedMethod],
    count: int,
    trials: int,
    machine: Mapping[str, object],
) -> str:
    """The report as Markdown."""
    numbers = {"tuned_from": TUNED_FROM, "tuned_to": TUNED_FROM + TUNED_ON - 1, "tuned": TUNED_ON}
    scored = {"scored_from": SCORED, "scored_to": SCORED + count - 1, "count": count}
    lines = [
        "# Every method with equal chances",
        "",
        CONDITIONS.format(trials=trials, seed=SEED, **numbers, **scored).strip(),
    ]
    lines += ["", "## What each method reaches", "", markdown_table(TITLES, [_cells(row) for row in rows])]
    lines += [
        "## What the search changed",
        "",
        "Objective: on the flights tuned on. `detect --config` takes the files that",
        "the bench leaves in its folder `tuned`.",
        "",
    ]
    changes = [
        (f"`{one.method}`", len(one.searched), f"{one.start_objective:.3f} to {one.best_objective:.3f}", _changes(one))
        for one in tuned
    ]
    lines += [markdown_table(("method", "settings searched", "objective", "changed"), changes)]
    lines += [
        "## Answers without new events",
        "",
        "The scored flights with the default `fresh_min` and with 0, all else as it comes.",
        "",
    ]
    table = [(row["scenes"], f"`{row['method']}`", *list(row.values())[2:]) for row in fresh]
    lines += [markdown_table(FRESH_TITLES, table, ("", "", "", ".3f", ".3f", "d", "d"))]
    return "\n".join([*lines, f"Made on {machine_words(machine)}.", ""])


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    figures = []
    for name in FIGURES:
        form = ".2f" if name.endswith("_px") else ".3f"
        low, high = row[f"{name}_interval"]
        figures.append(f"{row[name]:{form}} [{low:{form}}, {high:{form}}]")
    return (row["scenes"], f"`{row['method']}`", row["settings"], *figures, str(row["delay_us"]))


def _changes(one: TunedMethod) -> str:
    changed = [f"`{name}` {_short(before)} to {_short(after)}" for name, (before, after) in one.changed.items()]
    return ", ".join(changed) or "nothing"


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
