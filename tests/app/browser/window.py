"""A browser window on a running app: what a hand does in it, and what an eye sees there."""

import io
import re
import secrets
import threading
from collections.abc import Callable
from pathlib import Path
from weakref import WeakSet

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Locator, Page
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from app.client_session.tour import TOUR
from app.modes.watch.commands import ShowSpace
from app.server import App
from app.state.commands import SetZoom
from app.web.gateway import BROWSER_COOKIE
from tests.waiting import PATIENCE_S, eventually

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
"""Of the Chromium that all windows belong to."""
PATIENCE_MS = 1e3 * PATIENCE_S
ARTIFACTS = Path(__file__).parents[3] / "test-artifacts"
FEW_FRAMES = (
    "window.requestAnimationFrame = act => setTimeout(() => act(performance.now()), 200);"
    "window.cancelAnimationFrame = clearTimeout;"
)
"""As on a slow display: a scene that moves would be drawn as often as the processor can, beside what is tested."""
NEXT_FRAME = "() => new Promise(act => requestAnimationFrame(() => setTimeout(act, 0)))"
"""Resolves after a frame: what had arrived before is drawn."""
ALL_SENT = "() => new Promise(act => setTimeout(act, 60))"
"""Resolves after viser's own timer of 50 ms, which began before: on a slow page, too, timers end in order."""
PLACES = """() => ["#root canvas", "#rallyscope-line", "#rallyscope-bar .row", "#root [role=tab]"].map(one => {
    const { x, y, width, height } = document.querySelector(one)?.getBoundingClientRect() || {};
    return `${one}: ${width} x ${height} at ${x}, ${y}`; })"""
FOCUS = "() => document.activeElement.outerHTML.slice(0, 200)"
SAID = """() => ["Notification-root", "Modal-content"].flatMap(part =>
    [...document.querySelectorAll(`[class*=mantine-${part}]`)].map(one => one.textContent))"""
CANVAS = (slice(0, 495), slice(0, 870))
"""Rows and columns of a 1280x720 window that the pictures fill."""
STANDS_FOR = 6
"""So many frames in a row a camera that stands has been at one place."""

WINDOWS: "WeakSet[Window]" = WeakSet()
"""Whose state is printed where a test fails."""


class Window:
    """One browser window, with the session that the app keeps for it."""

    def __init__(
        self, page: Page, lab: App, *, in_space: bool = False, dpr: float = 1, first_time: bool = False
    ) -> None:
        self.page, self.lab = page, lab
        before = set(lab.sessions)
        page.set_default_timeout(PATIENCE_MS)
        page.add_init_script(FEW_FRAMES)
        if not first_time:
            make_known(page, lab)
        page.goto(f"http://127.0.0.1:{lab.port}/?fixedDpr={dpr:g}")
        # The software renderer makes viser show a note over the upper left corner: let clicks through.
        page.add_style_tag(content="[class*=mantine-Notification] { pointer-events: none !important; }")
        (self.session,) = eventually(lambda: set(lab.sessions) - before, "the browser to connect")
        eventually(lambda: self.session.state, "the recording to be open")
        if not in_space:
            self.session.send(ShowSpace(False))
            self.session.send(SetZoom(1.0))  # Tune opens zoomed on the ball
            eventually(lambda: self.session.sheet.pictures, "the first picture")
        self.wait_until_still()
        WINDOWS.add(self)

    def wait_for_frame(self) -> None:
        """Return once the app has had a turn and the page has drawn after it."""
        has_turned = threading.Event()
        self.session.later(has_turned.set)
        eventually(has_turned.is_set, "the app's loop to turn")
        self.page.evaluate(NEXT_FRAME)

    def wait_until_still(self) -> None:
        """Return once what can be clicked stays where it is: panels and bars arrive after the first picture."""
        places: list[object] = []

        def still() -> bool:
            self.wait_for_frame()
            places.append(self.page.evaluate(PLACES))
            return places[-1:] == places[-2:-1]

        eventually(still, "the page to come to rest", lambda: places[-2:])

    def wait_until_camera_stands(self) -> None:
        """Return once the camera of the 3D view is where the window's shape wants it."""
        seen: list[tuple[float, ...]] = []

        def still() -> bool:
            self.wait_for_frame()
            camera = self.session.client.camera
            seen.append((*camera.position.tolist(), camera.aspect))
            return len(seen) > STANDS_FOR and len(set(seen[-STANDS_FOR:])) == 1

        eventually(still, "the camera to stand still", lambda: seen[-STANDS_FOR:])

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
        wait_until_sent(self.page)

    def press_play(self) -> None:
        """Click Play, or Pause, of the time bar: the simulation of a live rally has a Pause of its own."""
        self.page.locator("[data-do=play]").click()
        wait_until_sent(self.page)

    def wait_until_at_rest(self, there: Locator) -> None:
        """Return once two frames have something at one place: notes slide in, forms unfold."""
        boxes: list[object] = []

        def rests() -> bool:
            self.wait_for_frame()
            boxes.append(there.bounding_box())
            return boxes[-1] is not None and boxes[-1:] == boxes[-2:-1]

        eventually(rests, "it to come to rest", lambda: boxes[-2:])

    def enter(self, mode: str) -> None:
        """Choose a mode, and return once the session is in it and the page has come to rest."""
        self.press(mode)
        eventually(lambda: self.state.mode == mode, mode)
        self.wait_until_still()

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
        return field_of(self.page, label)

    def choose(self, label: str, option: str) -> None:
        """Choose in the dropdown beside a label: its list is hidden while a panel above moves it out of sight."""
        field = self.field(label).locator("xpath=..").locator("input:visible").first
        choice = self.page.locator("div[role=option]:visible").get_by_text(option, exact=True)
        for _ in range(10):
            field.scroll_into_view_if_needed()
            if not choice.is_visible():
                field.click()
            try:
                choice.click(timeout=PATIENCE_MS / 10)
            except PlaywrightTimeoutError:
                continue
            wait_until_sent(self.page)
            return
        raise AssertionError(f"{option!r} of {label!r} could not be chosen")

    def fill(self, field: Locator, text: str) -> None:
        """Type into a field, and return once the page has sent it."""
        fill(field, text)

    def seek(self, t_us: int) -> None:
        """Go to a time by its field, and have the page know that it is there."""
        field = self.page.get_by_label("Time", exact=True)
        field.fill(str(t_us))
        field.press("Enter")
        field.blur()
        eventually(
            lambda: self.state.playhead.anchor_us == t_us,
            f"the cursor to reach {t_us} us",
            lambda: (self.state.playhead, field.input_value(), self.page.evaluate("rallyscope.socket.readyState")),
        )
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
        seen: list[np.ndarray] = []

        def is_there() -> bool:
            self.wait_for_frame()
            seen[:] = [self.screenshot(name)[region]]
            return there(seen[0])

        picture = ARTIFACTS / f"{name}.png"
        eventually(is_there, "the picture to become what was expected", lambda: f"see {picture}")
        return seen[0]


def open_page(browser: Browser, width: int = 1280, height: int = 720, **of_screen: float) -> Page:
    """An empty page of its own context that waits as long as every test does."""
    page = browser.new_page(viewport={"width": width, "height": height}, **of_screen)  # type: ignore[arg-type]
    page.set_default_timeout(PATIENCE_MS)
    return page


def make_known(page: Page, lab: App) -> None:
    """As a browser that was here before, and has been shown round."""
    browser, url = secrets.token_hex(16), f"http://127.0.0.1:{lab.port}"
    page.context.add_cookies([{"name": BROWSER_COOKIE, "value": browser, "url": url}])
    lab.services.browsers.note_seen(browser, TOUR)


def field_of(page: Page, label: str) -> Locator:
    """The input that stands beside a label."""
    found = page.locator("label").filter(has_text=re.compile(f"^{re.escape(label)}$"))
    return found.locator("xpath=ancestor::*[.//input][1]").locator("input").last


def fill(field: Locator, text: str) -> None:
    """Type into a field and leave it, and return once the page has sent it."""
    field.fill(text)
    field.blur()
    wait_until_sent(field.page)


def wait_until_sent(page: Page) -> None:
    """Return once the page has sent what was changed: of all that changes within 50 ms viser sends only the last."""
    page.evaluate(ALL_SENT)


def choose(page: Page, label: str, option: str) -> None:
    """Choose in the dropdown of exactly that label, and return once the page has sent it."""
    choose_in(page.get_by_label(label, exact=True).first, option)


def choose_in(box: Locator, option: str, exact: bool = True) -> None:
    """Choose in a dropdown, and return once the page has sent it.

    A panel that is drawn anew closes a list that was just opened; whoever sees that opens it again. A click on an open
    one leaves it open.
    """
    wanted = box.page.get_by_role("option", name=option, exact=exact)

    def list_open() -> bool:
        if not wanted.is_visible():
            box.click()
        return wanted.is_visible()

    eventually(list_open, f"the option {option}")
    wanted.click()
    wait_until_sent(box.page)


def save_screenshot(page: Page, name: str) -> np.ndarray:
    """(H, W, 3) RGB of a page, also kept as a file to look at."""
    data = page.screenshot(timeout=PATIENCE_MS)
    ARTIFACTS.mkdir(exist_ok=True)
    (ARTIFACTS / f"{name}.png").write_bytes(data)
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB"))


def count_like(canvas: np.ndarray, rgb: tuple[int, int, int], tolerance: int = 60) -> int:
    """Pixels of about this colour."""
    return int(np.count_nonzero(np.abs(canvas.astype(int) - rgb).max(axis=-1) < tolerance))
