"""The card of the lessons: which one is shown, its check, and the progress that is kept for the browser.

Progress is kept per browser, beside the tour's: several people may use one workspace, and each has a first hour.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal, Protocol, get_args

from app.client_session.lesson_checks import CheckResult, LessonFacts
from app.client_session.lessons import LESSONS, Lesson
from app.client_session.tour import TourPage
from app.shared.samples import DEMO
from app.state.client_state import ClientState
from app.state.commands import Command, SetMode
from app.web.pages import Json, Message

CHECK_EVERY_S: Final = 0.3
Ended = Literal["skipped", "done"]
ENDS: Final[tuple[Ended, ...]] = get_args(Ended)
"""In this order: of a skipped lesson that was done later, done counts."""
_BY_NAME: Final = {lesson.name: lesson for lesson in LESSONS}


class LessonHost(Protocol):
    """The session, as the lessons need it."""

    @property
    def state(self) -> ClientState | None: ...
    def send(self, command: Command) -> None: ...
    def await_recording(self, name: str) -> None: ...


class Lessons:
    """The lessons of one browser; used by the session's loop."""

    def __init__(self, page: TourPage, host: LessonHost, facts: Callable[[], LessonFacts]) -> None:
        """`facts` gathers what the modes know; it is called while a lesson is shown whose goal is not reached."""
        self._page = page
        self._host = host
        self._facts = facts
        self._ended = {name: end for end in ENDS for name in _BY_NAME if _hint(name, end) in page.seen}
        self._shown: Lesson | None = None
        self._sent: Message = {}
        self._checked_s = float("-inf")
        page.listen("lesson", self._on_message)

    @property
    def is_shown(self) -> bool:
        """Whether a lesson is shown."""
        return self._shown is not None

    def show(self) -> None:
        """Show the first lesson that is neither done nor skipped; the first of all if there is none."""
        self._show(next((one for one in LESSONS if one.name not in self._ended), LESSONS[0]))

    def tick(self, wall_s: float) -> None:
        """Check the shown lesson now and then."""
        lesson = self._shown
        if lesson is None or wall_s - self._checked_s < CHECK_EVERY_S:
            return
        self._checked_s = wall_s
        outcome = CheckResult(True, "")
        if self._ended.get(lesson.name) != "done":
            facts = self._facts()
            if lesson.on_demo and not facts.on_demo:
                outcome = CheckResult(
                    False, f"the recording {DEMO} is not open; the first start without a file makes it"
                )
            else:
                outcome = lesson.check(facts)
        if outcome.done:
            self._end(lesson, "done")
        message = self._message(lesson, outcome)
        if message != self._sent:
            self._sent = message
            self._page.send("lesson", message)

    def _show(self, lesson: Lesson | None) -> None:
        """Show a lesson, in its mode and on its recording; None closes the card."""
        self._shown, self._sent, self._checked_s = lesson, {}, float("-inf")
        if lesson is None:
            self._page.send("lesson", {"lesson": ""})
            return
        if lesson.on_demo and self._host.state is not None and self._host.state.recording != DEMO:
            self._host.await_recording(DEMO)
        self._host.send(SetMode(lesson.mode))

    def _message(self, lesson: Lesson, outcome: CheckResult) -> Message:
        steps: list[Json] = [[lesson.title, step.text, step.at, step.opens] for step in lesson.steps]
        ends: list[Json] = [[one.name, self._ended.get(one.name, "")] for one in LESSONS]
        return {
            "lesson": lesson.name,
            "mode": f"Lesson {LESSONS.index(lesson) + 1}",
            "steps": steps,
            "why": f"Why: {lesson.why}",
            "goal": f"Done when {lesson.goal}.",
            "so_far": outcome.so_far,
            "done": outcome.done,
            "next": self._next_after(lesson),
            "ends": ends,
        }

    def _next_after(self, lesson: Lesson) -> str:
        """Name of the next lesson that is neither done nor skipped, after the last one again from the first; or ""."""
        at = LESSONS.index(lesson) + 1
        others = (one.name for one in (*LESSONS[at:], *LESSONS[: at - 1]))
        return next((name for name in others if name not in self._ended), "")

    def _end(self, lesson: Lesson, end: Ended) -> None:
        if self._ended.get(lesson.name) != "done":
            self._ended[lesson.name] = end
            self._page.note_seen(_hint(lesson.name, end))

    def _on_message(self, message: Message) -> None:
        """Something was pressed on the card, or the button that opens it."""
        do, lesson = message.get("do"), _BY_NAME.get(str(message.get("lesson")))
        if do == "show":
            self.show()
        elif do == "close":
            self._show(None)
        elif do == "skip" and lesson is not None:
            self._end(lesson, "skipped")
            self._show(_BY_NAME.get(self._next_after(lesson)))
        elif do == "to" and lesson is not None:
            self._show(lesson)


def _hint(name: str, end: Ended) -> str:
    """Name of the stored hint."""
    return f"lesson {name} {end}"
