import queue
import threading
from collections.abc import Callable
from contextlib import ExitStack

import pytest

from app.background.jobs import Job, LoopJob
from tests.waiting import PATIENCE_S


def test_a_job_reports_progress_and_delivers_its_result() -> None:
    results: list[int] = []

    def work(progress, cancelled) -> int:
        progress(0.5)
        assert not cancelled()
        return 7

    job = Job(work, results.append, lambda error: None)
    assert job.wait(PATIENCE_S)
    assert results == [7] and job.share == 0.5 and not job.running


def test_a_cancelled_job_delivers_nothing() -> None:
    results: list[object] = []
    running = threading.Event()

    def work(progress, cancelled) -> int:
        running.set()
        while not cancelled():
            pass
        return 7

    job = Job(work, results.append, results.append)
    assert running.wait(PATIENCE_S)
    job.cancel()
    assert job.wait(PATIENCE_S) and results == []


def test_a_failing_job_delivers_its_error() -> None:
    errors: list[Exception] = []
    job = Job(lambda progress, cancelled: 1 // 0, lambda result: None, errors.append)
    assert job.wait(PATIENCE_S) and isinstance(errors[0], ZeroDivisionError)


class Loop:
    """What a loop job has done by the loop; it is done when the test says so."""

    def __init__(self) -> None:
        self.said: list[object] = []
        self._inbox: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.job = LoopJob[int](self._inbox.put, self.said.append, lambda: self.said.append("ended"))

    def turn(self) -> None:
        """Wait for what comes next, and do it."""
        self._inbox.get(timeout=PATIENCE_S)()


def test_a_loop_handles_the_result_of_its_job_after_the_end_of_it() -> None:
    loop = Loop()
    loop.job.start(lambda progress, cancelled: 7, loop.said.append)
    assert loop.job.running and loop.job.share == 0.0
    loop.turn()
    assert loop.said == ["ended", 7] and not loop.job.running and loop.job.share is None


def test_a_loop_is_given_the_error_of_its_job() -> None:
    loop = Loop()
    loop.job.start(lambda progress, cancelled: 1 // 0, loop.said.append)
    loop.turn()
    assert loop.said[0] == "ended" and isinstance(loop.said[1], ZeroDivisionError) and not loop.job.running


def test_what_is_cancelled_after_its_last_step_is_not_handled_and_another_can_begin() -> None:
    loop, over = Loop(), threading.Event()

    def work(progress, cancelled) -> int:
        over.wait(PATIENCE_S)
        return 7

    loop.job.start(work, loop.said.append)
    over.set()
    handle = loop._inbox.get(timeout=PATIENCE_S)  # the result is on its way to the loop
    loop.job.cancel()
    handle()
    assert loop.said == ["ended"] and not loop.job.running
    loop.job.start(lambda progress, cancelled: 8, loop.said.append)
    loop.turn()
    assert loop.said == ["ended", "ended", 8]


def test_a_browser_that_is_gone_hears_of_no_end() -> None:
    loop = Loop()
    loop.job.start(lambda progress, cancelled: 7, loop.said.append)
    loop.job.close()
    assert loop.said == [] and not loop.job.running


@pytest.mark.parametrize("fails", [False, True])
def test_what_a_job_holds_is_free_before_anybody_hears_of_its_end(fails: bool) -> None:
    order, held = [], ExitStack()
    held.callback(order.append, "free")

    def work(progress, cancelled) -> None:
        order.append("work")
        assert not fails

    job = Job(work, lambda _: order.append("end"), lambda _: order.append("end"), held)
    assert job.wait(PATIENCE_S)
    assert order == ["work", "free", "end"]
