"""The Chromium that benches measure in."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Final

from core.errors import CommandError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

BROWSER_FLAGS: Final = ("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WINDOW: Final = (1280, 720)


def find_chromium() -> str | None:
    """The browser, if there is one and something to drive it with."""
    try:
        import playwright  # noqa: F401
    except ImportError:
        return None
    return os.environ.get("RALLYSCOPE_CHROMIUM") or shutil.which("chromium")


@contextmanager
def measuring_browser() -> Iterator[Browser]:
    """While it is open.

    Raises:
        CommandError: if there is none.
    """
    program = find_chromium()
    if program is None:
        raise CommandError("no Chromium to measure with", remedy="set RALLYSCOPE_CHROMIUM to one")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(BROWSER_FLAGS))
        with closing(browser):
            yield browser
