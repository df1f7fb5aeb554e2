"""The lessons in a real browser: two of them, done by hand, from the tour of a first visit."""

import shutil
from pathlib import Path

from app.client_session.lessons import LESSONS
from app.shared.samples import DEMO
from app.state.client_state import ClientState
from tests.waiting import eventually

SCORE = "Score this config on the whole recording"


def test_from_the_tour_a_visitor_finds_and_tunes_and_it_is_kept(
    lab, open_window, workspace, serve_recording: Path
) -> None:
    shutil.copy(serve_recording, workspace.recording_path(DEMO))
    with open_window(lab, first_time=True) as window:
        page, card = window.page, window.page.locator("#rallyscope-tour")
        goal, following = card.locator(".goal"), card.locator("[data-do=next]")

        def state() -> ClientState:
            return window.state

        def score() -> None:
            page.get_by_role("button", name=SCORE).click()

        card.get_by_text("Watch, 1 of").wait_for()
        while following.inner_text() == "Next":
            following.click()
        page.get_by_role("button", name="Lessons").first.click()
        card.get_by_text("Lesson 1, 1 of 3").wait_for()
        eventually(lambda: (state().recording, state().mode) == (DEMO, "Tune"), "Tune on the demo recording")
        goal.get_by_text("So far: this is the first camera").wait_for()
        following.click()
        window.choose("Camera", "right")
        goal.get_by_text("the cursor is at no bounce").wait_for()
        following.click()
        page.keyboard.press("]")
        goal.get_by_text("✓").wait_for()
        window.screenshot("lesson-find")

        following.click()
        card.get_by_text("Lesson 2, 1 of 4").wait_for()
        goal.get_by_text("no score yet").wait_for()
        window.choose("Method", "auto")
        following.click()
        window.fill(window.field("circularity min"), "0.9")
        following.click()
        score()  # its tab was opened by the card
        goal.get_by_text("So far: recall 0").wait_for()
        assert not following.is_hidden()
        following.click()
        assert following.is_hidden(), "on from here goes who has done it, or skips it"
        window.press("Undo")
        goal.get_by_text("these settings have no score").wait_for()
        score()
        goal.get_by_text("✓").wait_for()
        window.screenshot("lesson-tune")
        eventually(lambda: {"lesson find done", "lesson tune done"} <= window.session.page.seen, "it to be kept")
        assert "tour of Tune" not in window.session.page.seen, "the tour of Tune came in between"
        card.get_by_label("Close the lessons").click()
        card.wait_for(state="hidden")

        page.reload()
        page.get_by_role("button", name="Lessons").first.click()
        card.get_by_text("Lesson 3, 1 of 2").wait_for()
        assert card.locator("[data-end=done]").all_inner_texts() == ["✓ find", "✓ tune"]
        card.get_by_role("button", name="Skip lesson").click()
        card.get_by_text("Lesson 4, 1 of 3").wait_for()


CARD = "#rallyscope-tour"
COVERED = """() => {
  const box = (one) => document.querySelector(`#rallyscope-tour${one}`).getBoundingClientRect();
  const card = box("");
  if (box(" .goal").bottom > box(" .row").top) return ["its own words"];
  return [...document.querySelectorAll("[data-rallyscope-lower], #rallyscope-bar")].filter((one) => {
    const box = one.getBoundingClientRect();
    const apart = box.right <= card.left || card.right <= box.left || box.bottom <= card.top || card.bottom <= box.top;
    return box.height && !apart;
  }).map((one) => one.id || "the lower panel");
}"""


def test_the_card_of_a_lesson_covers_neither_the_lower_panel_nor_the_time_bar(
    lab, open_window, workspace, serve_recording: Path
) -> None:
    shutil.copy(serve_recording, workspace.recording_path(DEMO))
    with open_window(lab) as window:
        page, card = window.page, window.page.locator(CARD)
        page.get_by_role("button", name="Lessons").first.click()
        for number, lesson in enumerate(LESSONS):
            card.locator(f"nav [data-to={lesson.name}]").click()
            eventually(lambda lesson=lesson: window.state.mode == lesson.mode, lesson.mode)
            for step in range(len(lesson.steps)):
                card.get_by_text(f"Lesson {number + 1}, {step + 1} of {len(lesson.steps)}").wait_for()
                window.wait_until_still()
                eventually(lambda: not page.evaluate(COVERED), f"{lesson.name}, {step + 1}: nothing to be covered")
                window.screenshot(f"lesson-{lesson.name}-{step + 1}")
                if step + 1 < len(lesson.steps):
                    card.locator("[data-do=next]").click()
