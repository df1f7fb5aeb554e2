"""The app for so many minutes under load: does it keep its rate, and does anything grow?

First eight browsers look at a live rally, then label one recording together. For a third of the time three browsers
watch the rally while it is recorded; then one watches on, one labels and one trains, in turns. Every few seconds the
memory, threads and open files of the app and of its simulation are counted.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

import numpy as np

from app.modes.label.labelling import DEFAULT_STEP_US
from benchmarks.app.bare_browser import Visitor
from benchmarks.app.served_app import ProcessUsage, ServedApp, served, usage_of
from benchmarks.machine import Row, describe_machine, goal_row
from core.cameras import stereo_preset
from core.recordings import open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from labels.store import LabelStore, find_layers

NEXT, NO_BALL = "Label: Next time", "Label: No ball here"
PATIENCE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class SharedRecording:
    """What they label."""

    path: Path
    uuid: str
    words: str
    """That stand in a panel when it is open and not when another one is."""
    steps: int
    """Of Label's grid of times."""

    @classmethod
    def of(cls, path: Path) -> Self:
        """The one in this file of the workspace."""
        with open_recording(path) as recording:
            events = f"{recording.cameras['left'].event_count:,}"
            return cls(path, recording.uuid, events, recording.duration_us // DEFAULT_STEP_US)

    @property
    def name(self) -> str:
        """In the list of recordings."""
        return self.path.stem


@dataclass(frozen=True, slots=True)
class AnnotatorCounts:
    """What is in the store against what was asked for."""

    wanted: int
    lost: int
    wrong: int
    """Labels that nobody asked for: at another one's time, or twice."""


class Annotator:
    """One of them, with a browser."""

    def __init__(self, visitor: Visitor, recording: SharedRecording, number: int, of: int) -> None:
        self._visitor, self._recording = visitor, recording
        self.name = f"annotator-{number}"
        self._number, self._of = number, of
        self._steps: list[int] = []
        """Steps of the grid that were labelled."""
        self._at = 0

    @property
    def times_us(self) -> set[int]:
        """Times that have to be labelled."""
        return {step * DEFAULT_STEP_US for step in self._steps}

    def begin(self) -> None:
        """Open the recording in Label, at this one's first time."""
        self._visitor.change("Recording", self._recording.name)
        self._visitor.wait_text(self._recording.words)
        seen = self._visitor.pictures
        self._visitor.trigger("Mode: Label")
        self._visitor.wait_picture(PATIENCE_S, after=seen)
        self._visitor.wait_quiet()
        self._visitor.change("Annotator", self.name)
        self._visitor.wait_quiet()
        self._go_first()

    def label(self, count: int) -> None:
        """Label so many of this one's times; after the last one the first ones again."""
        for _ in range(count):
            if self._at + self._of >= self._recording.steps:
                self._go_first()
            self._steps.append(self._at)
            self._press(NO_BALL)
            self._go(self._of - 1)

    def _go_first(self) -> None:
        self._visitor.trigger("Label: First time")
        self._visitor.wait_quiet()
        self._at = 0
        self._go(self._number)

    def _go(self, steps: int) -> None:
        for _ in range(steps):
            self._press(NEXT)

    def _press(self, command: str) -> None:
        """A key that goes on by one time."""
        seen = self._visitor.pictures
        self._visitor.trigger(command)
        self._visitor.wait_picture(PATIENCE_S, after=seen)
        self._at += 1


def label_together(annotators: list[Annotator], count: int) -> None:
    """All of them at once, each so many labels.

    Raises:
        TimeoutError: if the app did not answer one of them.
    """
    problems: list[OSError] = []

    def work(annotator: Annotator) -> None:
        try:
            annotator.label(count)
        except OSError as error:  # TimeoutError is one
            problems.append(error)

    threads = [threading.Thread(target=work, args=(annotator,)) for annotator in annotators]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if problems:
        raise problems[0]


def count_labels(labels: Path, recording: SharedRecording, annotators: list[Annotator]) -> AnnotatorCounts:
    """Compare what is in the folder of labels with what they did."""
    wanted = lost = wrong = 0
    layers = {layer.annotator: layer for layer in find_layers(labels, recording.uuid)}
    for annotator in annotators:
        there: set[int] = set()
        if annotator.name in layers:
            store = LabelStore.read(labels, layers[annotator.name])
            there = {int(t_us) for t_us in store.by_time()}
            store.close()
        wanted += len(annotator.times_us)
        lost += len(annotator.times_us - there)
        wrong += len(there - annotator.times_us)
    return AnnotatorCounts(wanted, lost, wrong)


VISITORS: Final = 8
WATCHING, LABELLING, TRAINING = 3, 3, 1
"""The first so many watch; the numbers of those that label and train afterwards."""
RECORDING: Final = "soak"
SERVES: Final = 6
LABELS_EACH: Final = 20
SAMPLE_S: Final = 5.0
TURN_S: Final = 60.0
START_S: Final = 900.0
"""To compile and to make the demo recording, where that was never done."""


@dataclass(slots=True)
class Samples:
    """Samples of one process over time."""

    at_s: list[float] = field(default_factory=list)
    usages: list[ProcessUsage] = field(default_factory=list)

    def take(self, pid: int) -> None:
        """One more."""
        self.at_s.append(time.monotonic())
        self.usages.append(usage_of(pid))

    def growth_mb_per_h(self) -> float:
        """Slope of a straight line through the memory of the last two thirds: the median of the slopes of all pairs."""
        first = len(self.at_s) // 3
        at_h = np.array(self.at_s[first:]) / 3600
        mb = np.array([usage.resident_mb for usage in self.usages[first:]])
        i, j = np.triu_indices(len(at_h), 1)
        return float(np.median((mb[j] - mb[i]) / (at_h[j] - at_h[i]))) if len(i) else float("nan")

    def more(self, what: Callable[[ProcessUsage], int]) -> float:
        """How many more there are in the last third than in the one before, where each has fewest.

        A training that runs has threads and pipes of its own for a while: they are no growth.
        """
        third = len(self.usages) // 3
        counts = [what(usage) for usage in self.usages]
        return float(min(counts[2 * third :]) - min(counts[third : 2 * third]))


def run_soak(progress: Callable[[float], None], minutes: float) -> dict[str, object]:
    """Rows: rates, labels lost, growth; each with its goal."""
    with tempfile.TemporaryDirectory(prefix="rallyscope-soak-", ignore_cleanup_errors=True) as folder:
        workspace = Path(folder)
        recordings = workspace / "recordings"
        recordings.mkdir()
        file = recordings / f"{RECORDING}.h5"
        launches = [LaunchConfig()] * SERVES
        simulate_recording(file, StereoConfig(sensor=SensorConfig()), stereo_preset(), launches, seed=1)
        recording = SharedRecording.of(file)
        with served(workspace) as app:
            visitors = [Visitor(app.port) for _ in range(VISITORS)]
            try:
                rows, annotators = _soak(app, recording, visitors, 60 * minutes, progress)
            finally:
                for visitor in visitors:
                    visitor.close()
        rows += label_rows(count_labels(workspace / "labels", recording, annotators))
    return {"rows": rows, "minutes": minutes, "machine": describe_machine("viser")}


def _soak(
    app: ServedApp,
    shared: SharedRecording,
    visitors: list[Visitor],
    seconds: float,
    progress: Callable[[float], None],
) -> tuple[list[Row], list[Annotator]]:
    for visitor in visitors:
        visitor.wait_rally(START_S)
    measured_s = min(60.0, seconds / 4)
    time.sleep(measured_s)
    rows = [_rate_row(f"{VISITORS} browsers on a live rally", visitors, measured_s)]
    annotators = [Annotator(visitor, shared, number, VISITORS) for number, visitor in enumerate(visitors)]
    for annotator in annotators:
        annotator.begin()
    label_together(annotators, LABELS_EACH)
    for visitor in visitors[LABELLING + 1 :]:
        visitor.close()
    stay = visitors[:WATCHING]
    for visitor in stay:
        visitor.trigger("Mode: Watch")
        visitor.change("Recording", "live")
    stay[0].press("Record")
    begun_s, server, simulation = time.monotonic(), Samples(), Samples()
    recording, turn_s, training = True, 0.0, False

    def spent() -> float:
        return time.monotonic() - begun_s

    while spent() < seconds:
        if not recording and spent() >= turn_s:
            turn_s = spent() + TURN_S
            training = not training
            if training:
                stay[TRAINING].press("Train now")
        if not (recording or training):
            annotators[LABELLING].label(LABELS_EACH // 4)
        if recording and spent() >= seconds / 3:
            recording = False
            rows.append(_rate_row(f"{WATCHING} browsers, recording", stay, 0.9 * spent()))
            stay[0].press("Record")
            stay[TRAINING].trigger("Mode: Train")
            stay[2].close()
        server.take(app.process.pid)
        pid = app.simulation()
        if pid is not None:
            simulation.take(pid)
        progress(min(1.0, spent() / seconds))
        time.sleep(SAMPLE_S if seconds > 30 * SAMPLE_S else seconds / 30)
    rows.append(_rate_row("one watches, one labels, one trains", stay[:1], 0.6 * seconds))
    for name, samples in (("app", server), ("simulation", simulation)):
        rows += growth_rows(name, samples)
    return rows, annotators


def _rate_row(name: str, visitors: list[Visitor], seconds: float) -> Row:
    rates = [visitor.rate(seconds, time.monotonic()) for visitor in visitors]
    return goal_row(
        f"updates/s, the slowest of {name}", min(rates), 20, "1/s", least=True, note=f"most {max(rates):.1f}"
    )


def growth_rows(name: str, samples: Samples) -> list[Row]:
    """Growth of one process over the last two thirds."""
    mb = [usage.resident_mb for usage in samples.usages]
    note = f"from {mb[0]:.0f} to {mb[-1]:.0f} MB, at most {max(mb):.0f}" if mb else "none ran"
    return [
        goal_row(f"memory of the {name}", samples.growth_mb_per_h(), 10, "MB/h", note=note),
        goal_row(f"threads of the {name}", samples.more(lambda usage: usage.threads), 0, "more"),
        goal_row(f"open files of the {name}", samples.more(lambda usage: usage.handles), 0, "more"),
    ]


def label_rows(counts: AnnotatorCounts) -> list[Row]:
    """What the annotators did against what is in the store."""
    return [
        goal_row(f"labels lost of {counts.wanted} by {VISITORS} people at once", counts.lost, 0, ""),
        goal_row("labels at another one's time", counts.wrong, 0, ""),
    ]
