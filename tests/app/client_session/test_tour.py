"""The tour without a browser: what it says, to whom, and how often."""

from collections.abc import Callable

import pytest

from app.client_session.tour import TOUR, TOURS, Tour
from app.state.client_state import MODES
from app.web.pages import Message


class Page:
    """The page of one browser, and what is kept for it."""

    def __init__(self, *seen: str, is_new: bool = True, has_link: bool = False) -> None:
        self.is_new, self.has_link = is_new, has_link
        self.seen = frozenset(seen)
        self.told: list[Message] = []

    def note_seen(self, what: str) -> None:
        self.seen |= {what}

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None:
        self.hear = listener

    def send(self, kind: str, values: Message) -> None:
        self.told.append(values)

    def answer(self, what: str) -> None:
        self.hear({"type": "tour", "do": what, "number": self.told[-1]["number"]})

    def again(self, **changes) -> "Page":
        """The same browser at its next visit."""
        return Page(*self.seen, **{"is_new": False, **changes})


def test_every_mode_has_three_to_six_short_steps() -> None:
    assert set(TOURS) == set(MODES)
    for steps in TOURS.values():
        assert 3 <= len(steps) <= 6
        for step in steps:
            assert step.at and len(step.title) <= 40 and len(step.text) <= 340 and step.text.endswith(".")


def test_it_opens_by_itself_once_in_each_mode_of_a_new_browser() -> None:
    page = Page()
    tour = Tour(page)
    for mode in MODES:
        tour.tick(mode)
        assert page.told[-1]["mode"] == mode and len(page.told[-1]["steps"]) == len(TOURS[mode])  # type: ignore[arg-type]
        tour.tick(mode)
        page.answer("done")
    told = len(page.told)
    for mode in MODES:
        tour.tick(mode)
    assert len(page.told) == told
    later = page.again()
    Tour(later).tick("Watch")
    assert not later.told


def test_skipped_in_one_mode_it_opens_in_no_other_and_never_again() -> None:
    page = Page()
    tour = Tour(page)
    tour.tick("Watch")
    page.answer("skip")
    tour.tick("Tune")
    assert len(page.told) == 1 and TOUR in page.seen
    later = page.again()
    Tour(later).tick("Label")
    assert not later.told


def test_one_that_was_begun_goes_on_with_the_other_modes_at_the_next_visit() -> None:
    page = Page()
    Tour(page).tick("Watch")
    page.answer("done")
    later = page.again()
    tour = Tour(later)
    tour.tick("Watch")
    assert not later.told
    tour.tick("Tune")
    assert later.told[-1]["mode"] == "Tune"


def test_whoever_goes_on_to_another_mode_leaves_the_tour_of_the_first() -> None:
    page = Page()
    tour = Tour(page)
    tour.tick("Watch")
    tour.tick("Tune")
    assert page.told[-1]["mode"] == "Tune" and "tour of Watch" in page.seen
    page.hear({"type": "tour", "do": "skip", "number": 1})  # of the card that is gone
    assert TOUR not in page.seen


@pytest.mark.parametrize("page", [Page(is_new=False), Page(has_link=True), Page(TOUR, is_new=False)])
def test_others_are_shown_it_only_when_they_ask(page: Page) -> None:
    tour = Tour(page)
    tour.tick("Watch")
    assert not page.told
    page.hear({"type": "tour", "do": "show"})
    assert page.told[-1]["mode"] == "Watch"
    page.answer("done")
    tour.tick("Tune")
    assert len(page.told) == 1


@pytest.mark.parametrize("message", [{}, {"do": 3}, {"do": "skip"}, {"do": "skip", "number": "1"}, {"do": ["skip"]}])
def test_nonsense_from_a_page_changes_nothing(message) -> None:
    page = Page()
    tour = Tour(page)
    tour.tick("Watch")
    page.hear({"type": "tour", **message})
    assert TOUR not in page.seen and len(page.told) == 1
