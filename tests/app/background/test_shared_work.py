"""What several browsers ask for is computed once; a failure reaches all who waited, and is tried again."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from app.background.jobs import SharedWork
from tests.waiting import PATIENCE_S


def test_many_who_ask_at_once_get_the_answer_of_one() -> None:
    asked, together, go_on = [], threading.Barrier(9), threading.Event()

    def compute(number: int) -> list[int]:
        asked.append(number)
        go_on.wait(PATIENCE_S)
        return [number]

    work = SharedWork(compute, lambda number: number)

    def ask(number: int) -> list[int]:
        together.wait(PATIENCE_S)
        return work(number)

    with ThreadPoolExecutor(8) as pool:
        answers = [pool.submit(ask, number // 4) for number in range(8)]
        together.wait(PATIENCE_S)
        go_on.set()
        found = [answer.result(PATIENCE_S) for answer in answers]
    assert sorted(asked) == [0, 1] and [one for (one,) in found] == [0, 0, 0, 0, 1, 1, 1, 1]
    assert all(found[k] is found[0] for k in range(4))


def test_only_the_latest_answers_are_kept() -> None:
    asked: list[int] = []
    work = SharedWork(lambda number: asked.append(number), lambda number: number, kept=2)
    for number in (1, 2, 1, 3, 1):
        work(number)
    assert asked == [1, 2, 3, 1]


def test_a_failure_is_told_and_not_kept() -> None:
    tries: list[int] = []

    def compute(number: int) -> int:
        tries.append(number)
        if len(tries) == 1:
            raise ValueError("the first time")
        return number

    work = SharedWork(compute, lambda number: number)
    with pytest.raises(ValueError, match="the first time"):
        work(5)
    assert work(5) == 5 and work(5) == 5 and tries == [5, 5]
