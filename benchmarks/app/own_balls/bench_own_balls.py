"""`bench paper-perception --recorded`: every method on recordings of one's own, against what people labelled in them.

A method is asked at every label, with a lead-in, as by `labels score`, and an answer counts as on the simulated
recordings: within 8 px. Every annotator is scored apart; the methods have the settings that they come with, so that
nothing here is tuned on what is scored.
"""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.app.own_balls.labelled_set import (
    AnsweredLayer,
    LabelledLayer,
    OwnBallsRow,
    OwnSet,
    ball_numbers,
    count_by_source,
    count_by_state,
    own_recordings,
    read_own_set,
    rows_of,
)
from benchmarks.machine import describe_machine, machine_words
from benchmarks.perception.results import METHODS
from core.detection import Detection, Detector, make_detector
from core.detection.methods import Method, method_config, method_named
from core.events import Window
from core.files import replace_file
from core.jobs import ALONE, HERE, JobBackend, TaskControl, open_jobs
from core.metrics import WindowAnswers
from core.metrics.at_times import answers_at
from core.metrics.run import TimedDetector, one_opencv_thread
from core.recordings import open_recording
from core.text import markdown_table, plain
from labels.agreement import Agreement, measure_agreement
from labels.arrays import LabelArrays
from labels.score import SEAM_US, joined_in_time


def set_card(own: OwnSet) -> dict[str, object]:
    """Cameras, duration, and how many labels came about how. What a file cannot know is for the one who recorded."""
    first = own.first_looks()
    return {
        "recordings": [asdict(card) for card in own.recordings],
        "seconds": sum(card.seconds for card in own.recordings),
        "without_labels": [card.recording for card in own.recordings if not card.labels],
        "annotators": {
            name: {
                "labels": sum(len(layer.labels) for layer in own.first_looks(name)),
                "by_source": count_by_source(own.first_looks(name)),
                "by_state": count_by_state(own.first_looks(name)),
                "second_looks": sum(len(one.labels) for one in own.layers if one.blind and one.annotator == name),
            }
            for name in own.annotators
        },
        "labels": sum(len(layer.labels) for layer in first),
        "proposed_by": dict(sum((Counter(layer.proposed_by) for layer in first), Counter())),
    }


def set_remarks(own: OwnSet) -> Iterator[str]:
    """Sentences."""
    first = own.first_looks()
    proposed = sum((Counter(layer.proposed_by) for layer in first), Counter())
    if accepted := proposed.total():
        who = ", ".join(sorted(proposed))
        yield (
            f"{accepted} of {sum(len(layer.labels) for layer in first)} labels are accepted proposals of {who}, and "
            "favour the detector that made them: read the rows `by hand` first"
        )
    copied = count_by_source(first).get("interpolated", 0)
    if copied:
        yield f"{copied} labels are interpolated: nobody looked at each of them"
    if not any(layer.blind for layer in own.layers) and len(own.annotators) < 2:
        yield "nobody has looked twice: how exact the labels are is not known, nor whether an error below that is one"
    hidden = count_by_state(first).get("occluded", 0)
    if hidden:
        yield f"{hidden} balls are labelled as occluded: no method is asked for them"
    notes = [card.recording for card in own.recordings if card.notes]
    if notes:
        yield f"`rallyscope info` has notes on {', '.join(notes)}"


@dataclass(frozen=True, slots=True)
class AnnotatorPair:
    """Two that looked at the same instants."""

    first: str
    second: str
    """The same name for the blind second looks."""
    found: Agreement


def agreement_of_set(own: OwnSet) -> tuple[AnnotatorPair, ...]:
    """Every pair with a common label, as each said it before conflicts were settled."""
    blind = [one for one in own.layers if one.blind]
    pairs = [(first, second, own.first_looks(second)) for first, second in combinations(own.annotators, 2)]
    pairs += [(name, name, [one for one in blind if one.annotator == name]) for name in own.annotators]
    found = [AnnotatorPair(a, b, _agreement(own.first_looks(a), theirs)) for a, b, theirs in pairs]
    return tuple(pair for pair in found if pair.found.common)


def _agreement(mine: Sequence[LabelledLayer], theirs: Sequence[LabelledLayer]) -> Agreement:
    """Agreement over the cameras that both annotators have labelled."""
    of_place = {(one.path, one.camera): one.independent for one in theirs}
    both = [(one.independent, of_place[one.path, one.camera]) for one in mine if (one.path, one.camera) in of_place]
    moves, end_us = [], 0
    for pair in both:
        moves.append(end_us)
        end_us += max(int(labels.t_us[-1]) for labels in pair if len(labels)) + SEAM_US
    sides = [[pair[side] for pair in both] for side in (0, 1)]
    return measure_agreement(*(joined_in_time(side, moves) for side in sides))


DATA: Final = Path("rallyscope-data")
WARM_UP: Final = 3
"""Labels with a ball that a method sees before it is timed: compiling is no part of a step."""

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class AskedLayer:
    """What a method is asked of one layer: a piece of work."""

    method: Method
    path: Path
    camera: str
    asked: LabelArrays

    def __str__(self) -> str:
        return f"{self.method} on {self.camera} of {self.path.name}"


def run(
    progress: Progress,
    *,
    recorded: str,
    data: Path = DATA,
    annotator: str | None = None,
    only: str | None = None,
    report: Path | None = None,
    engine: JobBackend = HERE,
) -> dict[str, object]:
    """A row per annotator, kind of labels and method, recording by recording too, and the set's card.

    Raises:
        CommandError: if there are no recordings, no labels of them, or no such annotator or method.
        JobsError: if a cluster cannot be used, or the workers of a piece keep dying.
    """
    methods = METHODS if only is None else (method_named(only),)
    with open_jobs(ALONE if engine == HERE else engine, len(methods)) as jobs:
        paths = [jobs.share_file(path) for path in own_recordings(recorded)]
        own = read_own_set(paths, data / "labels", annotator)
        layers = own.first_looks()
        pieces = [AskedLayer(method, one.path, one.camera, one.asked) for method in methods for one in layers]
        found = jobs.run(ask_layer, pieces, name=str, progress=progress)
    numbers = _balls(own, layers)
    answered = {
        method: [
            AnsweredLayer(answers, layer.asked, number, cpu_ms)
            for (answers, cpu_ms), layer, number in zip(found[at : at + len(layers)], layers, numbers, strict=True)
        ]
        for method, at in zip(methods, range(0, len(found), len(layers)), strict=True)
    }
    rows = _rows(own, layers, answered)
    told: dict[str, object] = {
        "rows": [_finite(asdict(row)) for row in rows],
        "recordings": _by_recording(own, layers, answered),
        "agreement": [
            _finite({"first": pair.first, "second": pair.second} | asdict(pair.found)) for pair in agreement_of_set(own)
        ],
        "card": set_card(own),
        "remarks": list(set_remarks(own)),
        "machine": describe_machine("numba", "opencv-python-headless", clock="processor time of one thread, warm"),
    }
    if report is not None:
        replace_file(report, own_balls_page(told).encode(), durable=False)
        told["report"] = str(report)
    return told


def ask_layer(piece: AskedLayer, control: TaskControl) -> tuple[WindowAnswers, np.ndarray]:
    """What the method says at the labels, and the processor time in ms of the steps that answered."""
    window_us = method_config(piece.method).window.window_us
    seen = np.flatnonzero(piece.asked.seen)[:WARM_UP]
    with closing(open_recording(piece.path)) as recording, one_opencv_thread():
        stream = recording.cameras[piece.camera]
        answers_at(stream, make_detector(piece.method, stream.sensor), piece.asked.t_us[seen], window_us)
        detector = _NotedAnswers(make_detector(piece.method, stream.sensor))
        answers = answers_at(stream, detector, piece.asked.t_us, window_us, progress=control)
    return answers, 1e3 * np.array(detector.timed.seconds)[np.array(detector.answered, np.bool_)]


class _NotedAnswers:
    """A timed detector that notes which of its steps answered."""

    def __init__(self, detector: Detector) -> None:
        self.timed = TimedDetector(detector)
        self.answered: list[bool] = []

    @property
    def extra_circles(self) -> int:
        return self.timed.extra_circles

    def reset(self) -> None:
        self.timed.reset()

    def step(self, window: Window) -> Detection | None:
        found = self.timed.step(window)
        self.answered.append(found is not None)
        return found


def _balls(own: OwnSet, layers: Sequence[LabelledLayer]) -> list[np.ndarray]:
    """The number of the ball of each label asked about: one's labels of all cameras of a recording are of one ball."""
    numbers: dict[int, np.ndarray] = {}
    first = 0
    for path in dict.fromkeys(layer.path for layer in layers):
        for name in own.annotators:
            mine = [at for at, one in enumerate(layers) if one.path == path and one.annotator == name]
            for at, number in zip(mine, ball_numbers([layers[at].asked.t_us for at in mine]), strict=True):
                numbers[at] = first + number
            first += 1 + max((int(numbers[at].max(initial=0)) - first for at in mine), default=-1)
    return [numbers[at] for at in range(len(layers))]


def _rows(
    own: OwnSet, layers: Sequence[LabelledLayer], answered: Mapping[str, Sequence[AnsweredLayer]]
) -> list[OwnBallsRow]:
    """By annotator, then by kind of labels, so that the methods stand below each other."""
    rows: list[OwnBallsRow] = []
    for name in own.annotators:
        mine = [at for at, layer in enumerate(layers) if layer.annotator == name]
        found = [row for method, parts in answered.items() for row in rows_of(method, name, [parts[at] for at in mine])]
        groups = list(dict.fromkeys(row.group for row in found))
        rows += sorted(found, key=lambda row: groups.index(row.group))
    return rows


def _by_recording(
    own: OwnSet, layers: Sequence[LabelledLayer], answered: Mapping[str, Sequence[AnsweredLayer]]
) -> list[dict[str, object]]:
    """All labels of each recording, its cameras together."""
    told: list[dict[str, object]] = []
    for path in dict.fromkeys(layer.path for layer in layers):
        for name in own.annotators:
            mine = [at for at, one in enumerate(layers) if one.path == path and one.annotator == name]
            for method, parts in answered.items():
                for row in rows_of(method, name, [parts[at] for at in mine], kinds=False):
                    told.append({"recording": path.name} | _finite(asdict(row)))
    return told


def _finite(figures: Mapping[str, object]) -> dict[str, object]:
    """None for what nobody knows."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in figures.items()
    }


LINE: Final = 118
HOW: Final = """
Every method is asked at the instants that a person labelled, with a lead-in of 20 ms or ten windows before one that
stands alone. An answer within 8 px of the labelled centre is right; precision counts the answers at labels, recall the
labels with a ball. In brackets are 95 % intervals: Wilson's for shares, as if each ball had been asked about once,
and of errors a bootstrap over balls, from three balls on; a ball ends where no camera has a label for 100 ms. CPU is
the processor time of one thread for a step that answered. Errors have those of the labels in them.
"""
TO_FILL_IN: Final = (
    "lenses", "biases (the file)", "distance and placement", "light", "ball (colour, wear)", "who played",
    "balls at which speed", "what was left out, and why",
)  # fmt: skip
"""What no file knows."""


def own_balls_page(told: Mapping[str, Any]) -> str:
    """All of it, from what the bench returns."""
    card, rows = told["card"], told["rows"]
    parts = ["# Perception: a set of balls of one's own\n", _wrapped(HOW)]
    parts += [_wrapped(f"**{plain(remark[0].upper() + remark[1:])}.**") for remark in told["remarks"]]
    titles = (
        "annotator", "labels", "number", "balls", "method", "precision", "recall", "error mean px", "median", "p95",
        "along the motion", "CPU p50 ms", "p99",
    )  # fmt: skip
    parts += ["## What is found, and how exactly\n", markdown_table(titles, [_row(row) for row in rows])]
    parts += ["## How well people agree\n", _agreement_table(told["agreement"])]
    parts += ["## Recording by recording\n"]
    columns = ("recording", "annotator", "labels", "balls", "method", "precision", "recall", "median px", "p95")
    parts.append(markdown_table(columns, [_recording_row(row) for row in told["recordings"]]))
    parts += ["## The card\n", *_card(card), _wrapped(f"Measured on: {machine_words(told['machine'])}.")]
    return "\n".join(parts)


def _wrapped(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), LINE, break_long_words=False, break_on_hyphens=False) + "\n"


def _figure(row: Mapping[str, Any], name: str, form: str, bounds: tuple[str, str] | None = None) -> str:
    if row[name] is None:
        return "-"
    value = format(row[name], form)
    if bounds is None or row[bounds[0]] is None:
        return value
    return f"{value} [{format(row[bounds[0]], form)}, {format(row[bounds[1]], form)}]"


def _row(row: Mapping[str, Any]) -> tuple[object, ...]:
    return (
        plain(row["annotator"]), row["group"], str(row["labels"]), str(row["balls"]), f"`{row['method']}`",
        _figure(row, "precision", ".3f", ("precision_low", "precision_high")),
        _figure(row, "recall", ".3f", ("recall_low", "recall_high")),
        _figure(row, "error_mean_px", ".2f"),
        _figure(row, "error_median_px", ".2f", ("error_median_low_px", "error_median_high_px")),
        _figure(row, "error_p95_px", ".2f", ("error_p95_low_px", "error_p95_high_px")),
        _figure(row, "along_px", "+.2f"), _figure(row, "cpu_p50_ms", ".3f"), _figure(row, "cpu_p99_ms", ".3f"),
    )  # fmt: skip


def _recording_row(row: Mapping[str, Any]) -> tuple[object, ...]:
    figures = (("precision", ".3f"), ("recall", ".3f"), ("error_median_px", ".2f"), ("error_p95_px", ".2f"))
    names = (plain(row["recording"]), plain(row["annotator"]), str(row["labels"]), str(row["balls"]))
    return (*names, f"`{row['method']}`", *(_figure(row, name, form) for name, form in figures))


def _agreement_table(pairs: Sequence[Mapping[str, Any]]) -> str:
    if not pairs:
        return "Nobody has looked at the same instant twice.\n"
    titles = ("first", "second", "common", "same state", "both see the ball", "median px", "p95", "sigma of one")
    rows = [
        (
            plain(one["first"]), plain(one["second"] if one["second"] != one["first"] else "second looks"),
            str(one["common"]), str(one["same_state"]), str(one["both_seen"]),
            _figure(one, "median_px", ".2f", ("median_low_px", "median_high_px")), _figure(one, "p95_px", ".2f"),
            _figure(one, "sigma_px", ".2f"),
        )
        for one in pairs
    ]  # fmt: skip
    return markdown_table(titles, rows)


def _card(card: Mapping[str, Any]) -> list[str]:
    titles = ("recording", "seconds", "cameras", "million events", "labels", "notes")
    rows = [
        (
            plain(one["recording"]), f"{one['seconds']:.1f}", plain("; ".join(one["cameras"])),
            f"{1e-6 * one['events']:.2f}", str(one["labels"]), str(len(one["notes"])),
        )
        for one in card["recordings"]
    ]  # fmt: skip
    lines = []
    for name, said in card["annotators"].items():
        how, what = (
            ", ".join(f"{key.replace('_', ' ')} {count}" for key, count in said[part].items())
            for part in ("by_source", "by_state")
        )
        lines.append((plain(name), str(said["labels"]), how, what, str(said["second_looks"])))
    made = ("annotator", "labels", "how they came about", "what they say", "second looks")
    asked = "".join(f"- {what}:\n" for what in TO_FILL_IN)
    return [markdown_table(titles, rows), markdown_table(made, lines), "What no file knows:\n", asked]
