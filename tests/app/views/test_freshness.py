"""Which picture is marked as outdated, and from when on."""

import numba
import numba.extending

from app.views.freshness import GRACE_S, MOVING_GRACE_S, AnswerFreshness

LATE_S = 2 * GRACE_S


def question() -> object:
    """A request of its own."""
    return object()


def test_an_answer_to_an_earlier_question_is_outdated_from_the_next_question_on() -> None:
    freshness, first, second, third = AnswerFreshness(), question(), question(), question()
    freshness.ask(first, 0.0)
    freshness.answered(first)
    assert freshness.staleness(100.0, moving=False) == "" and not freshness.is_waiting
    freshness.ask(second, 100.0)
    assert freshness.is_waiting
    assert freshness.staleness(100.0 + GRACE_S / 2, moving=False) == ""
    assert freshness.staleness(100.0 + LATE_S, moving=False) == "computing"
    freshness.ask(third, 110.0)
    freshness.answered(second)
    assert freshness.staleness(110.0, moving=False) == "", "it was the answer until just now"
    assert freshness.staleness(110.0 + LATE_S, moving=False) == "computing"
    freshness.answered(third)
    assert freshness.staleness(200.0, moving=False) == "" and not freshness.is_waiting


def test_an_answer_that_was_overtaken_long_ago_is_marked_as_soon_as_it_comes() -> None:
    freshness, questions = AnswerFreshness(), [question() for _ in range(4)]
    for number, one in enumerate(questions):
        freshness.ask(one, float(number))
    freshness.answered(questions[0])
    assert freshness.staleness(3.0, moving=False) == "computing"


def test_a_cursor_that_plays_leaves_the_pictures_more_time() -> None:
    freshness, first, second = AnswerFreshness(), question(), question()
    freshness.ask(first, 0.0)
    freshness.answered(first)
    freshness.ask(second, 1.0)
    assert freshness.staleness(1.0 + LATE_S, moving=True) == ""
    assert freshness.staleness(1.0 + 2 * MOVING_GRACE_S, moving=True) == "computing"


def test_a_failed_question_stays_marked_without_a_wait_and_the_next_one_is_computed() -> None:
    freshness, first, second = AnswerFreshness(), question(), question()
    freshness.ask(first, 0.0)
    freshness.failed()
    assert freshness.staleness(0.0, moving=False) == "failed" and not freshness.is_waiting
    freshness.ask(second, 1.0)
    assert freshness.staleness(1.0 + LATE_S, moving=False) == "computing"


def test_an_answer_from_before_another_mode_was_chosen_does_not_count_as_the_new_one() -> None:
    freshness, before, now = AnswerFreshness(), question(), question()
    freshness.ask(before, 0.0)
    freshness.forget()
    freshness.ask(now, 1.0)
    freshness.answered(before)
    assert freshness.staleness(1.0 + LATE_S, moving=False) == "computing"


def test_it_says_compiling_while_a_kernel_is_compiled_and_computing_before_and_after() -> None:
    freshness = AnswerFreshness()
    freshness.ask(question(), 0.0)
    seen: list[str] = []

    @numba.extending.overload(_look)
    def _(x):  # numba calls this while it compiles what calls `_look`
        seen.append(freshness.staleness(1.0, moving=False))
        return lambda x: 2 * x

    kernel = numba.njit(lambda x: _look(x))
    assert freshness.staleness(1.0, moving=False) == "computing"
    assert kernel(3) == 6
    assert set(seen) == {"compiling"}
    assert freshness.staleness(1.0, moving=False) == "computing"


def _look(x: int) -> int:
    """Stands for a call inside a kernel."""
    return 2 * x
