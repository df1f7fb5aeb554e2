"""A running app and a headless Chromium that looks at it."""

import shutil
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, sync_playwright

from app.server import App
from app.session import Session
from app.shared.library import Library
from app.shared.workspace import Workspace
from tests.app.browser.window import FLAGS, WINDOWS, Window, open_page
from tests.ensure_chromium import find_chromium
from tests.waiting import eventually


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.when == "call" and report.failed:
        for number, window in enumerate(WINDOWS):
            try:
                told = window.describe()
            except (Exception, pytest.fail.Exception) as error:  # the page hangs, and so does what asks it, until
                told = f"it does not answer: {error}"  # pytest-timeout ends that: outside of a test that ends all tests
            report.sections.append((f"window {number}", told))
    return report


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    binary = find_chromium()
    if binary is None:
        pytest.skip("no Chromium here; see tests/ensure_chromium.py")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=binary, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module", autouse=True)
def _windows_are_closed(chromium: Browser) -> Iterator[None]:
    """No file leaves a window open: it would be drawn, at half a processor, until the last test of all."""
    yield
    for context in chromium.contexts:
        context.close()


@pytest.fixture(scope="module", autouse=True)
def _notes_stay() -> Iterator[None]:
    """Messages stay longer than a busy machine needs to look at them, yet not for ever: a page shows ten at most."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.session.NOTE_SECONDS", 30.0)
        yield


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory, serve_recording: Path) -> Iterator[App]:
    workspace = Workspace(tmp_path_factory.mktemp("workspace"))
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    workspace.recording_path("broken").write_bytes(b"this is no recording")
    lab = App(workspace, Library(workspace), "serve", host="127.0.0.1", port=0)
    yield lab
    lab.stop()


@pytest.fixture
def workspace(lab: App) -> Workspace:
    return lab.services.workspace


@pytest.fixture
def window(chromium: Browser, lab: App) -> Iterator[Window]:
    page = open_page(chromium)
    window = Window(page, lab)
    yield window
    session: Session = window.session
    page.close()
    eventually(lambda: session not in lab.sessions, "the browser to be gone")


@pytest.fixture
def dense_window(chromium: Browser, lab: App, request: pytest.FixtureRequest) -> Iterator[Window]:
    """On a screen with `request.param` device pixels for a CSS pixel."""
    page = open_page(chromium, 1000, 600, device_scale_factor=request.param)
    yield Window(page, lab, dpr=request.param)
    page.close()


@pytest.fixture
def other_window(chromium: Browser, lab: App) -> Iterator[Window]:
    page = open_page(chromium)
    yield Window(page, lab)
    page.close()


@pytest.fixture(scope="module")
def open_window(chromium: Browser) -> Callable:
    """Opens a browser window on any app, closed at the end of its `with`."""

    @contextmanager
    def open_one(lab: App, *, in_space: bool = False, first_time: bool = False) -> Iterator[Window]:
        page = open_page(chromium)
        window = None
        try:
            yield (window := Window(page, lab, in_space=in_space, first_time=first_time))
        except Exception as error:
            if window is not None:
                error.add_note(window.describe())  # while it is still open
            raise
        finally:
            page.close()

    return open_one
