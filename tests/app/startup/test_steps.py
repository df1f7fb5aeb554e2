"""Steps of a start: what the terminal says, and what the card shows."""

from dataclasses import replace

import pytest

from app.background.child import ChildProcess, share_in
from app.startup.panel import card_html, remaining_text
from app.startup.startup import OWN_STEPS, Preparation, Step


def test_a_step_that_takes_a_while_is_told_at_every_quarter_and_at_its_end() -> None:
    said: list[str] = []
    steps = Preparation({"a": Step("Compiling", "first start only"), "b": Step("Starting")}, said.append)
    steps.begin("a")
    for share in (0.1, 0.2, 0.26, 0.27, 0.1, 0.9):
        steps.advance("a", share)
    assert [step.share for step in steps.steps] == [0.9, 0.0]
    steps.finish("a")
    steps.begin("b")
    steps.finish("b")  # it took no time: nobody needs to hear of it
    assert said == ["Compiling, first start only ...", "Compiling: 26%", "Compiling: 90%", "Compiling: done after 0 s"]
    assert steps.over


def test_a_step_that_fails_says_why_and_is_never_over() -> None:
    said: list[str] = []
    steps = Preparation({"a": Step("Compiling")}, said.append)
    steps.begin("a")
    steps.fail("a", "no <disk>")
    assert said == ["Compiling: failed (no <disk>)"] and not steps.over
    assert "no &lt;disk&gt;" in card_html(steps.steps)


def test_progress_of_a_step_that_has_not_begun_is_ignored() -> None:
    steps = Preparation({"a": Step("Compiling")})
    steps.advance("a", 0.5)
    assert steps.steps[0] == Step("Compiling")


def test_the_card_shows_shares_and_goes_when_all_is_done() -> None:
    done, running, waiting = (
        Step("One", state="done", share=1.0),
        Step("Two", state="running", share=0.26),
        Step("Three"),
    )
    card = card_html((done, running, waiting))
    assert "26%" in card and card.index("One") < card.index("Two") < card.index("Three")
    assert card_html((done, done)) == ""


def test_the_card_says_that_the_rally_comes_only_until_it_is_there() -> None:
    rally, demo = OWN_STEPS["rally"], replace(OWN_STEPS["demo"], state="running", share=0.5, began_s=-1e3)
    assert "will appear here" in card_html((rally, demo))
    ready = card_html((replace(rally, state="done"), demo))
    assert "will appear here" not in ready and "list of recordings" in ready
    assert "seconds" not in ready, "the estimate may be minutes"


def test_shares_are_read_from_lines() -> None:
    assert share_in("31 of about 62 kernels") == 0.5
    assert share_in("70 of about 62 kernels") == 1.0
    assert share_in("37 of 100") == 0.37
    assert share_in("0 of about 0 kernels") is None
    assert share_in("The simulation is at tcp://127.0.0.1:5555") is None


def test_a_child_is_heard_line_by_line_and_its_end_is_told() -> None:
    heard: list[str] = []
    ended: list[bool] = []
    child = ChildProcess("this.is.no.module", on_line=heard.append, on_end=lambda: ended.append(True))
    assert child.wait() == 1
    assert "No module named" in child.last_words and heard[-1] == child.last_words and ended == [True]


def test_the_time_that_is_left_is_estimated_from_the_rate_so_far() -> None:
    step = Step("Compiling", state="running", share=0.25, began_s=100.0)
    assert step.remaining_s(130.0) == pytest.approx(90.0)
    assert replace(step, share=0.01).remaining_s(130.0) is None, "too little is done to say"
    assert step.remaining_s(100.5) is None and replace(step, state="done").remaining_s(130.0) is None
    assert remaining_text(None) == "" and remaining_text(1.0) == "about 5 s left"
    assert remaining_text(42.0) == "about 40 s left" and remaining_text(460.0) == "about 8 minutes left"
