"""How long the app's process takes from a moved slider to the encoded picture, without browser and network."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from app.state.client_state import RenderSettings, TuneView
from app.views.answer_cache import AnswerCache
from app.views.requests import TuneRequest, WatchRequest, answer_request
from benchmarks.app.bare_browser import WINDOW, measuring_browser
from benchmarks.app.bench_soak import run_soak
from benchmarks.app.live_at_rest import measure_rest
from benchmarks.app.live_pace import measure_pace
from benchmarks.app.many_cameras import measure_cameras
from benchmarks.app.page_speed import measure_page
from benchmarks.app.served_app import served
from benchmarks.app.space_time_updates import measure_space
from benchmarks.machine import Row, describe_machine, goal_row, report_rows_to
from core.cameras import stereo_preset
from core.config import replace_setting
from core.detection import DetectorConfig
from core.detection.saved import SavedDetector
from core.errors import CommandError
from core.recordings import Recording, open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


TURNS: Final = 10
GOAL_S: Final = 5.0
GONE_S: Final = 2.0
"""For so long there is no server."""
PATIENCE_S: Final = 120.0
MODE: Final = "Tune"


def measure_return(folder: Path, progress: Callable[[float], None] = lambda share: None, turns: int = TURNS) -> Row:
    """Seconds from the server's first answer until the page shows its mode and its recording again; the worst turn.

    In every second turn another page is in front.

    Raises:
        CommandError: if there is no browser.
    """
    with measuring_browser() as browser:
        return measure_in(browser, folder, progress, turns)


def measure_in(
    browser: Browser, folder: Path, progress: Callable[[float], None] = lambda share: None, turns: int = TURNS
) -> Row:
    """Measure in an open browser."""
    file = folder / "return.h5"
    simulate_recording(file, StereoConfig(sensor=SensorConfig()), stereo_preset(), [LaunchConfig()], seed=1)
    pages = [browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]}) for _ in range(2)]
    taken_s = []
    with served(folder, str(file)) as app:
        port = app.port
        pages[0].goto(f"http://127.0.0.1:{port}/")
        pages[0].wait_for_function("location.href.includes('recording=return')", timeout=1e3 * PATIENCE_S)
        pages[0].get_by_role("button", name=MODE, exact=True).first.click(timeout=1e3 * PATIENCE_S)
        _wait_for_page(pages[0])
        app.process.kill()
    for turn in range(turns):
        pages[turn % 2].bring_to_front()
        pages[0].get_by_text("Server gone, reconnecting").wait_for(timeout=1e3 * PATIENCE_S)
        time.sleep(GONE_S)
        with served(folder, str(file), port=port) as app:
            began_s = time.perf_counter()
            pages[0].locator("#rallyscope-banner").wait_for(state="detached", timeout=1e3 * PATIENCE_S)
            _wait_for_page(pages[0])
            taken_s.append(time.perf_counter() - began_s)
            app.process.kill()
        progress((turn + 1) / turns)
    for page in pages:
        page.close()
    note = f"p50 {np.median(taken_s):.1f} s of {turns} kills; every second time behind another page"
    return goal_row("open page back after the server is", max(taken_s), GOAL_S, "s", note=note)


def _wait_for_page(page: Page) -> None:
    """Until the address says the recording and the mode again, and the mode is marked."""
    page.get_by_role("button", name=f"● {MODE}").wait_for(timeout=1e3 * PATIENCE_S)
    said = f"location.href.includes('recording=return') && location.href.includes('mode={MODE}')"
    page.wait_for_function(said, timeout=1e3 * PATIENCE_S)


PICTURES: Final = 200
NOISES_HZ: Final = (0.1, 1.0)
SEED: Final = 1
PARTS: Final[dict[str, Callable[[Path, Callable[[float], None]], list[Row]]]] = {
    "return": lambda folder, progress: [measure_return(folder, progress)],
    "page": measure_page,
    "pace": measure_pace,
    "cameras": measure_cameras,
    "rest": measure_rest,
    "space": measure_space,
}
"""What is measured in an empty folder."""


def run(
    progress: Callable[[float], None],
    *,
    soak: float | None = None,
    only: str | None = None,
    cameras: int | None = None,
) -> dict[str, object]:
    """The app under load for `soak` minutes, or how long its pictures take.

    With `only` "return" how soon an open page is back after a killed server,
    with "page" how soon a browser shows what is asked for, with "pace" whether the live rally keeps up while one shows
    it; with "cameras", or a number of `cameras`, how often a client that shows so many is updated; with "rest" what the
    live rally costs while nobody watches it; with "space" what the events in space and time cost.

    Rows of the latter per view: p50, p99 and the largest number of milliseconds a picture takes, at random times of a
    recording.

    Each picture has another threshold than the one before, as when a slider is dragged; windows are 2 ms, cameras
    1280x720. Wall time in this process, one picture at a time.

    Raises:
        CommandError: if `only` names another part.
    """
    if only not in (None, *PARTS):
        expected = ", ".join(PARTS)
        raise CommandError("no such part of the app to measure", expected=expected, got=only, where="--only")
    if cameras is not None:
        if only not in (None, "cameras"):
            raise CommandError("only one part has a number of cameras", expected="--only cameras", got=only)
        with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as folder:
            return {"rows": measure_cameras(Path(folder), progress, cameras), "machine": describe_machine("viser")}
    if only is not None:
        with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as folder:
            return {"rows": PARTS[only](Path(folder), progress), "machine": describe_machine("viser")}
    if soak is not None:
        return run_soak(progress, soak)
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as folder:
        for number, noise_hz in enumerate(NOISES_HZ):
            path = Path(folder) / f"{number}.h5"
            config = StereoConfig(sensor=SensorConfig(noise_hz=noise_hz))
            simulate_recording(path, config, stereo_preset(), [LaunchConfig()] * 2, seed=SEED)
            recording = open_recording(path)
            for name, make in _views(recording).items():
                rows.append(_measure(name, noise_hz, make, recording.duration_us))
                report_rows_to(progress, rows[-1:], len(rows) / (len(NOISES_HZ) * 4))
            recording.close()
    return {"rows": rows, "machine": describe_machine(), "pictures": PICTURES, "seed": SEED}


def _views(recording: Recording) -> dict[str, Callable[[int, DetectorConfig], TuneRequest | WatchRequest]]:
    stream, look = recording.cameras["left"], RenderSettings()
    other, kept = DetectorConfig(), AnswerCache()
    return {
        "watch, both cameras": lambda t, config: WatchRequest(recording, t, look, SavedDetector("auto", config), True),
        "tune": lambda t, config: TuneRequest(stream, t, look, TuneView(method="auto"), (("A", config),), kept),
        "tune, zoom 8": lambda t, config: TuneRequest(
            stream, t, look, TuneView(method="auto", zoom=8.0), (("A", config),), kept
        ),
        "tune, A and B": lambda t, config: TuneRequest(
            stream, t, look, TuneView(method="auto"), (("A", config), ("B", other)), kept
        ),
    }


def _measure(
    name: str,
    noise_hz: float,
    make: Callable[[int, DetectorConfig], TuneRequest | WatchRequest],
    duration_us: int,
) -> dict[str, object]:
    rng = np.random.default_rng(SEED)
    seconds = []
    for number in range(-5, PICTURES):  # the first ones load code and are not counted
        config = replace_setting(DetectorConfig(), ("geometry", "circularity_min"), 0.5 + 0.001 * (number % 300))
        request = make(int(rng.integers(50_000, duration_us)), config)
        start_s = time.perf_counter()
        answer_request(request)
        if number >= 0:
            seconds.append(time.perf_counter() - start_s)
    ms = 1e3 * np.array(seconds)
    return {
        "view": name,
        "noise_hz": noise_hz,
        "p50_ms": float(np.median(ms)),
        "p99_ms": float(np.percentile(ms, 99)),
        "max_ms": float(ms.max()),
        "pictures_per_s": float(1e3 / ms.mean()),
    }
