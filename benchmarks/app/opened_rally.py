"""The live rally of a simulation that serves by itself, as measurements open it: alone, or shown by a browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally, SimulationProcess, join_simulation
from app.shared.workspace import Workspace
from benchmarks.app.bare_browser import WINDOW
from core.errors import CommandError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PATIENCE_S: Final = 600.0
"""Given to a first start, which compiles."""
SEED: Final = 3


@contextmanager
def opened_rally(speed_mps: float, *arguments: str) -> Iterator[LiveRally]:
    """The simulation in a process of its own and the app's player, without a browser; closed at the end.

    `arguments` are further ones of `sim-server`.
    """
    live = _join(speed_mps, arguments)
    try:
        yield live
    finally:
        live.close()


@contextmanager
def shown_rally(browser: Browser, folder: Path, speed_mps: float, *arguments: str) -> Iterator[tuple[LiveRally, App]]:
    """The same with the app, whose workspace is `folder`, in a page of the browser; all is closed at the end."""
    workspace = Workspace(folder)
    live = _join(speed_mps, arguments)
    app = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    page = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]})
    try:
        page.goto(f"http://127.0.0.1:{app.port}/", timeout=1e3 * PATIENCE_S)
        yield live, app
    finally:
        page.close()
        app.stop()


def wait_until(condition: Callable[[], bool], problem: str, *, where: str) -> None:
    """Wait for a state of the rally.

    Raises:
        CommandError: with this problem, if it does not come.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline_s:
            raise CommandError(problem, where=where)
        time.sleep(0.2)


def _join(speed_mps: float, arguments: tuple[str, ...]) -> LiveRally:
    process = SimulationProcess("--auto-serve", f"{speed_mps:g}", "--seed", str(SEED), *arguments)
    return join_simulation(process.wait(), process=process)
