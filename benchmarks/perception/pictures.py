"""What every method says of the same window, a picture of each recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from benchmarks.charts import CirclePanel, circle_panels
from benchmarks.perception.plan import METHODS
from benchmarks.perception.results import PerceptionResult, RecordingReading, ShownAnswer
from benchmarks.perception.summary import SeedRun
from core.events import Events
from core.recordings import PixelTruth, open_recording

HALF_PX: Final = 22.0
"""What is drawn about the ball, to all sides."""
DRAWN_US: Final = 2000
"""The events of so long before the window's end."""


class WindowPicture(NamedTuple):
    """A PNG and its words."""

    png: bytes
    words: str


def draw_windows(run: SeedRun, folder: Path) -> list[WindowPicture]:
    """A picture of each recording in the folder with a ball to see, every method's answer a panel."""
    pictures: list[WindowPicture] = []
    for reading in run.readings:
        results = {one.method: one for one in run.results if one.recording == reading.recording}
        chosen = [results[method] for method in METHODS if method in results]
        if reading.shown_us is not None and chosen:
            pictures.append(draw_window(folder / f"{reading.recording}.h5", reading, chosen))
    return pictures


def draw_window(path: Path, reading: RecordingReading, results: Sequence[PerceptionResult]) -> WindowPicture:
    """The window of the reading, in the first camera's picture."""
    end_us = reading.shown_us
    assert end_us is not None
    with open_recording(path) as recording:
        name, stream = next(iter(recording.cameras.items()))
        events, truth = stream.slice(end_us - DRAWN_US, end_us), stream.truth
    assert truth is not None
    png = circle_panels([_panel(one, events, truth, end_us) for one in results], half_px=HALF_PX)
    seconds = f"{1e-6 * end_us:.3f} s"
    said = "; ".join(f"{one.method}: {_words(one.shown, truth)}" for one in results)
    return WindowPicture(png, f"{reading.recording} ({reading.scene}), camera {name}, {seconds}. {said}.")


def off_px(answer: ShownAnswer, truth: PixelTruth) -> float:
    """Distance from the ball at the time that the answer states; nan if there was none."""
    at = truth.at(answer.t_us)
    return math.hypot(answer.u_px - float(at.u_px[0]), answer.v_px - float(at.v_px[0]))


def _panel(result: PerceptionResult, events: Events, truth: PixelTruth, end_us: int) -> CirclePanel:
    said = result.shown
    at = truth.at(end_us if said is None else said.t_us)
    places = np.column_stack([events.x_px, events.y_px]).astype(np.float64)
    return CirclePanel(
        title=f"{result.method}\n{_words(said, truth)}",
        on_px=places[events.on],
        off_px=places[~events.on],
        truth=(float(at.u_px[0]), float(at.v_px[0]), float(at.r_px[0])),
        answer=None if said is None else (said.u_px, said.v_px, said.r_px),
    )


def _words(said: ShownAnswer | None, truth: PixelTruth) -> str:
    if said is None:
        return "no answer"
    off = off_px(said, truth)
    return "no ball at its time" if math.isnan(off) else f"{off:.2f} px off"
