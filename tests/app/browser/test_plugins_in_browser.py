"""`serve --plugin`: what a plugin adds is chosen, tuned and seen in a real browser."""

import re
import secrets
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from app.client_session.tour import TOUR
from app.web.gateway import BROWSER_COOKIE
from tests.app.browser.window import (
    NEXT_FRAME,
    choose,
    count_like,
    field_of,
    fill,
    open_page,
    save_screenshot,
    wait_until_sent,
)
from tests.waiting import PATIENCE_S, eventually

YELLOW = (255, 225, 60)
BALL_US = 300_000


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

        def address() -> re.Match[str] | None:
            assert server.poll() is None, log.read_text()
            return re.search(r"http://\S+", log.read_text())

        yield eventually(address, "the address of the page", log.read_text).group()
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(PATIENCE_S)
    assert "Traceback" not in log.read_text(), log.read_text()


@pytest.fixture
def page(chromium: Browser, address: str, tmp_path: Path) -> Iterator[Page]:
    """The app in Tune, at a moment with a ball, for a browser that was shown round before."""
    page = open_page(chromium)
    browser = secrets.token_hex(16)
    page.context.add_cookies([{"name": BROWSER_COOKIE, "value": browser, "url": address}])
    (tmp_path / "data" / "browsers").mkdir(parents=True, exist_ok=True)
    (tmp_path / "data" / "browsers" / f"{browser}.seen").write_text(f"\n{TOUR}\n")
    page.goto(f"{address.rstrip('/')}/?fixedDpr=1")
    page.get_by_role("button", name="Tune", exact=True).first.click()
    page.get_by_label("Time", exact=True).fill(str(BALL_US))
    page.get_by_label("Time", exact=True).press("Enter")
    page.get_by_text("ball at").first.wait_for()
    yield page
    page.close()


def test_a_detector_is_chosen_its_slider_moves_and_the_picture_follows(page) -> None:
    def yellow(name: str) -> int:
        return count_like(save_screenshot(page, name)[0:495, 0:870], YELLOW, 25)

    def yellow_until(name: str, there: Callable[[int], bool]) -> int:
        counts: list[int] = []

        def is_there() -> bool:
            page.evaluate(NEXT_FRAME)
            counts.append(yellow(name))
            return there(counts[-1])

        eventually(is_there, f"the yellow pixels; see {name}.png", lambda: counts[-1:])
        return counts[-1]

    choose(page, "Method", "median")
    method = field_of(page, "Method")
    eventually(lambda: method.input_value() == "median", "the plugin's method")
    method.locator("xpath=..").locator("input:visible").first.hover()
    page.get_by_text("the middle of the events round their median").first.wait_for()  # its hint
    page.mouse.move(300, 300)
    eventually(lambda: page.get_by_text("Denoise", exact=True).count() == 0, "the sliders to be the plugin's")
    small = yellow_until("plugin-chosen", lambda count: count > 40)
    fill(field_of(page, "radius scale"), "5")
    yellow_until("plugin-slider", lambda count: count > 1.5 * small)
    fill(field_of(page, "fewest"), "2000")
    page.get_by_text("no ball").first.wait_for()
    yellow_until("plugin-no-ball", lambda count: count < 10)

    page.get_by_text("Compare methods", exact=True).click()
    for label in ("median", "Side by side"):
        field_of(page, label).check()
        wait_until_sent(page)
    page.get_by_text("median: ").first.wait_for()
    save_screenshot(page, "plugin-compared")

    page.get_by_role("button", name="Export", exact=True).first.click()
    choose(page, "Format", "NumPy arrays (.npz)")
    page.get_by_role("button", name="Train", exact=True).first.click()
    page.get_by_text("A new training", exact=True).click()
    choose(page, "reward", "smooth")
    save_screenshot(page, "plugin-train")
