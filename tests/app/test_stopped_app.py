"""The app's process is stopped for a while (SIGSTOP), as by a laptop that sleeps: afterwards all goes on as it was."""

import os
import shutil
import signal
import time
from pathlib import Path

from benchmarks.app.bare_browser import BareBrowser
from benchmarks.app.served_app import served

STOPPED_S = float(os.environ.get("RALLYSCOPE_STOPPED_S", "4"))
PATIENCE_S = 120.0


def enter_label(browser: BareBrowser) -> None:
    """A key that comes before the recording is open is for nothing."""
    until = time.monotonic() + PATIENCE_S
    while not browser.pictures:
        assert time.monotonic() < until
        browser.trigger("Mode: Label", PATIENCE_S)
        time.sleep(0.5)


def test_browsers_of_an_app_that_was_stopped_go_on_and_what_they_pressed_meanwhile_counts(
    tmp_path: Path, serve_recording: Path
) -> None:
    file = tmp_path / "serve.h5"
    shutil.copy(serve_recording, file)
    with served(tmp_path, str(file)) as app:
        browser = BareBrowser(app.port)
        try:
            enter_label(browser)
            browser.wait_quiet(PATIENCE_S)
            os.kill(app.process.pid, signal.SIGSTOP)
            seen = browser.pictures
            browser.trigger("Label: Ten on")
            time.sleep(STOPPED_S)
            assert browser.pictures == seen, "a process that stands shows nothing"
            os.kill(app.process.pid, signal.SIGCONT)
            browser.wait_picture(PATIENCE_S, after=seen)
            browser.wait_quiet(PATIENCE_S)
            seen = browser.pictures
            browser.trigger("Label: Ten on")
            browser.wait_picture(PATIENCE_S, after=seen)
            other = BareBrowser(app.port)
            enter_label(other)
            other.close()
        finally:
            os.kill(app.process.pid, signal.SIGCONT)
            browser.close()
        app.process.terminate()
        assert app.process.wait(PATIENCE_S) == 0
