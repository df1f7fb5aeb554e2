"""While a rally runs, frames of a page that the processor draws keep apart, until a hand asks for more."""

from collections.abc import Iterator
from importlib import resources

import pytest
from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.browser
FEW_A_SECOND = 1000 / 180
BEFORE = "const rallyscope = { sent: [], onFound() {}, send(type, values) { this.sent.push([type, values]); } };"
TURN = "turns = 0; (function turn() { turns++; requestAnimationFrame(turn); })()"
HAND = "setInterval(() => dispatchEvent(new PointerEvent('pointermove')), 50)"


@pytest.fixture
def page(chromium: Browser) -> Iterator[Page]:
    page = chromium.new_page()
    script = (resources.files("app.web") / "page" / "drawing.js").read_text("utf-8")
    page.set_content("<p>nothing that takes time to draw</p>")
    page.add_script_tag(content=f"{BEFORE}\n{script}")
    yield page
    page.close()


def turns(page: Page, seconds: float = 2.0) -> float:
    """Frames a second."""
    page.evaluate("turns = 0; since = performance.now()")
    page.wait_for_timeout(1000 * seconds)
    return page.evaluate("1000 * turns / (performance.now() - since)")


def test_frames_keep_apart_in_a_rally_and_come_at_once_to_a_hand(page: Page) -> None:
    page.evaluate(TURN)
    assert turns(page, 1.0) > 2 * FEW_A_SECOND, "without a rally there are as many as ever"
    page.evaluate("rallyscope.rallyRuns = true")
    page.wait_for_timeout(500)
    assert 1 < turns(page) <= FEW_A_SECOND + 0.5
    page.evaluate(HAND)
    page.wait_for_timeout(500)
    assert turns(page) > 2 * FEW_A_SECOND


def test_the_server_is_told_who_draws_and_what_is_cancelled_or_fails_does_not_stop_the_others(page: Page) -> None:
    page.evaluate("rallyscope.onFound()")
    assert page.evaluate("rallyscope.sent") == [["drawing", {"software": True}]]
    page.evaluate(
        """() => {
            window.done = [];
            window.onerror = () => { done.push("reported"); return true; };
            const never = requestAnimationFrame(() => done.push("never"));
            requestAnimationFrame(() => { throw new Error("one fails"); });
            requestAnimationFrame(() => { cancelAnimationFrame(last); done.push("there"); });
            const last = requestAnimationFrame(() => done.push("last"));
            cancelAnimationFrame(never);
        }"""
    )
    page.wait_for_function("done.length >= 2")
    page.wait_for_timeout(300)
    assert page.evaluate("done") == ["reported", "there"]
