"""Processes of this machine: the same results, deaths that are survived, and nothing left behind."""

import multiprocessing
import os
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest

from core.errors import ConfigError, JobsError
from core.jobs import HERE, JobBackend, TasksStoppedError, open_jobs
from core.jobs.local_executor import TRIES

TWO = JobBackend(jobs=2)


@pytest.fixture
def left_over() -> Callable[[], set[BaseProcess]]:
    """Processes that live and did not when the test began: this one may have some of other tests."""
    before = set(multiprocessing.active_children())
    return lambda: set(multiprocessing.active_children()) - before


def test_results_are_in_order_and_the_same_to_the_last_bit_here_and_in_processes(left_over) -> None:
    from pieces import digest

    seeds, heard, shares = list(range(7)), [], []
    with open_jobs(JobBackend(jobs=1), 7) as jobs:
        here = jobs.run(digest, seeds)
    with open_jobs(TWO, 7) as jobs:
        there = jobs.run(
            digest, seeds, done=lambda number, result: heard.append((number, result)), progress=shares.append
        )
        assert jobs.run(digest, seeds[:2]) == here[:2], "the processes stay for the next batch"
    assert here == there and len(set(here)) == 7
    assert sorted(heard) == list(enumerate(here))
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert not left_over()


def test_nothing_to_do_is_done() -> None:
    from pieces import digest

    for engine in (HERE, TWO):
        with open_jobs(engine, 0) as jobs:
            assert jobs.run(digest, []) == []


def test_the_piece_of_a_process_that_was_killed_is_done_again(tmp_path: Path, caplog) -> None:
    from pieces import die_once

    with open_jobs(TWO, 4) as jobs:
        assert jobs.run(die_once, [(str(tmp_path), number) for number in range(4)]) == [0, 1, 4, 9]
    assert (tmp_path / "died-1").exists() and f"tried again (2 of {TRIES})" in caplog.text


def test_a_piece_that_kills_every_process_is_given_up_in_one_line_and_the_others_are_done(left_over) -> None:
    from pieces import die

    heard = []
    with pytest.raises(JobsError, match="1 of 4 pieces of work were given up") as error, open_jobs(TWO, 4) as jobs:
        jobs.run(die, [0, 1, 2, 3], name=lambda piece: f"ball-{piece}", done=lambda number, _: heard.append(number))
    assert "\n" not in str(error.value) and "got ball-1;" in str(error.value)
    assert sorted(heard) == [0, 2, 3]
    assert not left_over()


@pytest.mark.parametrize("engine", [JobBackend(jobs=1), TWO], ids=["here", "processes"])
def test_an_error_of_a_piece_is_raised_as_it_is(engine: JobBackend, left_over) -> None:
    from pieces import fail

    with pytest.raises(ConfigError, match="no such serve; expected 3 to 9, got 2"), open_jobs(engine, 4) as jobs:
        jobs.run(fail, [0, 1, 2, 3])
    assert not left_over()


def test_what_is_cancelled_ends_at_once_and_leaves_no_process(tmp_path: Path, left_over) -> None:
    from pieces import slowly

    begun = []
    with pytest.raises(TasksStoppedError), open_jobs(TWO, 4) as jobs:
        jobs.run(
            slowly,
            [(str(tmp_path), number) for number in range(4)],
            progress=lambda share: begun.append(share) if share > 0 else None,
            cancelled=lambda: bool(begun),
        )
    assert begun == [pytest.approx(share, abs=0.13) for share in begun], "a half or two of four pieces"
    assert not left_over()
    marks = {int(path.name.rpartition("-")[2]) for path in tmp_path.glob("begun-*")}
    assert marks and not any(Path(f"/proc/{process}").exists() for process in marks - {os.getpid()})


def test_here_a_piece_is_cancelled_when_it_tells_how_far_it_is(tmp_path: Path) -> None:
    from pieces import slowly

    shares: list[float] = []
    pieces = [(str(tmp_path), 0), (str(tmp_path), 1)]
    with pytest.raises(TasksStoppedError), open_jobs(JobBackend(jobs=1), 2) as jobs:
        jobs.run(slowly, pieces, progress=shares.append, cancelled=lambda: len(shares) == 3)
    assert shares == [0.25] * 3, "half of the first piece"
    assert len(list(tmp_path.glob("begun-*"))) == 1


def test_every_process_computes_with_one_thread() -> None:
    from pieces import threads

    with open_jobs(TWO, 2) as jobs:
        assert jobs.run(threads, [0, 1]) == [(1, "1")] * 2
