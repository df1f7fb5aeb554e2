"""How soon the page shows what it is asked for: first picture, a slider, a drag along the time line, a live rally.

Measured in the page: from the event of the hand until the picture is with the graphics driver and everything of its
frame is drawn, whoever draws. A client that draws nothing says what the server alone could do.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from app.shared.workspace import Workspace
from benchmarks.app.bare_browser import WINDOW, Visitor, measuring_browser
from benchmarks.app.served_app import served
from benchmarks.machine import Row, goal_row
from core.cameras import stereo_preset
from core.events import Events
from core.recordings import RecordingWriter
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

STARTS: Final = 5
SLIDES: Final = 100
NOT_COUNTED: Final = 5
"""The first ones, which load code."""
BUSY_US: Final = 10_000_000
SCRUBBED_EVENTS: Final = 100_000_000
SCRUB_S: Final = 10.0
MOVE_S: Final = 1 / 40
"""Between two places of a drag."""
LIVE_S: Final = 20.0
SETTLE_S: Final = 5.0
PATIENCE_MS: Final = 300_000.0
SLIDER: Final = "window [µs]"
STEP: Final = "One step forward (also the right arrow)"
WATCH_PICTURES: Final = """
window.drawnPictures = [];
addEventListener("keydown", () => {
  window.drawnBefore = window.drawnPictures.length;
  window.pressed = performance.now();
}, true);
for (const name of ["texImage2D", "texSubImage2D"]) {
  const plain = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    plain.apply(this, given);
    const source = given[given.length - 1];
    if (!(source instanceof HTMLImageElement || source instanceof ImageBitmap) || source.width < 300) return;
    queueMicrotask(() => {  // everything of this frame has been asked for
      this.readPixels(0, 0, 1, 1, this.RGBA, this.UNSIGNED_BYTE, new Uint8Array(4));
      window.drawnPictures.push(performance.now());
    });
  };
}
"""
"""Notes when a key is pressed and when a large picture is drawn: what is read back from the canvas waits for it."""
SLID: Final = "window.drawnPictures.length > window.drawnBefore"
"""The first picture after a press is there."""


def measure_page(folder: Path, progress: Callable[[float], None], events: int = SCRUBBED_EVENTS) -> list[Row]:
    """The figures against their goals.

    Raises:
        CommandError: if there is no browser, or the app does not come up.
    """
    with measuring_browser() as browser:
        return measure_in(browser, folder, progress, events)


def measure_in(
    browser: Browser,
    folder: Path,
    progress: Callable[[float], None] = lambda share: None,
    events: int = SCRUBBED_EVENTS,
    *,
    starts: int = STARTS,
    slides: int = SLIDES,
    seconds: float = SCRUB_S,
    live_s: float = LIVE_S,
) -> list[Row]:
    """Measure in an open browser."""
    file, busy = folder / "ball.h5", Workspace(folder).recording_path("busy")
    simulate_recording(file, StereoConfig(sensor=SensorConfig()), stereo_preset(), [LaunchConfig()], seed=1)
    write_busy_recording(busy, events)
    progress(0.3)
    rows = [_first_pictures(browser, folder, starts, *given) for given in ((), (str(file),))]
    progress(0.6)
    rows += [_slider(browser, folder, file, slides), _slider_bare(folder, file, slides)]
    rows += [_scrub(browser, folder, busy, seconds, events), _scrub_bare(folder, busy, seconds, events)]
    progress(0.9)
    rows.append(_live(folder, live_s))
    progress(1.0)
    return rows


def _first_pictures(browser: Browser, folder: Path, count: int, *given: str) -> Row:
    taken_s = []
    for number in range(count + 1):
        began_s = time.perf_counter()
        with served(folder, *given) as app:
            page = _open(browser, app.port)
            page.wait_for_function("window.drawnPictures.length", timeout=PATIENCE_MS, polling=10)
            if number:  # the first one is not warm
                taken_s.append(time.perf_counter() - began_s)
            page.close()
    what = "a recording" if given else "the live rally"
    note = f"from the start of its process; slowest {max(taken_s):.1f} s of {count}"
    return goal_row(f"first picture of {what}, p50", float(np.median(taken_s)), 3, "s", note=note)


def _slider(browser: Browser, folder: Path, file: Path, count: int) -> Row:
    with served(folder, str(file)) as app:
        page = _open(browser, app.port)
        _enter(page, "Tune")
        thumb = page.get_by_role("slider", name=SLIDER)
        thumb.focus(timeout=PATIENCE_MS)
        time.sleep(SETTLE_S)
        ms = []
        for number in range(NOT_COUNTED + count):
            page.keyboard.press("ArrowLeft" if number % 2 else "ArrowRight")
            page.wait_for_function(SLID, timeout=PATIENCE_MS)
            ms.append(page.evaluate("window.drawnPictures[window.drawnBefore] - window.pressed"))
        page.close()
    return _slider_row("slider to picture, in the browser, p95", ms[NOT_COUNTED:])


def _slider_bare(folder: Path, file: Path, count: int) -> Row:
    with served(folder, str(file)) as app:
        visitor = Visitor(app.port)
        try:
            _tune(visitor)
            ms = []
            for number in range(NOT_COUNTED + count):
                seen, began_s = visitor.pictures, time.perf_counter()
                visitor.change(SLIDER, 2000 + 50 * (number % 2 + 1))
                visitor.wait_picture(PATIENCE_MS / 1e3, after=seen)
                ms.append(1e3 * (time.perf_counter() - began_s))
                time.sleep(MOVE_S)
        finally:
            visitor.close()
    return _slider_row("the same until it has been sent to a client that draws nothing, p95", ms[NOT_COUNTED:])


def _slider_row(what: str, ms: list[float]) -> Row:
    note = f"p50 {np.median(ms):.0f}, slowest {max(ms):.0f} ms of {len(ms)}"
    return goal_row(what, float(np.percentile(ms, 95)), 50, "ms", note=note)


def _scrub(browser: Browser, folder: Path, file: Path, seconds: float, events: int) -> Row:
    with served(folder, str(file)) as app:
        page = _open(browser, app.port)
        _enter(page, "Tune")
        line = page.locator("#rallyscope-line")
        line.wait_for(timeout=PATIENCE_MS)
        time.sleep(SETTLE_S)
        box = line.bounding_box()
        assert box is not None
        y, before = box["y"] + box["height"] / 2, page.evaluate("window.drawnPictures.length")
        page.mouse.move(box["x"] + 5, y)
        page.mouse.down()
        began_s = time.perf_counter()
        while (share := (time.perf_counter() - began_s) / seconds) < 1:
            page.mouse.move(box["x"] + 5 + share * (box["width"] - 10), y)
            time.sleep(MOVE_S)
        drawn = page.evaluate("window.drawnPictures.length") - before
        page.mouse.up()
        page.close()
    name = f"drag through {events / 1e6:.0f} million events, pictures drawn"
    return goal_row(name, drawn / seconds, 25, "1/s", least=True, note="in Tune, 40 places a second")


def _scrub_bare(folder: Path, file: Path, seconds: float, events: int) -> Row:
    with served(folder, str(file)) as app:
        visitor = Visitor(app.port)
        try:
            _tune(visitor)
            before, began_s = visitor.pictures, time.perf_counter()
            while time.perf_counter() - began_s < seconds:
                visitor.trigger(STEP)
                time.sleep(MOVE_S)
            sent = visitor.pictures - before
        finally:
            visitor.close()
    return goal_row(
        "steps through them, pictures sent to a client that draws nothing", sent / seconds, 25, "1/s", least=True
    )


def _live(folder: Path, seconds: float) -> Row:
    with served(folder) as app:
        visitor = Visitor(app.port)
        try:
            visitor.wait_rally(PATIENCE_MS / 1e3)
            time.sleep(SETTLE_S + seconds)
            rate = visitor.rate(seconds, time.monotonic())
        finally:
            visitor.close()
    return goal_row("live rally, updates to a client that keeps up", rate, 60, "1/s", least=True)


def _tune(visitor: Visitor) -> None:
    """Into Tune as soon as the recording is open: before that a mode cannot be chosen."""

    def has_a_picture() -> bool:
        visitor.trigger("Mode: Tune", PATIENCE_MS / 1e3)
        time.sleep(1.0)
        return visitor.pictures > 0

    visitor.wait_until(has_a_picture, "Tune", PATIENCE_MS / 1e3)
    visitor.wait_quiet()


def _open(browser: Browser, port: int) -> Page:
    page = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]})
    page.add_init_script(WATCH_PICTURES)
    page.goto(f"http://127.0.0.1:{port}/", timeout=PATIENCE_MS)
    return page


def _enter(page: Page, mode: str) -> None:
    """Wait for a recording, past the tour of a first visit."""
    page.wait_for_function("location.href.includes('recording=')", timeout=PATIENCE_MS)
    page.keyboard.press("Escape")
    page.get_by_role("button", name=mode).first.click(timeout=PATIENCE_MS)
    page.get_by_role("button", name=f"● {mode}").wait_for(timeout=PATIENCE_MS)


def write_busy_recording(path: Path, events: int, *, seed: int = 1) -> None:
    """Two calibrated cameras full of noise: what a picture costs does not depend on what the events mean."""
    cameras = stereo_preset()
    rng = np.random.default_rng(seed)
    per_chunk, chunk_us = events // 200, BUSY_US // 100
    with RecordingWriter(path, {n: c.sensor for n, c in cameras.items()}, calibration=cameras, seed=seed) as writer:
        for number in range(100):
            for name, camera in cameras.items():
                t_us = np.sort(rng.integers(0, chunk_us, per_chunk)) + number * chunk_us
                x = rng.integers(0, camera.sensor.width_px, per_chunk)
                y = rng.integers(0, camera.sensor.height_px, per_chunk)
                on = rng.random(per_chunk) < 0.5
                writer.append(name, Events.from_columns(t_us, x, y, on, camera.sensor))
