"""The app's process is stopped for a while (SIGSTOP), as by a laptop that sleeps: afterwards all goes on as it was."""

import contextlib
import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from benchmarks.app.bare_browser import BareBrowser
from benchmarks.app.served_app import served
from tests.waiting import PATIENCE_S, eventually

STOPPED_S = float(os.environ.get("RALLYSCOPE_STOPPED_S", "0"))
"""How long it stands, for those who want to see a long sleep."""


def enter_label(browser: BareBrowser) -> None:
    """A key that comes before the recording is open is for nothing, so it is pressed again until a picture comes."""

    def press() -> int:
        browser.trigger("Mode: Label", PATIENCE_S)
        browser.wait_quiet(PATIENCE_S)
        return browser.pictures

    eventually(press, "the picture of Label")


def is_standing(pid: int) -> bool:
    """Whether every thread of a process is stopped."""
    states = []
    for stat in Path(f"/proc/{pid}/task").glob("*/stat"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread may end meanwhile
            states.append(stat.read_text().rpartition(")")[2].split()[0])
    return set(states) == {"T"}


@pytest.mark.gate
def test_browsers_of_an_app_that_was_stopped_go_on_and_what_they_pressed_meanwhile_counts(
    tmp_path: Path, serve_recording: Path
) -> None:
    file = tmp_path / "serve.h5"
    shutil.copy(serve_recording, file)
    with served(tmp_path, str(file)) as app:
        browser = BareBrowser(app.port)
        try:
            enter_label(browser)
            os.kill(app.process.pid, signal.SIGSTOP)
            eventually(lambda: is_standing(app.process.pid), "all threads of the app to stand")
            browser.wait_quiet(PATIENCE_S)  # what it had sent before is read
            seen = browser.pictures
            browser.trigger("Label: Ten times forward")
            time.sleep(STOPPED_S)
            browser.wait_quiet(PATIENCE_S)
            assert browser.pictures == seen, "a process that stands shows nothing"
            os.kill(app.process.pid, signal.SIGCONT)
            browser.wait_picture(PATIENCE_S, after=seen)
            browser.wait_quiet(PATIENCE_S)
            seen = browser.pictures
            browser.trigger("Label: Ten times forward")
            browser.wait_picture(PATIENCE_S, after=seen)
            other = BareBrowser(app.port)
            enter_label(other)
            other.close()
        finally:
            os.kill(app.process.pid, signal.SIGCONT)
            browser.close()
        app.process.terminate()
        assert app.process.wait(PATIENCE_S) == 0
