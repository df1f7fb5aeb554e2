"""The first start on a machine: nothing compiled, nothing made, a page at once, and then a ball that comes back."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page

from tests.app.browser.conftest import FEW_FRAMES

CLI = [sys.executable, "-m", "app.cli"]
PAGE_WITHIN_S = 60.0
READY_WITHIN_S = 900.0
"""On a machine that does other things as well. Nothing in the product gives up after a time."""


class Started:
    """`rallyscope serve` as `make run` starts it, but for the browser that it would open."""

    def __init__(self, folder: Path, *arguments: str, **environment: str) -> None:
        self.began_s = time.monotonic()
        self._log = folder / "log"
        command = [*CLI, "serve", "--port", "0", "--data", str(folder / "data"), *arguments]
        with self._log.open("w") as out:
            self.process = subprocess.Popen(
                command, stdout=out, stderr=subprocess.STDOUT, env={**os.environ, **environment}
            )

    @property
    def said(self) -> str:
        return self._log.read_text()

    def address(self) -> str:
        """Of the page, as soon as it is said."""
        while time.monotonic() - self.began_s < PAGE_WITHIN_S and self.process.poll() is None:
            found = re.search(r"http://\S+", self.said)
            if found:
                return found.group()
            time.sleep(0.1)
        raise AssertionError(self.said)

    def wait(self, page: Page, until: Callable[[], bool]) -> None:
        """For what comes when everything has been compiled."""
        while not until():
            assert time.monotonic() - self.began_s < READY_WITHIN_S, self.said
            assert self.process.poll() is None, self.said
            page.wait_for_timeout(200)

    def end(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(30) == 0, self.said


@pytest.fixture
def cold(tmp_path) -> Iterator[Started]:
    started = Started(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    yield started
    started.process.kill()


@pytest.mark.timeout(1000)
def test_the_first_start_shows_a_page_then_a_returned_ball(cold, chromium, tmp_path, save_screenshot) -> None:
    page = chromium.new_page(viewport={"width": 1280, "height": 720})
    page.add_init_script(FEW_FRAMES)  # drawing has its turn, but compiling is what is waited for
    page.goto(cold.address(), timeout=90_000)
    page.get_by_text("Compiling the simulation").wait_for(timeout=90_000)
    page.get_by_text(re.compile(r"^\d+%$")).first.wait_for(timeout=90_000)
    save_screenshot(page, "cold-preparing")
    returned = page.get_by_text(re.compile(r"^[1-9]\d* of \d+$"))  # counted by controller and scene
    cold.wait(page, lambda: returned.count() > 0)
    first = save_screenshot(page, "cold-returned")
    cold.wait(page, lambda: _differ(first, save_screenshot(page, "cold-returned-later")))
    cold.wait(page, page.get_by_text("Getting ready").is_hidden)  # the demo recording is made, too
    assert (tmp_path / "data" / "recordings" / "demo.h5").exists()
    page.close()
    cold.end()
    for words in ("Compiling the simulation", "Compiling the ball detector", "Making the demo recording"):
        assert re.search(f"{words}.* \\.\\.\\.\n", cold.said), cold.said
        assert re.search(f"{words}.*: done after \\d+ s\n", cold.said), cold.said
    assert "Traceback" not in cold.said


def _differ(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether something has moved from one picture to the other."""
    return np.count_nonzero(np.abs(first.astype(int) - second).max(axis=-1) > 40) > 50
