"""`serve --plugin`: what a plugin adds is chosen, tuned and seen in a real browser."""

import re
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page

from app.client_session.tour import TOUR
from app.web.gateway import BROWSER_COOKIE

pytestmark = pytest.mark.browser
YELLOW = (255, 225, 60)
BALL_US = 300_000
START_S = 120.0


@pytest.fixture
def address(plugins: Path, serve_recording: Path, tmp_path: Path) -> Iterator[str]:
    """Where the app is, started by its command line with a plugin of each kind that it shows."""
    flags = [word for path in sorted(plugins.glob("*.py")) for word in ("--plugin", str(path))]
    words = [str(serve_recording), *flags, "--port", "0", "--data", str(tmp_path / "data")]
    log = tmp_path / "log"
    with log.open("w") as out:
        server = subprocess.Popen(
            [sys.executable, "-m", "app.cli", "serve", *words], stdout=out, stderr=subprocess.STDOUT
        )
    try:
        deadline = time.monotonic() + START_S
        while not (found := re.search(r"http://\S+", log.read_text())):
            assert server.poll() is None and time.monotonic() < deadline, log.read_text()
            time.sleep(0.2)
        yield found.group()
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(300)
    assert "Traceback" not in log.read_text(), log.read_text()


@pytest.fixture
def page(chromium: Browser, address: str, tmp_path: Path) -> Iterator[Page]:
    """The app in Tune, at a moment with a ball, for a browser that was shown round before."""
    page = chromium.new_page(viewport={"width": 1280, "height": 720})
    page.set_default_timeout(300_000)
    browser = secrets.token_hex(16)
    page.context.add_cookies([{"name": BROWSER_COOKIE, "value": browser, "url": address}])
    (tmp_path / "data" / "browsers").mkdir(parents=True, exist_ok=True)
    (tmp_path / "data" / "browsers" / f"{browser}.seen").write_text(f"\n{TOUR}\n")
    page.goto(f"{address.rstrip('/')}/?fixedDpr=1")
    page.get_by_role("button", name="Tune", exact=True).first.click()
    page.get_by_label("Time [µs]").fill(str(BALL_US))
    page.get_by_label("Time [µs]").press("Enter")
    page.get_by_text("ball at").first.wait_for()
    yield page
    page.close()


def field(page: Page, label: str) -> Locator:
    """The input that stands beside a label and is seen."""
    found = page.locator("label").filter(has_text=re.compile(f"^{re.escape(label)}$"))
    return found.locator("xpath=ancestor::*[.//input][1]").locator("input").last


def choose(page: Page, label: str, option: str) -> None:
    page.get_by_label(label, exact=True).first.click()
    page.get_by_role("option", name=option, exact=True).click()


def test_a_detector_is_chosen_its_slider_moves_and_the_picture_follows(page, save_screenshot, count_like) -> None:
    def yellow(name: str) -> int:
        return count_like(save_screenshot(page, name)[0:495, 0:870], YELLOW, 25)

    def wait_for(name: str, there) -> int:
        deadline = time.monotonic() + 300
        while not there(count := yellow(name)):
            assert time.monotonic() < deadline, f"{count} yellow pixels; see {name}.png"
            page.wait_for_timeout(300)
        return count

    choose(page, "Method", "median")
    page.get_by_text("the middle of the events round their median").first.wait_for()
    assert page.get_by_text("Denoise", exact=True).count() == 0, "the sliders are the plugin's"
    small = wait_for("plugin-chosen", lambda count: count > 40)
    field(page, "radius scale").fill("5")
    wait_for("plugin-slider", lambda count: count > 1.5 * small)
    field(page, "fewest").fill("2000")
    page.get_by_text("no ball").first.wait_for()
    wait_for("plugin-no-ball", lambda count: count < 10)

    page.get_by_text("Compare methods", exact=True).click()
    field(page, "median").check()
    field(page, "Side by side").check()
    page.wait_for_timeout(2000)
    save_screenshot(page, "plugin-compared")

    page.get_by_role("button", name="Export", exact=True).first.click()
    choose(page, "Format", "NumPy arrays (.npz)")
    page.get_by_role("button", name="Train", exact=True).first.click()
    page.get_by_text("A new training", exact=True).click()
    choose(page, "reward", "smooth")
    save_screenshot(page, "plugin-train")
