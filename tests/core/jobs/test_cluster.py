"""The same on a real Dask cluster: a scheduler and workers on loopback, some of which are killed."""

import os
import signal
import sys
import threading
from pathlib import Path

import pytest

from core.errors import CommandError, ConfigError, JobsError
from core.jobs import JobBackend, TasksStoppedError, open_jobs
from core.jobs.cluster import check_versions, versions_here
from tests.waiting import PATIENCE_S, eventually

pytest.importorskip("distributed")


def begun(folder: Path) -> dict[int, int]:
    """The process that each piece was begun in last."""
    marks = sorted(folder.glob("begun-*"), key=lambda path: path.stat().st_mtime_ns)
    return {int(number): int(process) for _, number, process in (path.name.split("-") for path in marks)}


def test_results_are_those_of_this_machine_to_the_last_bit(cluster) -> None:
    from pieces import digest, threads

    seeds, heard, shares = list(range(9)), [], []
    with open_jobs(JobBackend(jobs=1), 9) as jobs:
        here = jobs.run(digest, seeds)
    with open_jobs(JobBackend(cluster=cluster.address), 9) as jobs:
        there = jobs.run(digest, seeds, done=lambda number, _: heard.append(number), progress=shares.append)
        assert jobs.run(threads, [0, 1]) == [(1, "1")] * 2
    assert here == there and sorted(heard) == seeds
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_an_error_of_a_piece_is_raised_as_it_is(cluster) -> None:
    from pieces import fail

    with (
        pytest.raises(ConfigError, match="no such serve; expected 3 to 9, got 2"),
        open_jobs(JobBackend(cluster=cluster.address), 4) as jobs,
    ):
        jobs.run(fail, [0, 1, 2, 3])


def test_what_is_cancelled_stops_on_the_workers_too(cluster, tmp_path: Path) -> None:
    from pieces import slowly, until_stopped

    pieces = [(str(tmp_path), number) for number in range(6)]
    with pytest.raises(TasksStoppedError), open_jobs(JobBackend(cluster=cluster.address), 6) as jobs:
        jobs.run(until_stopped, pieces, cancelled=lambda: len(begun(tmp_path)) == 2)
    eventually(lambda: len(list(tmp_path.glob("stopped-*"))) == 2, "both pieces to stop")
    shares = []
    with pytest.raises(TasksStoppedError), open_jobs(JobBackend(cluster=cluster.address), 6) as jobs:
        jobs.run(slowly, pieces, progress=shares.append, cancelled=lambda: bool(shares) and shares[-1] > 0)
    assert shares[-1] in (pytest.approx(1 / 12), pytest.approx(2 / 12)), "half of one piece or of two"
    assert len(list(tmp_path.glob("begun-*"))) <= 6, "those that waited were never begun"


@pytest.mark.gate
def test_a_worker_that_is_killed_halfway_takes_nothing_along(own_cluster, tmp_path: Path) -> None:
    from pieces import slowly

    own_cluster.start(2, "--no-nanny")
    pieces = [(str(tmp_path), number) for number in range(6)]

    def kill() -> None:
        eventually(lambda: len(set(begun(tmp_path).values())) == 2, "both workers to begin")
        os.kill(own_cluster.processes[-1].pid, signal.SIGKILL)
        (tmp_path / "go").touch()

    killer = threading.Thread(target=kill)
    killer.start()
    with open_jobs(JobBackend(cluster=own_cluster.address), 6) as jobs:
        assert jobs.run(slowly, pieces) == [0, 1, 2, 3, 4, 5]
    killer.join()
    assert own_cluster.processes[-1].wait(PATIENCE_S) == -signal.SIGKILL
    assert set(begun(tmp_path).values()) >= {own_cluster.processes[1].pid}


def test_a_piece_that_kills_every_worker_is_given_up_and_the_others_are_done(own_cluster) -> None:
    from pieces import die

    own_cluster.start(3, "--no-nanny", DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0")
    heard = []
    with (
        pytest.raises(JobsError, match=r"1 of 5 pieces of work were given up: .* got ball-1;"),
        open_jobs(JobBackend(cluster=own_cluster.address), 5) as jobs,
    ):
        jobs.run(die, [1, 0, 2, 3, 4], name=lambda piece: f"ball-{piece}", done=lambda number, _: heard.append(number))
    assert sorted(heard) == [1, 2, 3, 4]


def test_a_scheduler_that_is_gone_is_one_line(own_cluster, tmp_path: Path) -> None:
    from pieces import slowly

    own_cluster.start(1, "--no-nanny")
    gone = []

    def kill_when_begun() -> bool:
        if begun(tmp_path) and not gone:
            gone.append(own_cluster.processes[0])
            gone[0].kill()
        return False

    with (
        pytest.raises(JobsError, match=r"gone|dropped") as error,
        open_jobs(JobBackend(cluster=own_cluster.address), 1) as jobs,
    ):
        jobs.run(slowly, [(str(tmp_path), 0)], cancelled=kill_when_begun)
    assert "\n" not in str(error.value) and "what is done stays" in str(error.value) and gone


def test_where_no_scheduler_is_one_line_says_so(free_port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.jobs.cluster.CONNECT_S", 0.5)
    with (
        pytest.raises(
            JobsError, match=r"no scheduler of a cluster answers; is `dask scheduler` running there"
        ) as error,
        open_jobs(JobBackend(cluster=f"tcp://127.0.0.1:{free_port}"), 1),
    ):
        pass
    assert "\n" not in str(error.value)


def test_without_certificates_nothing_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        pytest.raises(JobsError, match="certificates are missing; expected a file in DASK_DISTRIBUTED__COMM__TLS"),
        open_jobs(JobBackend(cluster="tls://192.0.2.1:8786"), 1),
    ):
        pass


def test_workers_of_another_version_are_refused_with_what_differs(cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    changed = versions_here() | {"numpy": "1.0", "numba": "0.1"}
    monkeypatch.setattr("core.jobs.cluster.versions_here", lambda: changed)
    expected = (
        r"worker tcp://127.0.0.1:\d+: a worker has other versions than this process; expected numpy 1.0, numba 0.1, "
    )
    with pytest.raises(JobsError, match=expected) as error, open_jobs(JobBackend(cluster=cluster.address), 1):
        pass
    assert "\n" not in str(error.value) and f"got numpy {versions_here()['numpy']}, " in str(error.value)


def test_a_worker_that_comes_later_is_looked_at_too(cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    from pieces import digest

    with open_jobs(JobBackend(cluster=cluster.address), 1) as jobs:
        monkeypatch.setattr("core.jobs.cluster.versions_here", lambda: versions_here() | {"python": "2.7"})
        with pytest.raises(JobsError, match="other versions"):
            jobs.run(digest, [0])


def test_a_worker_of_several_threads_is_refused_with_the_remedy() -> None:
    from core.jobs.cluster import check_worker

    check_worker(versions_here(), versions_here(), 1, "tcp://127.0.0.1:1")
    with pytest.raises(JobsError, match=r"worker tcp.*a worker has several threads; expected 1, got 2; .*--nthreads 1"):
        check_worker(versions_here(), versions_here(), 2, "tcp://127.0.0.1:1")


def test_a_cluster_without_workers_is_one_line(own_cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    from pieces import digest

    own_cluster.start(0)
    monkeypatch.setattr("core.jobs.cluster.NO_WORKER_S", 0.5)
    monkeypatch.setattr("core.jobs.cluster.LOOK_EVERY_S", 0.1)
    with (
        pytest.raises(JobsError, match=r"the cluster has no workers; start some: `dask worker tcp://127.0.0.1:"),
        open_jobs(JobBackend(cluster=own_cluster.address), 1) as jobs,
    ):
        jobs.run(digest, [0])


def test_what_is_shared_is_seen_by_all_workers(cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.h5"
    file.write_bytes(b"abc")
    with open_jobs(JobBackend(cluster=cluster.address), 1) as jobs:
        assert jobs.share_folder(tmp_path) == tmp_path and list(tmp_path.iterdir()) == [file]
        assert jobs.share_file(file) == file
        there = Path.stat
        monkeypatch.setattr(Path, "stat", lambda path, **more: there(Path(__file__)))  # as of another disk
        with pytest.raises(JobsError, match=r"a.h5: a worker does not see this file; got tcp://127.*machines.*share"):
            jobs.share_file(file)


def test_all_differences_are_in_one_line() -> None:
    ours = versions_here()
    check_versions(ours, dict(ours), "worker")
    with pytest.raises(JobsError, match=r"expected python 3.* got python 3.1, numba none; install the same"):
        check_versions(ours, {**ours, "python": "3.1"} | {"numba": "none"}, "worker")


def test_without_dask_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "core.jobs.cluster", raising=False)
    with (
        pytest.raises(CommandError, match=r"a cluster needs dask; pip install 'rallyscope\[cluster\]'"),
        open_jobs(JobBackend(cluster="tcp://127.0.0.1:8786"), 1),
    ):
        pass
