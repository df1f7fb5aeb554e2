"""Every key of Label where a store holds very many labels: until the edit is on the disk and all is drawn anew.

Without a browser and its connection: the editor with its loop and writer, the words beside the picture, and the strip.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from app.modes.label.editor import EditorAct, LabelCallbacks, LabelEditor
from app.modes.label.keys import ACTS
from app.modes.label.label_picture import StripData, encode_strip
from app.modes.label.labelling import DEFAULT_STEP_US, LabelView, begin_labelling
from app.modes.label.plan import LabelScene, agreement_at, centre_at, plan_at
from app.modes.label.status import checked_of, here_html, progress_html, save_html
from benchmarks.machine import Row, goal_row
from core.cameras import stereo_preset
from core.events import Events
from core.recordings import RecordingWriter, open_recording
from labels.model import Label, LabelState
from labels.store import LabelStore
from labels.store_registry import LabelStoreRegistry

MANY: Final = 200_000
PRESSES: Final = 20
LONGEST_WAIT_S: Final = 60.0
EVENTS_EACH: Final = 20
"""Around every time that is labelled: what a picture costs is measured elsewhere."""
ANNOTATOR: Final = "anna"
SEED: Final = 3


class LoneEditor:
    """An editor of a store of `labels` labels, one each step, whose loop runs while somebody waits for it."""

    def __init__(self, folder: Path, labels: int) -> None:
        file = folder / "long.h5"
        _write_recording(file, labels)
        self.recording = open_recording(file)
        rng = np.random.default_rng(SEED)
        for camera in self.recording.cameras:
            with LabelStore.open(folder / "labels", self.recording.uuid, camera, ANNOTATOR) as store:
                store.edit(put=[_label(step, rng) for step in range(1, labels + 1)])
        self.problems: list[Exception] = []
        self._inbox: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        callbacks = LabelCallbacks(
            lambda act: True, self._inbox.put, self.problems.append, lambda note: None, lambda t_us: None
        )
        view = LabelView(camera="left", annotator=ANNOTATOR)
        labelling = begin_labelling(self.recording, view, DEFAULT_STEP_US, time.monotonic())
        self.editor = LabelEditor(LabelStoreRegistry(folder / "labels"), labelling, callbacks, "bench")
        self.wait(lambda: len(self.editor.labelling.saved) == len(self.recording.cameras))

    def wait(self, condition: Callable[[], object] | None = None) -> None:
        """Run the loop until the condition holds, or until everything is saved."""
        deadline = time.monotonic() + LONGEST_WAIT_S
        while True:
            try:
                self._inbox.get(timeout=0.0005)()
                continue
            except queue.Empty:
                pass
            if (condition or (lambda: not self.editor.writer.waiting))() and self._inbox.empty():
                return
            if time.monotonic() > deadline:
                raise TimeoutError(f"the editor did not answer; {self.problems[-1:]}")

    def press(self, act: EditorAct, t_us: int) -> float:
        """Milliseconds from the key at this time to when all is saved and drawn."""
        self.editor.go_to(t_us)
        self.draw()
        began_s = time.perf_counter()
        self.editor.do(act)
        self.wait()
        self.draw()
        return 1e3 * (time.perf_counter() - began_s)

    def draw(self) -> None:
        """What the app makes anew after an edit, without the picture of the events."""
        now = self.editor.labelling
        scene = LabelScene(now)
        plan = plan_at(scene, now.t_us, centre_at(scene, now.t_us, None))
        self.editor.show(plan)
        arrays, none = now.here.arrays, np.zeros(0, np.int64)
        strip = StripData(0, now.recording.duration_us, arrays.t_us, arrays.state, none, now.breaks_us)
        encode_strip(strip, now.t_us, now.step_us, plan.main.colours)
        save_html(now, self.editor.writer)
        progress_html(checked_of(now))
        here_html(now.here.labels.get(now.t_us), False, agreement_at(now, now.t_us), "", now)

    def close(self) -> None:
        """Let go of everything."""
        self.editor.close()
        self.recording.close()


def many_label_rows(folder: Path, labels: int = MANY, presses: int = PRESSES) -> list[Row]:
    """The median and the slowest press of the slowest key."""
    bench = LoneEditor(folder, labels)
    try:
        rng = np.random.default_rng(SEED)
        keys = {**ACTS, "click": lambda editor: editor.place_ball(100.0, 80.0)}
        for act in keys.values():
            bench.press(act, DEFAULT_STEP_US)  # the first loads and compiles code, and is not counted
        ms: dict[str, list[float]] = {}
        for name, act in keys.items():
            times = DEFAULT_STEP_US * rng.integers(20, labels - 20, presses)
            ms[name] = [bench.press(act, int(t_us)) for t_us in times]
    finally:
        bench.close()
    medians = {name: float(np.median(one)) for name, one in ms.items()}
    slowest = max(medians, key=medians.__getitem__)
    every = np.concatenate(list(ms.values()))
    p50, p95 = np.percentile(every, (50, 95))
    note = f"{slowest}; over all {len(keys)} keys p50 {p50:.0f}, p95 {p95:.0f}, slowest press {every.max():.0f}"
    what = f"the slowest key at {labels} labels a camera, median of {presses}"
    return [goal_row(what, medians[slowest], 50, "ms", note=note)]


def _label(step: int, rng: np.random.Generator) -> Label:
    x_px, y_px = rng.uniform(20, 300, 2).tolist()
    return Label(t_us=step * DEFAULT_STEP_US, state=LabelState.VISIBLE, x_px=x_px, y_px=y_px, r_px=6.0)


def _write_recording(path: Path, steps: int) -> None:
    cameras = stereo_preset()
    rng = np.random.default_rng(SEED)
    duration_us = (steps + 2) * DEFAULT_STEP_US
    with RecordingWriter(path, {n: c.sensor for n, c in cameras.items()}, calibration=cameras, seed=SEED) as writer:
        for name, camera in cameras.items():
            count = steps * EVENTS_EACH
            t_us = np.sort(rng.integers(0, duration_us, count))
            x, y = rng.integers(0, camera.sensor.width_px, count), rng.integers(0, camera.sensor.height_px, count)
            writer.append(name, Events.from_columns(t_us, x, y, rng.random(count) < 0.5, camera.sensor))
