"""Labels in a folder that other machines write: one program writes, others read, a kill loses nothing."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from benchmarks.labels.durability import LAYER, UUID, trial_label
from core.errors import LabelError
from labels.database import file_system, snapshot, write_lease
from labels.database.connection import transaction
from labels.database.write_lease import TIMES, LeaseTimes, WriteLease, lease_path
from labels.store import LabelStore, find_layers
from labels.store_registry import LabelStoreRegistry
from tests.waiting import eventually

PATIENT = LeaseTimes(renew_s=0.03, stale_s=3600.0, settle_s=0.05)


class Clock:
    """Stands still but while somebody sleeps, so that a lease gets stale by no pause of the machine."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(write_lease, "time", clock)
    monkeypatch.setattr(write_lease, "_now_s", lambda: clock.now_s)
    return clock


@pytest.fixture(autouse=True)
def shared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RALLYSCOPE_LABEL_JOURNAL", "rollback")
    monkeypatch.setattr(snapshot, "FROZEN_S", 0.05)
    monkeypatch.setattr(snapshot, "LOOKS_EVERY_S", 0.05)


def open_store(folder: Path, annotator: str = LAYER.annotator, session: str = "") -> LabelStore:
    return LabelStore.open(folder, UUID, LAYER.camera, annotator, session=session)


def foreign_lease(store: Path, **changes: object) -> bytes:
    """The lease of a program on another machine, put beside a store."""
    content = {"host": "anna", "process": 7, "machine": "another", "token": "t", "renewals": 1} | changes
    lease_path(store).parent.mkdir(parents=True, exist_ok=True)
    lease_path(store).write_bytes(json.dumps(content).encode().ljust(512))
    return lease_path(store).read_bytes()


def change_without_lease(store: LabelStore) -> None:
    """A change during which another machine takes the lease over."""
    with store.writing() as db, transaction(db):
        db.execute("INSERT INTO about VALUES ('late', '')")
        foreign_lease(store.path)


def labelling_process(folder: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "benchmarks.labels.durability", str(folder), LAYER.annotator, "1000000"]
    return subprocess.Popen(command, stdout=subprocess.PIPE)


def test_no_log_is_made_and_nothing_is_left_beside_the_store(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(trial_label(0))
        names = {path.name for path in store.path.parent.iterdir()}
        assert names == {"labels.sqlite", "labels.sqlite-journal", "labels.sqlite-writer"}
    assert [path.name for path in store.path.parent.iterdir()] == ["labels.sqlite"]
    with closing(sqlite3.connect(store.path)) as db:
        assert db.execute("PRAGMA journal_mode").fetchone() == ("delete",)


def test_sessions_of_one_program_write_together(tmp_path: Path) -> None:
    with open_store(tmp_path, session="a") as first, open_store(tmp_path, "berta", "b") as second:
        first.put(trial_label(0))
        second.put(trial_label(1))
        assert len(first.labels()) == len(second.labels()) == 1
        first.close()
        second.put(trial_label(2))
        assert len(second.labels()) == 2 and lease_path(second.path).exists()
    assert not lease_path(second.path).exists()


def test_a_second_program_reads_while_the_first_writes_and_a_kill_loses_no_label(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with labelling_process(tmp_path) as writer:
        assert writer.stdout is not None
        lines = [writer.stdout.readline()]
        with pytest.raises(LabelError, match=rf"another program writes.*process {writer.pid} on .*close it") as error:
            open_store(tmp_path)
        assert "\n" not in str(error.value)
        with monkeypatch.context() as here:
            here.delenv("RALLYSCOPE_LABEL_JOURNAL")  # the machine that has the disk
            with pytest.raises(LabelError, match="another program writes"):
                open_store(tmp_path)
        registry = LabelStoreRegistry(tmp_path)
        looked_at = registry.look(LAYER)
        assert looked_at is not None
        seen = len(looked_at.labels())
        eventually(lambda: len(looked_at.labels()) > seen, "labels of the other program")
        with pytest.raises(LabelError, match="reading only"):
            looked_at.put(trial_label(5))
        registry.close()
        writer.send_signal(signal.SIGKILL)
        lines += writer.stdout.readlines()
    acknowledged = max(int(line) for line in lines if line.endswith(b"\n"))
    assert lease_path(LAYER.path(tmp_path)).exists()
    with LabelStore.read(tmp_path, LAYER) as read:
        assert len(read.labels()) > acknowledged
    with open_store(tmp_path) as store:  # at once: the process is known to be gone
        times = store.labels().t_us.tolist()
    assert times == [trial_label(index).t_us for index in range(len(times))] and len(times) > acknowledged


def test_a_change_that_a_kill_has_cut_is_undone_in_the_copy_of_who_reads(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(trial_label(0))
        with store.writing() as db:
            db.execute("PRAGMA cache_size = 1")  # pages of an unfinished change reach the file
            db.execute("BEGIN IMMEDIATE")
            db.executemany("INSERT INTO about VALUES (?, ?)", ((f"n{row}", "x" * 200) for row in range(500)))
            left = tmp_path / "left"
            shutil.copytree(store.path.parent, left / store.path.parent.name)
            db.execute("ROLLBACK")
    journal = LAYER.path(left).with_name("labels.sqlite-journal")
    before = LAYER.path(left).read_bytes(), journal.read_bytes()
    assert before[1] and before[0] != store.path.read_bytes()
    with LabelStore.read(left, LAYER) as read:
        assert len(read.labels()) == 1
    assert (LAYER.path(left).read_bytes(), journal.read_bytes()) == before


def test_a_store_with_a_log_is_taken_over_with_all_that_stands_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RALLYSCOPE_LABEL_JOURNAL")
    with open_store(tmp_path / "disk") as store:
        store.put(trial_label(0))
        store.put(trial_label(1))
        shutil.copytree(store.path.parent, tmp_path / "net" / store.path.parent.name)
    monkeypatch.setenv("RALLYSCOPE_LABEL_JOURNAL", "rollback")
    assert len(find_layers(tmp_path / "net")) == 1
    with pytest.raises(LabelError, match=r"open on the machine that has this disk.*-shm"):
        open_store(tmp_path / "net")
    LAYER.path(tmp_path / "net").with_name("labels.sqlite-shm").unlink()
    with open_store(tmp_path / "net") as store:
        assert len(store.labels()) == 2
        store.put(trial_label(2))
    assert [path.name for path in store.path.parent.iterdir()] == ["labels.sqlite"]


def test_a_lease_that_nobody_renews_is_taken_over(tmp_path: Path, clock: Clock) -> None:
    store = LAYER.path(tmp_path)
    old = foreign_lease(store)
    lease = WriteLease(store)
    lease.take()
    assert clock.now_s >= TIMES.stale_s + TIMES.settle_s
    assert lease.is_held and lease.path.read_bytes() != old and len(lease.path.read_bytes()) == 512
    lease.release()
    assert not lease.path.exists()


def test_a_lease_that_is_renewed_is_not(tmp_path: Path) -> None:
    store = LAYER.path(tmp_path)
    store.parent.mkdir(parents=True)
    holder, other = WriteLease(store, PATIENT), WriteLease(store, PATIENT)
    holder.take()
    with pytest.raises(LabelError, match="another program writes"):
        other.take()
    assert holder.is_held and not other.is_held
    holder.release()
    other.take()
    assert other.is_held and not holder.is_held
    other.release()


def test_a_writer_whose_lease_was_taken_writes_nothing_more(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(trial_label(0))
        with pytest.raises(LabelError, match="was lost meanwhile"):
            change_without_lease(store)
        lease_path(store.path).unlink()
        store.put(trial_label(1))  # the other has ended
        with store.writing() as db:
            assert db.execute("SELECT count(*) FROM about WHERE name = 'late'").fetchone() == (0,)
        assert len(store.labels()) == 2
        foreign_lease(store.path)
    assert lease_path(store.path).exists()  # not ours to remove
    lease_path(store.path).unlink()


def test_a_machine_that_slept_goes_on_if_nobody_came(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = LAYER.path(tmp_path)
    store.parent.mkdir(parents=True)
    lease = WriteLease(store, PATIENT)
    lease.take()
    now_s = write_lease._now_s()
    monkeypatch.setattr(write_lease, "_now_s", lambda: now_s + 1e5)
    assert not lease.is_held
    lease.ensure()
    assert lease.is_held
    lease.release()


@pytest.mark.parametrize("content", [b"", b"nonsense", b"[1]", b'{"process": "x", "machine": 5}'])
def test_a_lease_that_says_nothing_is_waited_for_like_any_other(tmp_path: Path, content: bytes, clock: Clock) -> None:
    store = LAYER.path(tmp_path)
    store.parent.mkdir(parents=True)
    lease_path(store).write_bytes(content)
    lease = WriteLease(store)
    lease.take()
    assert lease.is_held and clock.now_s >= TIMES.stale_s
    lease.release()


def test_a_folder_without_locks_is_refused_and_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(descriptor: int, how: int) -> None:
        raise OSError(37, os.strerror(37))

    if file_system.fcntl is None:
        pytest.skip("no locks of POSIX here")
    monkeypatch.setattr(file_system.fcntl, "lockf", no_locks)
    with pytest.raises(LabelError, match=r"cannot be kept in this folder.*a lock \(fcntl\) fails.*--data"):
        open_store(tmp_path)
    assert not list(LAYER.path(tmp_path).parent.iterdir())


def test_a_journal_that_names_another_file_is_not_played(tmp_path: Path) -> None:
    with open_store(tmp_path) as store:
        store.put(trial_label(0))
    journal = store.path.with_name("labels.sqlite-journal")
    journal.write_bytes(b"x" * 512 + bytes.fromhex("d9d505f920a163d7"))
    with pytest.raises(LabelError, match="not theirs"):
        LabelStore.read(tmp_path, LAYER)
