"""The lessons without a browser: their texts, the card, and the progress that is kept."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from app.client_session.lesson_card import CHECK_EVERY_S, Lessons
from app.client_session.lesson_checks import LessonFacts
from app.client_session.lessons import LESSONS
from app.client_session.tour import Tour
from app.state.client_state import ClientState, Configs, History, Playhead
from app.state.commands import Command
from app.web.pages import Message
from core.detection import DetectorConfig

NAMES = ["find", "tune", "compare", "label", "train", "export"]


class Session:
    """The session of one browser."""

    def __init__(self, recording: str) -> None:
        configs = History(Configs(DetectorConfig(), DetectorConfig()))
        self.state = ClientState(recording, ("left", "right"), "left", Playhead(1_000_000), configs)
        self.awaited: list[str] = []

    def send(self, command: Command) -> None:
        self.state = command.apply(self.state, 0.0)

    def await_recording(self, name: str) -> None:
        self.awaited.append(name)


class Browser:
    """The page of one browser, what is kept for it, and its lessons."""

    is_new, has_link = True, False

    def __init__(self, *seen: str, recording: str = "demo", **facts: object) -> None:
        self.seen = frozenset(seen)
        self.sent: list[Message] = []
        self.session = Session(recording)
        self.facts = LessonFacts(**facts)  # type: ignore[arg-type]
        self.asked = 0
        self.wall_s = 0.0
        self.lessons = Lessons(self, self.session, self.gather)

    def gather(self) -> LessonFacts:
        self.asked += 1
        return replace(self.facts, on_demo=self.session.state.recording == "demo")

    def note_seen(self, what: str) -> None:
        self.seen |= {what}

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None:
        self.hear = listener

    def send(self, kind: str, values: Message) -> None:
        self.sent.append(values)

    def press(self, do: str, lesson: str = "") -> Message:
        """Press something on the card; returns what the page is sent."""
        self.hear({"type": "lesson", "do": do, "lesson": lesson})
        return self.tick()

    def tick(self) -> Message:
        self.wall_s += CHECK_EVERY_S + 0.01
        self.lessons.tick(self.wall_s)
        return self.sent[-1]


def test_there_are_six_lessons_of_a_few_short_steps() -> None:
    assert [lesson.name for lesson in LESSONS] == NAMES
    for lesson in LESSONS:
        assert 2 <= len(lesson.steps) <= 4
        assert len(lesson.why) <= 120 and lesson.why.endswith(".") and len(lesson.goal) <= 120
        assert not lesson.goal.endswith(".")  # it stands in a sentence
        for step in lesson.steps:
            assert step.at and len(step.text) <= 200 and step.text.endswith(".")


def test_the_button_shows_the_first_lesson_that_is_open_in_its_mode_and_on_the_demo() -> None:
    browser = Browser("lesson find done", "lesson tune skipped", recording="mine")
    card = browser.press("show")
    assert card["lesson"] == "compare" and browser.session.state.mode == "Tune" and browser.session.awaited == ["demo"]
    assert card["ends"] == [["find", "done"], ["tune", "skipped"], *([name, ""] for name in NAMES[2:])]
    assert "demo is not open" in str(card["so_far"]) and not card["done"]
    assert Browser(*(f"lesson {name} done" for name in NAMES)).press("show")["lesson"] == "find"


def test_a_goal_that_is_reached_is_kept_even_where_it_is_lost_again() -> None:
    browser = Browser()
    card = browser.press("to", "train")
    assert not card["done"] and browser.session.awaited == []
    browser.facts = LessonFacts(returned=0.95)
    card = browser.tick()
    assert card["done"] and card["next"] == "export" and "lesson train done" in browser.seen
    browser.facts = LessonFacts()
    assert browser.tick()["done"]
    assert Browser(*browser.seen).press("to", "train")["done"]


def test_on_another_recording_a_reached_goal_does_not_count_except_for_train() -> None:
    facts = {"compared": 2, "misses_us": frozenset({5}), "cursor_us": 5, "returned": 1.0}
    browser = Browser(recording="mine", **facts)
    assert not browser.press("to", "compare")["done"]
    assert browser.press("to", "train")["done"]
    assert Browser(**facts).press("to", "compare")["done"]


def test_a_skipped_lesson_is_not_offered_again_but_can_still_be_done() -> None:
    browser = Browser()
    browser.press("show")
    assert browser.press("skip", "find")["lesson"] == "tune"
    again = Browser(*browser.seen, returned=1.0)
    assert again.press("show")["lesson"] == "tune"
    assert again.press("skip", "train")["lesson"] == "export"
    assert again.press("to", "train")["done"]
    assert dict(Browser(*again.seen).press("show")["ends"])["train"] == "done"  # type: ignore[arg-type]


def test_after_the_last_one_is_skipped_the_card_closes() -> None:
    browser = Browser(*(f"lesson {name} done" for name in NAMES[:-1]))
    assert browser.press("show")["lesson"] == "export" and browser.sent[-1]["next"] == ""
    browser.press("skip", "export")
    assert browser.sent[-1] == {"lesson": ""} and not browser.lessons.is_shown


def test_nothing_is_gathered_while_no_lesson_is_shown_or_it_is_done_and_nothing_sent_twice() -> None:
    browser = Browser()
    browser.lessons.tick(1.0)
    browser.press("to", "train")
    asked, sent = browser.asked, len(browser.sent)
    browser.lessons.tick(browser.wall_s + CHECK_EVERY_S / 2)
    assert asked == browser.asked == 1
    browser.tick()
    assert browser.asked == 2 and len(browser.sent) == sent
    browser.facts = LessonFacts(returned=1.0)
    browser.tick()
    browser.tick()
    assert browser.asked == 3
    browser.press("close")
    browser.tick()
    assert browser.asked == 3 and browser.sent[-1] == {"lesson": ""}


@pytest.mark.parametrize("message", [{}, {"do": 3}, {"do": "to"}, {"do": "skip", "lesson": ["x"]}, {"do": ["show"]}])
def test_nonsense_from_a_page_changes_nothing(message) -> None:
    browser = Browser()
    browser.hear({"type": "lesson", **message})
    browser.lessons.tick(1.0)
    assert not browser.lessons.is_shown and not browser.seen and not browser.sent


def test_the_tour_of_a_mode_waits_while_a_lesson_is_shown() -> None:
    browser = Browser()
    tour = Tour(browser)
    tour.tick("Tune", waits=True)
    assert not browser.sent
    tour.tick("Label")
    assert browser.sent[-1]["mode"] == "Label"
