import threading

from app.background.jobs import Job


def test_a_job_reports_progress_and_delivers_its_result() -> None:
    results: list[int] = []

    def work(progress, cancelled) -> int:
        progress(0.5)
        assert not cancelled()
        return 7

    job = Job(work, results.append, lambda error: None)
    assert job.wait(5)
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
    assert running.wait(5)
    job.cancel()
    assert job.wait(5) and results == []


def test_a_failing_job_delivers_its_error() -> None:
    errors: list[Exception] = []
    job = Job(lambda progress, cancelled: 1 // 0, lambda result: None, errors.append)
    assert job.wait(5) and isinstance(errors[0], ZeroDivisionError)
