"""The first start on a machine: nothing compiled, nothing made, a page at once, and then a ball that comes back."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

CLI = [sys.executable, "-m", "app.cli"]
PAGE_WITHIN_S = 60.0
READY_WITHIN_S = 360.0
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

    def end(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(30) == 0, self.said


@pytest.fixture
def cold(tmp_path) -> Iterator[Started]:
    started = Started(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    yield started
    started.process.kill()


@pytest.mark.timeout(720)
def test_the_first_start_shows_a_page_then_a_returned_ball(cold, chromium, tmp_path, save_screenshot) -> None:
    page = chromium.new_page(viewport={"width": 1280, "height": 720})
    page.goto(cold.address(), timeout=90_000)
    page.get_by_text("Compiling the simulation").wait_for(timeout=90_000)
    page.get_by_text(re.compile(r"^\d+%$")).first.wait_for(timeout=90_000)
    save_screenshot(page, "cold-preparing")
    returned = page.get_by_text(re.compile(r"\b[1-9]\d* of \d+ returned"))
    while returned.count() == 0:
        assert time.monotonic() - cold.began_s < READY_WITHIN_S, cold.said
        assert cold.process.poll() is None, cold.said
        page.wait_for_timeout(200)
    first, second = (save_screenshot(page, name) for name in ("cold-returned", "cold-returned-later"))
    assert np.count_nonzero(np.abs(first.astype(int) - second).max(axis=-1) > 40) > 50, "nothing moves"
    page.get_by_text("Getting ready").wait_for(state="hidden", timeout=240_000)  # the demo recording is made, too
    assert (tmp_path / "data" / "recordings" / "demo.h5").exists()
    page.close()
    cold.end()
    for words in ("Compiling the simulation", "Compiling the ball detector", "Making the demo recording"):
        assert re.search(f"{words}.* \\.\\.\\.\n", cold.said), cold.said
        assert re.search(f"{words}.*: done after \\d+ s\n", cold.said), cold.said
    assert "Traceback" not in cold.said
