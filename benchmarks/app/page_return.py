"""How soon an open page is back after the server was killed: in a browser, the page in front or behind another one."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.app.measuring_browser import WINDOW, measuring_browser
from benchmarks.app.soak.served_app import served
from benchmarks.machine import Row, goal_row
from core.cameras import stereo_preset
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
    """The same in a browser that is there."""
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
