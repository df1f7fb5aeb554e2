"""A running app and a headless Chromium that looks at it."""

import io
import re
import secrets
import shutil
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from weakref import WeakSet

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, sync_playwright
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from app.client_session.tour import TOUR
from app.modes.watch.commands import ShowSpace
from app.server import App
from app.session import Session
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.state.commands import SetZoom
from app.web.gateway import BROWSER_COOKIE
from tests.ensure_chromium import find_chromium

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # Pictures are drawn by the processor here, and that is half of what these tests take.
    "--webgl-antialiasing-mode=none",
    "--disable-gpu-rasterization",
    "--disable-features=WebUIOmniboxPopup,WebUIOmniboxAimPopup",  # the address bar's pages, loaded with each window
]
ARTIFACTS = Path(__file__).parents[3] / "test-artifacts"
FEW_FRAMES = (
    "window.requestAnimationFrame = act => setTimeout(() => act(performance.now()), 200);"
    "window.cancelAnimationFrame = clearTimeout;"
)
"""As on a slow display: a scene that moves would be drawn as often as the processor can, beside what is tested."""
PLACES = """() => ["#root canvas", "#rallyscope-line", "#rallyscope-bar .row", "#root [role=tab]"].map(one => {
    const { x, y, width, height } = document.querySelector(one)?.getBoundingClientRect() || {};
    return `${one}: ${width} x ${height} at ${x}, ${y}`; })"""
FOCUS = "() => document.activeElement.outerHTML.slice(0, 200)"
SAID = """() => ["Notification-root", "Modal-content"].flatMap(part =>
    [...document.querySelectorAll(`[class*=mantine-${part}]`)].map(one => one.textContent))"""
PATIENCE_S = 150.0
"""How long a test waits before it fails: on a machine that does other things, and draws without a graphics card."""
FIRST_S = 600.0
"""The same for the first picture: the first test of all finds nothing compiled, and others compile beside it."""
CANVAS = (slice(0, 495), slice(0, 870))
"""Rows and columns of a 1280x720 window that the pictures fill."""

WINDOWS: "WeakSet[Window]" = WeakSet()
"""Whose state is printed where a test fails."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.when == "call" and report.failed:
        for number, window in enumerate(WINDOWS):
            report.sections.append((f"window {number}", window.describe()))
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


class Window:
    """One browser window, with the session that the app keeps for it."""

    def __init__(
        self, page: Page, lab: App, *, in_space: bool = False, dpr: float = 1, first_time: bool = False
    ) -> None:
        self.page, self.lab = page, lab
        before = set(lab.sessions)
        page.set_default_timeout(1e3 * PATIENCE_S)
        page.add_init_script(FEW_FRAMES)
        if not first_time:
            make_known(page, lab)
        page.goto(f"http://127.0.0.1:{lab.port}/?fixedDpr={dpr:g}")
        # The software renderer makes viser show a note over the upper left corner: let clicks through.
        page.add_style_tag(content="[class*=mantine-Notification] { pointer-events: none !important; }")
        wait_for(lambda: set(lab.sessions) - before, "the browser to connect", FIRST_S)
        (self.session,) = set(lab.sessions) - before
        wait_for(lambda: self.session.state, "the recording to be open", FIRST_S)
        if not in_space:
            self.session.send(ShowSpace(False))
            self.session.send(SetZoom(1.0))  # Tune opens zoomed on the ball
            wait_for(lambda: self.session.sheet.pictures, "the first picture", FIRST_S)
        self.wait_until_still()
        WINDOWS.add(self)

    def wait_until_still(self) -> None:
        """Return once what can be clicked stays where it is: panels and bars arrive after the first picture."""
        deadline, before = time.monotonic() + PATIENCE_S, None
        while (places := self.page.evaluate(PLACES)) != before:
            assert time.monotonic() < deadline, f"the page does not come to rest: {places}"
            before = places
            self.page.wait_for_timeout(200)

    def wait_until_camera_stands(self) -> None:
        """Return once the camera of the 3D view is where the window's shape wants it."""
        seen: list[tuple[float, ...]] = []

        def still() -> bool:
            camera = self.session.client.camera
            seen.append((*camera.position.tolist(), camera.aspect))
            self.page.wait_for_timeout(300)
            return len(seen) > 6 and len(set(seen[-6:])) == 1

        wait_for(still, "the camera to stand still")

    def describe(self) -> str:
        """How things stand, for whoever reads why a test failed."""
        if self.page.is_closed():
            return "a window that is closed"
        state, there = self.session.state, self.session in self.lab.sessions
        told = f"the session is {'one of' if there else 'none of'} {len(self.lab.sessions)}"
        held = None if state is None else (state.mode, state.recording, state.playhead)
        places, focus, said = (self.page.evaluate(ask) for ask in (PLACES, FOCUS, SAID))
        return f"{told}: {held}; on the page {places}, focus on {focus}, windows and messages {said}"

    @property
    def state(self):
        state = self.session.state
        assert state is not None
        return state

    def press(self, name: str) -> None:
        """Click the button of that name."""
        self.page.get_by_role("button", name=name, exact=True).first.click()

    def click_picture(self, x: int, y: int) -> None:
        """Click into the canvas, arriving there as a hand does: the mouse moves before it presses."""
        self.page.mouse.move(x - 20, y - 10)
        self.page.mouse.move(x, y, steps=4)
        self.page.wait_for_timeout(200)
        self.page.mouse.click(x, y, delay=120)

    def key(self, key: str) -> None:
        """Press a key with the canvas in focus."""
        self.click_picture(300, 440)
        self.page.keyboard.press(key)

    def field(self, label: str) -> Locator:
        """The input that stands beside a label."""
        found = self.page.locator("label").filter(has_text=re.compile(f"^{re.escape(label)}$"))
        return found.locator("xpath=ancestor::*[.//input][1]").locator("input").last

    def choose(self, label: str, option: str) -> None:
        """Choose in the dropdown beside a label: its list is hidden while a panel above moves it out of sight."""
        field = self.field(label).locator("xpath=..").locator("input:visible").first
        choice = self.page.locator("div[role=option]:visible").get_by_text(option, exact=True)
        for _ in range(10):
            field.scroll_into_view_if_needed()
            if not choice.is_visible():
                field.click()
            try:
                choice.click(timeout=15_000)
            except PlaywrightTimeoutError:
                continue
            return
        raise AssertionError(f"{option!r} of {label!r} could not be chosen")

    def fill(self, field: Locator, text: str) -> None:
        """Type into a field as fast as a hand: of what is changed within 50 ms viser sends only the last control's."""
        field.fill(text)
        self.page.wait_for_timeout(120)

    def seek(self, t_us: int) -> None:
        """Go to a time by its field, and have the page know that it is there."""
        field = self.page.get_by_label("Time [µs]")
        field.fill(str(t_us))
        field.press("Enter")
        field.blur()
        wait_for(lambda: self.state.playhead.anchor_us == t_us, f"the cursor to reach {t_us} us")
        told = "t => +document.getElementById('rallyscope-line').getAttribute('aria-valuenow') === t"
        self.page.wait_for_function(told, arg=t_us)

    def stands_in_label(self) -> bool:
        """Whether Label shows the picture of a cursor that stands; the picture may be later than the cursor."""
        head, editor = self.state.playhead, self.session._modes["Label"]._editor
        if head.playing or editor is None:
            return False
        now = editor.labelling
        return now.on_screen and abs(now.t_us - head.anchor_us) <= now.step_us

    def screenshot(self, name: str) -> np.ndarray:
        """(720, 1280, 3) RGB of the window, also kept as a file to look at."""
        hide = "document.querySelectorAll('.mantine-Notification-root').forEach(note => note.style.display = 'none')"
        self.page.evaluate(hide)
        return save_screenshot(self.page, name)

    def wait_for_pixels(
        self, name: str, there: Callable[[np.ndarray], bool], region: tuple[slice, slice] = CANVAS
    ) -> np.ndarray:
        """The first screenshot for whose region `there` holds; meshes and textures are drawn after their message."""
        deadline = time.monotonic() + PATIENCE_S
        while not there(pixels := self.screenshot(name)[region]):
            picture = ARTIFACTS / f"{name}.png"
            assert time.monotonic() < deadline, f"the picture never became what was expected; see {picture}"
            self.page.wait_for_timeout(300)
        return pixels


def make_known(page: Page, lab: App) -> None:
    """As a browser that was here before, and has been shown round."""
    browser, url = secrets.token_hex(16), f"http://127.0.0.1:{lab.port}"
    page.context.add_cookies([{"name": BROWSER_COOKIE, "value": browser, "url": url}])
    lab.services.browsers.note_seen(browser, TOUR)


def save_screenshot(page: Page, name: str) -> np.ndarray:
    """(H, W, 3) RGB of a page, also kept as a file to look at."""
    data = page.screenshot(timeout=60_000)
    ARTIFACTS.mkdir(exist_ok=True)
    (ARTIFACTS / f"{name}.png").write_bytes(data)
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB"))


def wait_for(condition: Callable[[], object], what: str, timeout_s: float = PATIENCE_S) -> None:
    """Return once the condition holds."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.05)


def count_like(canvas: np.ndarray, rgb: tuple[int, int, int], tolerance: int = 60) -> int:
    """Pixels of about this colour."""
    return int(np.count_nonzero(np.abs(canvas.astype(int) - rgb).max(axis=-1) < tolerance))


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
    page = chromium.new_page(viewport={"width": 1280, "height": 720})
    window = Window(page, lab)
    yield window
    session: Session = window.session
    page.close()
    wait_for(lambda: session not in lab.sessions, "the browser to be gone")


@pytest.fixture
def dense_window(chromium: Browser, lab: App, request: pytest.FixtureRequest) -> Iterator[Window]:
    """On a screen with `request.param` device pixels for a CSS pixel."""
    page = chromium.new_page(viewport={"width": 1000, "height": 600}, device_scale_factor=request.param)
    yield Window(page, lab, dpr=request.param)
    page.close()


@pytest.fixture
def other_window(chromium: Browser, lab: App) -> Iterator[Window]:
    page = chromium.new_page(viewport={"width": 1280, "height": 720})
    yield Window(page, lab)
    page.close()


@pytest.fixture(scope="module")
def open_window(chromium: Browser) -> Callable:
    """Opens a browser window on any app, closed at the end of its `with`."""

    @contextmanager
    def open_one(lab: App, *, in_space: bool = False, first_time: bool = False) -> Iterator[Window]:
        page = chromium.new_page(viewport={"width": 1280, "height": 720})
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


@pytest.fixture(name="wait_for")
def _wait_for() -> Callable:
    return wait_for


@pytest.fixture(name="count_like")
def _count_like() -> Callable:
    return count_like


@pytest.fixture(name="save_screenshot")
def _save_screenshot() -> Callable:
    return save_screenshot
