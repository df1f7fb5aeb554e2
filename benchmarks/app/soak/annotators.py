"""Several people who label the same recording at the same time, each other times of it under a name of their own."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from app.modes.label.labelling import DEFAULT_STEP_US
from benchmarks.app.soak.visitor import Visitor
from core.recordings import open_recording
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
        """That have to be labelled."""
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
