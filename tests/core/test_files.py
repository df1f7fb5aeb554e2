from __future__ import annotations

import errno
import itertools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from core import files
from tests.processes import is_alive
from tests.waiting import PATIENCE_S, eventually

STARTS_A_CHILD = """
import multiprocessing, subprocess, sys, time
from core.files import end_with_parent
def work(queue):
    end_with_parent()
    queue.put(None)
    time.sleep(60)
if __name__ == "__main__":
    if sys.argv[1] == "multiprocessing":
        context = multiprocessing.get_context("spawn")
        queue = context.Queue()
        child = context.Process(target=work, args=(queue,))
        child.start()
        queue.get()
    else:
        code = (
            "import time, core.files; core.files.GIVES_UP_AFTER_S = 0.1; core.files.end_with_parent(); "
            "print(1, flush=True); time.sleep(60)"  # an interrupt does not end a sleep: what is given up on
        )
        child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        child.stdout.readline()
    print(child.pid, flush=True)
    time.sleep(60)
"""
HOLDS = """
import sys
from pathlib import Path
from core.files import hold
with hold(Path(sys.argv[1])):
    print(1, flush=True)
    sys.stdin.read()
"""


def test_a_file_is_replaced_and_its_folder_made(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b"
    files.replace_file(path, b"old", durable=False)
    files.replace_file(path, b"new", durable=True)
    assert path.read_bytes() == b"new" and os.listdir(path.parent) == ["b"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failure_halfway_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def write() -> None:
        with files.replacing(path, durable=True) as partial:
            partial.write_bytes(b"ne")
            raise error

    with pytest.raises(type(error)):
        write()
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == ["a"]


def test_a_folder_that_is_a_file_is_an_error_of_the_system(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"")
    with pytest.raises(OSError, match="a"):
        files.replace_file(tmp_path / "a" / "b", b"new", durable=False)


def test_of_two_writers_at_a_time_the_last_one_wins_whole(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with files.replacing(path, durable=False) as first, files.replacing(path, durable=False) as second:
        assert first != second
        first.write_bytes(b"first")
        second.write_bytes(b"second")
    assert path.read_bytes() == b"first" and os.listdir(tmp_path) == ["a"]


KILLED = """
import os, signal, sys
from pathlib import Path
from core import files
with files.replacing(Path(sys.argv[1]), durable=False) as partial:
    partial.write_bytes(b"half")
    print(partial, flush=True)
    if sys.argv[2] == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    sys.stdin.read()
"""


def test_what_a_killed_writer_left_goes_at_once_and_what_is_being_written_stays(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "a")]
    left = Path(subprocess.run([*command, "killed"], capture_output=True, text=True, check=False).stdout.strip())
    assert left.read_bytes() == b"half"
    with (
        subprocess.Popen([*command, "lives"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other,
        files.replacing(tmp_path / "b", durable=False) as ours,
    ):
        assert other.stdin is not None and other.stdout is not None
        theirs = Path(other.stdout.readline().strip())
        assert not left.parent.exists()
        ours.write_bytes(b"b")
        for path in (theirs, theirs.parent, ours.parent):
            os.utime(path, (1e9, 1e9))  # as if the clock had been put forward by years
        files.clear_unfinished(tmp_path)
        assert theirs.exists() and ours.exists()
        other.stdin.close()
        assert other.wait(PATIENCE_S) == 0
    assert sorted(os.listdir(tmp_path)) == ["a", "b"] and (tmp_path / "a").read_bytes() == b"half"


def test_a_folder_that_another_takes_for_one_that_was_left_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between its making and its locking, before and after it has a lock file."""
    made: list[Path] = []
    opening, locking = os.open, files.lock_descriptor

    def open_late(path, flags: int, mode: int = 0o777, **more) -> int:
        if Path(path).name == ".lock" and len(made) < 1 and flags & os.O_CREAT:
            made.append(Path(path).parent)
            files.clear_unfinished(tmp_path)
        return opening(path, flags, mode, **more)

    def lock_late(descriptor: int, *, shared: bool = False) -> None:
        if len(made) == 1:
            made.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).parent)
            files.clear_unfinished(tmp_path)
        locking(descriptor, shared=shared)

    monkeypatch.setattr(os, "open", open_late)
    monkeypatch.setattr(files, "lock_descriptor", lock_late)
    folder = files.begin_unfinished(tmp_path)
    assert len(made) == 2 and len({folder, *made}) == 3 and not any(path.exists() for path in made)
    files.clear_unfinished(tmp_path)
    assert folder.is_dir()
    files.end_unfinished(folder)
    assert os.listdir(tmp_path) == []


def test_where_nothing_can_be_locked_nothing_is_taken_for_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(descriptor: int, *, shared: bool = False) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(files, "lock_descriptor", refuse)
    folder = files.begin_unfinished(tmp_path)
    files.replace_file(tmp_path / "a", b"new", durable=True)
    assert folder.is_dir() and (tmp_path / "a").read_bytes() == b"new"
    files.end_unfinished(folder)
    assert os.listdir(tmp_path) == ["a"]


def test_a_name_of_the_callers_own_is_written_over(tmp_path: Path) -> None:
    left = tmp_path / ".left"
    left.write_bytes(b"by a kill")
    with files.replacing(tmp_path / "a", durable=False, partial=left) as partial:
        assert partial == left
        partial.write_bytes(b"new")
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize("durable", [False, True])
def test_what_is_durable_reaches_the_disk_before_and_after_it_gets_its_name(
    tmp_path: Path, durable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    fsync, replace = os.fsync, os.replace

    def note_sync(descriptor: int) -> None:
        synced = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
        done.append(f"sync {'folder' if synced == tmp_path / 'folder' else synced.name}")
        fsync(descriptor)

    def note_replace(source: Path, target: Path) -> None:
        done.append("replace")
        replace(source, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "replace", note_replace)
    (tmp_path / "folder").mkdir()
    files.replace_file(tmp_path / "folder" / "a", b"new", durable=durable)
    assert done == (["sync a", "replace", "sync folder"] if durable else ["replace"])


def test_json_that_is_missing_damaged_or_no_object_is_empty(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    assert files.read_json(path) == {}
    files.write_json(path, {"a": [1, None]})
    assert files.read_json(path) == {"a": [1, None]}
    for content in ('{"a": ', "[1]"):
        path.write_text(content)
        assert files.read_json(path) == {}


CLAIMS = """
import sys
from pathlib import Path
from core.files import claimed, numbered
with claimed(Path(sys.argv[1]) / name for name in numbered("a")) as path:
    print(path.name, flush=True)
    sys.stdin.read()
"""


def test_a_name_that_another_program_has_claimed_is_taken_until_it_ends(tmp_path: Path) -> None:
    def names():
        return (tmp_path / name for name in files.numbered("a"))

    with subprocess.Popen(
        [sys.executable, "-c", CLAIMS, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None and other.stdout.readline() == "a\n"
        with files.claimed(names()) as path, files.claimed(names()) as here:
            assert (path.name, here.name) == ("a-2", "a-3")
            files.replace_file(path, b"ours", durable=False)  # this looks for what kills have left
            with files.claimed(names()) as still:
                assert still.name == "a-4"
        other.kill()
        other.wait()
    with files.claimed(names()) as path:
        assert path.name == "a", "what was killed has written nothing"
        path.mkdir()
    with files.claimed(names()) as path:
        assert path.name == "a-3"
    assert sorted(os.listdir(tmp_path)) == ["a", "a-2"]


def test_a_numbered_name_is_no_longer_than_it_may_be() -> None:
    names = list(itertools.islice(files.numbered("a" * 20, 10), 12))
    assert names[:2] == ["a" * 10, "a" * 8 + "-2"] and names[-1] == "a" * 7 + "-12"
    assert list(itertools.islice(files.numbered("a" * 20), 2)) == ["a" * 20, "a" * 20 + "-2"]


def test_a_claim_that_another_takes_for_one_that_was_left_is_no_claim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    locking, claim = files._lock_in, tmp_path / ".unfinished-a.claim"

    def lock_late(folder: Path) -> int | None:
        if folder == claim:
            files.clear_unfinished(tmp_path)
        return locking(folder)

    monkeypatch.setattr(files, "_lock_in", lock_late)
    with files.claimed(tmp_path / name for name in ("a", "b")) as path:
        assert path.name == "b"


def test_a_lock_that_is_held_elsewhere_is_refused_until_its_process_is_killed(tmp_path: Path) -> None:
    lock = tmp_path / "folder" / ".lock"
    assert not files.is_held(lock) and not lock.exists(), "asking makes nothing"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(lock)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None and holder.stdout.readline()
        assert files.is_held(lock)
        with pytest.raises(TimeoutError):
            files.hold(lock)
        holder.kill()
    assert not files.is_held(lock)
    with files.hold(lock):
        assert files.is_held(lock)
        with pytest.raises(TimeoutError):
            files.hold(lock)
    assert not files.is_held(lock) and lock.exists()


def test_who_only_asks_does_not_keep_another_from_the_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lock = tmp_path / ".lock"
    lock.touch()
    with lock.open("rb") as file:
        files.lock_descriptor(file.fileno(), shared=True)
        assert not files.is_held(lock), "two may ask at a time"
        flock = files.fcntl.flock

        def let_go_when_refused(descriptor: int, operation: int) -> None:
            try:
                flock(descriptor, operation)
            except BlockingIOError:
                file.close()
                raise

        monkeypatch.setattr(files.fcntl, "flock", let_go_when_refused)
        monkeypatch.setattr(files, "PROBE_S", PATIENCE_S)
        with files.hold(lock):
            assert file.closed, "the first attempt was refused"


def test_a_file_itself_is_locked_for_one_or_for_those_that_share_it(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.touch()
    with path.open("rb") as first, path.open("rb") as second, path.open("rb") as third:
        files.lock_descriptor(first.fileno(), shared=True)
        files.lock_descriptor(second.fileno(), shared=True)
        with pytest.raises(BlockingIOError):
            files.lock_descriptor(third.fileno())
        first.close()
        second.close()
        files.lock_descriptor(third.fileno())
        with path.open("rb") as fourth, pytest.raises(BlockingIOError):
            files.lock_descriptor(fourth.fileno(), shared=True)


@pytest.mark.parametrize("kind", ["multiprocessing", "subprocess"])
def test_a_child_ends_when_its_parent_is_killed(kind: str, tmp_path: Path) -> None:
    script = tmp_path / "starts_a_child.py"
    script.write_text(STARTS_A_CHILD)
    environment = os.environ | {"PYTHONPATH": os.getcwd()}
    with subprocess.Popen([sys.executable, str(script), kind], stdout=subprocess.PIPE, env=environment) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert is_alive(child)
        parent.kill()
    eventually(lambda: not is_alive(child), "the child to end")


def test_saving_a_config_does_not_load_the_library_of_locks() -> None:
    code = "import sys, core.config; assert 'filelock' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
