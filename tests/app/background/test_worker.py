import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from app.background.jobs import LatestWins
from tests.waiting import PATIENCE_S


@pytest.fixture
def pool():
    with ThreadPoolExecutor(2) as pool:
        yield pool


def test_requests_that_wait_give_way_to_the_newest(pool) -> None:
    gate, started, finished = threading.Event(), threading.Event(), threading.Event()
    answers: list[int] = []

    def compute(number: int) -> int:
        started.set()
        assert gate.wait(PATIENCE_S)
        return number * 10

    def done(request: int, answer: int) -> None:
        answers.append(answer)
        if request == 5:
            finished.set()

    worker = LatestWins(pool, compute, done, lambda error: None)
    worker.submit(1)
    assert started.wait(PATIENCE_S)
    for number in (2, 3, 4, 5):
        worker.submit(number)
    gate.set()
    assert finished.wait(PATIENCE_S)
    assert answers == [10, 50]


def test_a_failure_is_reported_and_the_next_request_runs(pool) -> None:
    failed, finished = threading.Event(), threading.Event()
    errors: list[Exception] = []

    def compute(number: int) -> float:
        return 1 / number

    worker = LatestWins(
        pool, compute, lambda request, answer: finished.set(), lambda error: (errors.append(error), failed.set())
    )
    worker.submit(0)
    assert failed.wait(PATIENCE_S)
    worker.submit(2)
    assert finished.wait(PATIENCE_S)
    assert isinstance(errors[0], ZeroDivisionError) and len(errors) == 1


def test_nothing_is_delivered_after_close(pool) -> None:
    gate, started = threading.Event(), threading.Event()
    answers: list[int] = []

    def compute(number: int) -> int:
        started.set()
        assert gate.wait(PATIENCE_S)
        return number

    worker = LatestWins(pool, compute, lambda request, answer: answers.append(answer), lambda error: None)
    worker.submit(1)
    assert started.wait(PATIENCE_S)
    worker.submit(2)
    worker.close()
    gate.set()
    pool.submit(lambda: None).result(PATIENCE_S)
    worker.submit(3)
    while worker.busy:
        pool.submit(lambda: None).result(PATIENCE_S)
    assert answers == []
