"""Label mode as a browser meets it: from a key to the next picture, pictures a second with a key held, a scripted user.

The first two are measured over the real connection by a bare client that draws nothing: from the message of the key to
the arrival of the large picture, loading of the server included, drawing by a browser excluded. The scripted user works
in a real browser and thinks for no time: its rates are bounds of the program, not of people. Every key is pressed in a
store of 200,000 labels, too.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from benchmarks.app.bare_browser import BareBrowser
from benchmarks.app.many_labels import many_label_rows
from benchmarks.app.trial_user import UserResult, find_chromium, label_with_browser
from benchmarks.machine import Row, describe_machine, goal_row
from core.cameras import stereo_preset
from core.events import Events
from core.recordings import RecordingWriter

EVENTS: Final = 20_000_000
DURATION_US: Final = 10_000_000
STEPS: Final = 200
HELD_S: Final = 5.0
REPEAT_S: Final = 1 / 30
"""Of a held key, as keyboards do it."""
CENTRES: Final = 200
SEED: Final = 1
NEXT: Final = "Label: Next time"


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """Rows: what was measured, its goal, and whether it was met."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="rallyscope-label-mode-") as folder:
        workspace = Workspace(Path(folder))
        write_busy_recording(workspace.recording_path("busy"), EVENTS)
        progress(0.2)
        for camera_zoom in ("Whole picture", "Zoom 10x"):
            rows += measure_keys(workspace, camera_zoom, STEPS, HELD_S)
            progress(0.2 + 0.1 * len(rows) / 3)
        (Path(folder) / "many").mkdir()
        rows += many_label_rows(Path(folder) / "many")
        if find_chromium() is None:
            rows.append(goal_row("scripted user", float("nan"), 60, "decisions/min", note="no Chromium here"))
        else:
            rows += user_rows(label_with_browser(Path(folder) / "user", CENTRES, seed=SEED))
        progress(1.0)
    return {"rows": rows, "machine": describe_machine("viser"), "events": EVENTS, "seed": SEED}


def write_busy_recording(path: Path, events: int, *, seed: int = SEED) -> None:
    """Two calibrated cameras full of noise: what a picture costs does not depend on what the events mean."""
    cameras = stereo_preset()
    rng = np.random.default_rng(seed)
    per_chunk, chunk_us = events // 200, DURATION_US // 100
    with RecordingWriter(path, {n: c.sensor for n, c in cameras.items()}, calibration=cameras, seed=seed) as writer:
        for number in range(100):
            for name, camera in cameras.items():
                t_us = np.sort(rng.integers(0, chunk_us, per_chunk)) + number * chunk_us
                x = rng.integers(0, camera.sensor.width_px, per_chunk)
                y = rng.integers(0, camera.sensor.height_px, per_chunk)
                on = rng.random(per_chunk) < 0.5
                writer.append(name, Events.from_columns(t_us, x, y, on, camera.sensor))


def measure_keys(workspace: Workspace, zoom: str, steps: int, held_s: float) -> list[Row]:
    """One press at a time, first where nothing was made ready, then at a person's pace; then a held key."""
    lab = App(workspace, Library(workspace), "busy", host="127.0.0.1", port=0)
    browser = BareBrowser(lab.port)
    try:
        browser.wait_session(lab)
        browser.trigger("Mode: Label")
        browser.wait_picture(60.0)
        browser.trigger(f"Label: {zoom}")
        browser.wait_quiet()
        far = [_press(browser, "Label: Ten on" if k % 2 else NEXT, 0.0) for k in range(steps)]
        browser.wait_quiet()
        calm = [_press(browser, NEXT, 0.2) for _ in range(steps // 4)]
        browser.wait_quiet()
        pictures, seconds = browser.pictures, 0.0
        begun_s = time.perf_counter()
        while seconds < held_s:
            browser.trigger(NEXT)
            time.sleep(REPEAT_S)
            seconds = time.perf_counter() - begun_s
        rate = (browser.pictures - pictures) / seconds
    finally:
        browser.close()
        lab.stop()
    name = zoom.lower()
    return [
        _keys_row(f"as fast as answered, {name}", far),
        _keys_row(f"five a second, {name}", calm),
        goal_row(f"pictures a second with a key held, {name}", rate, 15, "1/s", least=True),
    ]


def user_rows(result: UserResult) -> list[Row]:
    """What the scripted user did."""
    note = f"{result.accepted} accepted, {result.clicked} clicked, SIGKILL after {result.before_kill}"
    return [
        goal_row("scripted user", result.decisions_per_minute, 60, "decisions/min", least=True, note=note),
        goal_row("acknowledged labels lost to the SIGKILL", result.lost, 0, ""),
        goal_row("centres labelled", result.labels, CENTRES, "", least=True),
        goal_row("formats that do not come back whole", result.formats_failed, 0, "", note=result.formats),
        goal_row("error of the labels, median", result.median_error_px, 0.5, "px"),
        goal_row("config scored in Tune against", result.scored_labels, CENTRES, "labels", least=True),
    ]


def _press(browser: BareBrowser, command: str, rest_s: float) -> float:
    """Milliseconds from the key to the large picture."""
    time.sleep(rest_s)
    seen = browser.pictures
    begun_s = time.perf_counter()
    browser.trigger(command)
    browser.wait_picture(10.0, after=seen)
    return 1e3 * (time.perf_counter() - begun_s)


def _keys_row(how: str, ms: list[float]) -> Row:
    p50, p95 = np.percentile(ms, (50, 95))
    return goal_row(f"key to picture p95, {how}", p95, 80, "ms", note=f"p50 {p50:.0f}")
