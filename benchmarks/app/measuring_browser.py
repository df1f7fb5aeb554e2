"""The Chromium that benches measure in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING

from benchmarks.app.trial_user import BROWSER_FLAGS, find_chromium
from core.errors import CommandError

if TYPE_CHECKING:
    from playwright.sync_api import Browser


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
