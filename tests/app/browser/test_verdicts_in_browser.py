"""What is on the page belongs to what is asked, in a real browser. The screenshots are kept under test-artifacts/."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from app.server import POOL_THREADS
from app.state.commands import SetMethod, SetZoom
from tests.app.browser.window import count_like
from tests.waiting import eventually

YELLOW = (255, 225, 60)
BALL_US = 300_000


@pytest.fixture
def tune(window):
    """A window in Tune at a moment with a ball, with a method that has stages."""
    window.session.send(SetMethod("auto"))
    window.session.send(SetZoom(8.0))
    window.seek(BALL_US)
    window.press("Tune")
    window.page.get_by_text("ball at").first.wait_for()
    return window


@contextmanager
def no_answers(tune) -> Iterator[None]:
    """Inside, everything that makes pictures is busy with something else, as it is while it compiles."""
    go_on = threading.Event()
    for _ in range(POOL_THREADS):
        tune.session.pool.submit(go_on.wait)
    try:
        yield
    finally:
        go_on.set()


def test_an_answer_to_something_else_is_grey_until_the_right_one_is_there(tune) -> None:
    page = tune.page
    badge, verdict = page.locator("#rallyscope-stale"), page.locator(".rallyscope-answer", has_text="ball at").first
    tune.wait_for_pixels("answer", lambda canvas: count_like(canvas, YELLOW) > 40)
    badge.wait_for(state="hidden")

    def opacity() -> float:
        return float(verdict.evaluate("element => getComputedStyle(element).opacity"))

    eventually(lambda: opacity() == 1, "the verdict of what is asked", opacity)
    with no_answers(tune):
        for method in ("refined", "paper"):
            tune.session.send(SetMethod(method))
            badge.get_by_text("Computing").wait_for()
            eventually(lambda: opacity() < 1, "the verdict of another method in grey")
            tune.wait_for_pixels("stale", lambda canvas: count_like(canvas, YELLOW) < 10)
    badge.wait_for(state="hidden")
    page.get_by_text("left, paper, config A").first.wait_for()
    tune.wait_for_pixels("answered", lambda canvas: count_like(canvas, YELLOW) > 40)
    eventually(lambda: opacity() == 1, "the verdict of what was asked last", opacity)


def test_changed_settings_of_all_methods_are_marked_and_tuning_asks_before_it_replaces_them(tune) -> None:
    page = tune.page
    mark = page.get_by_text("changed from default")
    assert mark.count() == 0 or mark.first.is_hidden()
    tune.press("B")
    eventually(lambda: tune.state.tune.slot == "B", "slot B")
    tune.fill(tune.field("radius max [px]"), "17")
    page.get_by_text("1 setting changed from default: B of auto").wait_for()
    tune.session.send(SetMethod("refined"))
    tune.page.get_by_text("moves (").first.wait_for()
    assert page.get_by_text("1 setting changed from default: B of auto").is_visible(), "another method hides nothing"
    tune.press("Show")
    eventually(lambda: (tune.state.tune.method, tune.state.tune.slot) == ("auto", "B"), "the changed config")
    page.get_by_text("Auto-tune", exact=True).first.click()
    tune.press("Tune automatically")
    page.get_by_text("Overwrite config B?").wait_for()
    assert page.get_by_text("config B (localise.radius_max_px 17)").count() == 1
    tune.screenshot("overwrite")
    tune.press("Keep B")
    page.get_by_text("Overwrite config B?").wait_for(state="hidden")
    assert tune.state.configs.present.b.localise.radius_max_px == 17
    tune.press("Reset all")
    mark.first.wait_for(state="hidden")
    assert tune.state.configs.present.b.localise.radius_max_px != 17
    tune.press("A")
