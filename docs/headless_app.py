"""The app in a headless Chromium, for pictures of it."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from PIL import Image, ImageChops
from playwright.sync_api import Page, sync_playwright

from app.server import App
from app.session import Session
from app.shared.library import Library
from app.shared.live_rally import LiveRally
from app.shared.workspace import Workspace
from core.errors import CommandError
from tests.app.browser.window import FLAGS, make_known
from tests.ensure_chromium import HELP, find_chromium

SIZE_PX: Final = (1280, 720)
PATIENCE_S: Final = 120.0


@contextmanager
def show_app(workspace: Workspace, name: str, live: LiveRally | None = None) -> Iterator[tuple[Page, Session]]:
    """A browser that has opened a recording of the workspace; or a live rally, whose name is LIVE.

    Raises:
        CommandError: if there is no browser, or it does not open it in time.
    """
    program = find_chromium()
    if program is None:
        raise CommandError("no browser to film in", expected=HELP)
    lab = App(workspace, Library(workspace), name, host="127.0.0.1", port=0, live=live)
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
            page = browser.new_page(viewport={"width": SIZE_PX[0], "height": SIZE_PX[1]})
            page.set_default_timeout(1e3 * PATIENCE_S)
            make_known(page, lab)  # nobody is shown round in a picture
            page.goto(f"http://127.0.0.1:{lab.port}/?fixedDpr=1")
            page.add_style_tag(content="[class*=mantine-Notification] { display: none !important; }")
            wait_for(lambda: lab.sessions and lab.sessions[0].recording is not None, "the recording to be open")
            yield page, lab.sessions[0]
            browser.close()
    finally:
        lab.stop()


def wait_for_chain(session: Session) -> None:
    """Return once the chain has seen all of the recording.

    Raises:
        CommandError: if it has not in time.
    """
    assert session.recording is not None
    rally = session.services.rallies.of(session.recording)
    wait_for(lambda: rally is not None and rally.followed == 1.0, "the chain to have seen the recording")


def still_picture(page: Page) -> Image.Image:
    """What the window shows once it stops changing: scene, pictures and figures arrive one after the other."""
    seen = _picture(page)
    for _ in range(20):
        page.wait_for_timeout(250)
        now = _picture(page)
        if ImageChops.difference(seen, now).getbbox() is None:
            break
        seen = now
    return seen


def wait_for(condition: Callable[[], object], what: str) -> None:
    """Return once the condition holds.

    Raises:
        CommandError: if it does not in time.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline_s:
            raise CommandError("the app does not show what is wanted", expected=what, got=f"nothing in {PATIENCE_S} s")
        time.sleep(0.05)


def _picture(page: Page) -> Image.Image:
    return Image.open(io.BytesIO(page.screenshot(timeout=60_000))).convert("RGB")
