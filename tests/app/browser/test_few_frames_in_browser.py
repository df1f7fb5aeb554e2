"""While a rally runs, frames of a page that the processor draws keep apart, until a hand asks for more.

The page's clock is ours, so that how many frames there are in a second is a law, whatever the machine does.
"""

from collections.abc import Iterator
from importlib import resources

import pytest
from playwright.sync_api import Browser, Page

from tests.app.browser.window import open_page

FEW_MS, FRAME_MS = 180, 16
"""Between two frames, at least, in a rally; between any two by the page's clock."""
SECOND_MS = 1000
BEFORE = """const rallyscope = {
    handlers: {}, sent: [], onFound() {}, send(type, values) { this.sent.push([type, values]); },
};"""
TURN = "turns = 0; (function turn() { turns++; requestAnimationFrame(turn); })()"
HAND = "setInterval(() => dispatchEvent(new PointerEvent('pointermove')), 50)"


@pytest.fixture
def page(chromium: Browser) -> Iterator[Page]:
    page = open_page(chromium)
    page.clock.install(time=0)
    page.clock.pause_at(SECOND_MS)
    script = (resources.files("app.web") / "page" / "drawing.js").read_text("utf-8")
    page.set_content("<p>nothing that takes time to draw</p>")
    page.add_script_tag(content=f"{BEFORE}\n{script}")
    yield page
    page.close()


def turns(page: Page) -> int:
    """Frames in the next second of the page's clock."""
    page.evaluate("turns = 0")
    page.clock.run_for(SECOND_MS)
    return page.evaluate("turns")


@pytest.mark.gate
def test_frames_keep_apart_in_a_rally_and_come_at_once_to_a_hand(page: Page) -> None:
    page.evaluate(TURN)
    assert turns(page) >= SECOND_MS // FRAME_MS - 1, "without a rally there are as many as ever"
    page.evaluate("rallyscope.rallyRuns = true")
    page.clock.run_for(SECOND_MS)
    assert SECOND_MS // (FEW_MS + FRAME_MS) <= turns(page) <= SECOND_MS // FEW_MS + 1
    page.evaluate("rallyscope.handlers.apart({ seconds: 0.4 })")
    page.clock.run_for(SECOND_MS)
    assert 2 <= turns(page) <= 3, "a rally that runs at half its pace has half of them"
    page.evaluate(HAND)
    page.clock.run_for(SECOND_MS)
    assert turns(page) >= SECOND_MS // 50, "one at least for each move of the hand"


@pytest.mark.gate
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
    page.clock.run_for(SECOND_MS)
    assert page.evaluate("done") == ["reported", "there"]
