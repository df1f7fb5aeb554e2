"""Files that others may look at, hold or be killed over: replaced in one step, locked, and children that end in time.

After a kill there is the old file or the new one, never half of one. A lock goes with the process that holds it: by it,
and by no clock, what a kill has left is told from what somebody still works on.
"""

from __future__ import annotations

import _thread
import errno
import hashlib
import itertools
import json
import multiprocessing
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Final
from urllib.parse import quote

from core.text import encodable, parse_json

try:
    import fcntl
except ImportError:  # Windows: there filelock locks
    fcntl = None

PROBE_S: Final = 0.2
"""Who wants a lock waits as long: `is_held` has it for a moment, and that is no reason to give up."""
GIVES_UP_AFTER_S: Final = 10.0
"""A child that was told of its parent's end has as long to tidy up."""
PREFIX: Final = ".unfinished-"
"""Prefix of folders for unfinished results: hidden, and beside their final place."""
LONGEST_NAME_BYTES: Final = 255
"""Longest name of a file on the usual file systems, bytes."""
_LOCK: Final = ".lock"
_ATTEMPTS: Final = 100
_held: dict[Path, int] = {}
"""The locks on the folders of this process."""
POSIX: Final = os.name == "posix"
"""Windows opens no folders, neither deletes nor replaces what is open, and lets nobody else read what is locked."""
BINARY: Final = getattr(os, "O_BINARY", 0)
"""Flag for `os.open`: without it Windows changes line ends."""


@contextmanager
def replacing(path: Path, *, durable: bool, partial: Path | None = None) -> Iterator[Path]:
    """A name beside `path` to write to: it becomes `path` at the end of the block, and is gone if the block raises.

    The name is this writer's own, unless it is given: then what a kill has left is found, and written over, next time.
    `durable` waits until a power cut cannot undo it.
    """
    folder: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if partial is None:
            folder = begin_unfinished(path.parent)
            partial = folder / path.name
        yield partial
        put_in_place(partial, path, durable=durable)
    except BaseException:
        with suppress(OSError):  # the folder itself may be a file
            if partial is not None:
                partial.unlink(missing_ok=True)
        raise
    finally:
        if folder is not None:
            end_unfinished(folder)


def beside(path: Path, start: str, ending: str) -> Path:
    """The file beside another that is called as that one between a start and an ending, in at most 255 bytes.

    Of a name that would be too long, a hash of it stands for its last letters: two long names stay two.
    """
    name = os.fsencode(path.name)
    room = LONGEST_NAME_BYTES - len(os.fsencode(start + ending))
    if len(name) > room:
        mark = hashlib.sha256(name).hexdigest()[:16]
        # Letters are not cut in two: some file systems refuse bytes that are no text.
        kept = name[: room - len(mark) - 1].decode("utf-8", "ignore").encode()
        name = kept + b"~" + mark.encode()
    return path.with_name(start + os.fsdecode(name) + ending)


@contextmanager
def utf8_path(path: Path) -> Iterator[Path]:
    """The path, or a link to it where it is not UTF-8: the libraries of Rerun and of ROS bags take no other."""
    if encodable(str(path)) == str(path):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="rallyscope-") as place:
        link = Path(place) / f"link{path.suffix if path.suffix.isascii() else ''}"
        link.symlink_to(path.absolute(), target_is_directory=path.is_dir())
        yield link


def begin_unfinished(parent: Path) -> Path:
    """A new, empty folder in `parent`, this process's own until `end_unfinished`; what kills have left there goes.

    Raises:
        OSError: if none can be made.
    """
    clear_unfinished(parent)
    for _ in range(_ATTEMPTS):
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        lock = _lock_in(folder)
        if lock is not None:
            _held[folder] = lock
            return folder
    raise OSError(errno.EAGAIN, "others take every new folder away", str(parent))


def end_unfinished(folder: Path) -> None:
    """Take such a folder away, with all that is still in it."""
    shutil.rmtree(folder, ignore_errors=True)
    lock = _held.pop(folder, None)
    if lock is not None:
        os.close(lock)
    if not POSIX:  # the lock was open, so it is still there
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def claimed(paths: Iterable[Path]) -> Iterator[Path]:
    """The first free one of a series of paths without end; within the block no other thread or program gets it.

    Within the block it is to become a file or a folder. Without a claim, two programs on one folder would find the same
    name free, and the later would replace what the earlier wrote. The claim is a hidden folder beside the path, which a
    kill frees like any unfinished result. An empty file of the name itself would be listed as a recording.

    Raises:
        OSError: if the folder cannot be written.
    """
    path, claim = next((path, claim) for path in paths if (claim := _claim(path)) is not None)
    try:
        yield path
    finally:
        end_unfinished(claim)


def file_stem(name: str) -> str:
    """The name of a file or folder for anything that has a name, a camera or a person; `unquote` gives it back."""
    # A full stop is encoded too: the result can be neither ".." nor end like a suffix.
    return quote(name, safe="").replace(".", "%2E")


def numbered(stem: str, longest: int | None = None) -> Iterator[str]:
    """STEM, STEM-2, STEM-3 and so on: names to choose a free one from, such as by `claimed`.

    Of a stem that would make a name longer than `longest` letters the last ones are left out.
    """
    yield stem[:longest]
    for ending in (f"-{number}" for number in itertools.count(2)):
        yield (stem if longest is None else stem[: longest - len(ending)]) + ending


def _claim(path: Path) -> Path | None:
    """A locked folder that stands for the path; None if there is something, or another has claimed it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    clear_unfinished(path.parent)
    claim = beside(path, PREFIX, ".claim")
    try:
        claim.mkdir()
    except FileExistsError:
        return None
    lock = _lock_in(claim)
    if lock is None:  # another took it for one that a kill has left: the next name is as good
        return None
    _held[claim] = lock
    if not path.exists():  # asked after the claim: who had it before has written by now
        return claim
    end_unfinished(claim)
    return None


def clear_unfinished(parent: Path) -> None:
    """Take away what processes that were killed have left in `parent`: the folders that nobody holds."""
    for folder in parent.glob(f"{PREFIX}*"):
        with suppress(OSError):
            try:
                lock = os.open(folder / _LOCK, os.O_RDWR)
            except FileNotFoundError:  # killed before there was one, or just being made: its maker makes another
                folder.rmdir()
                continue
            try:
                lock_descriptor(lock)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)
            if not POSIX:  # the lock was open, so it is still there
                shutil.rmtree(folder, ignore_errors=True)


def _lock_in(folder: Path) -> int | None:
    """The lock on a new folder; None if another process took it for one that was left."""
    try:
        lock = os.open(folder / _LOCK, os.O_CREAT | os.O_RDWR, 0o600)
    except FileNotFoundError:
        return None
    except OSError:
        with suppress(OSError):
            folder.rmdir()
        raise
    try:
        lock_descriptor(lock)
    except BlockingIOError:
        os.close(lock)
        return None
    except OSError:  # a file system without locks: there nobody takes anything away
        return lock
    if (folder / _LOCK).exists():
        return lock
    os.close(lock)
    return None


def put_in_place(partial: Path, path: Path, *, durable: bool) -> None:
    """Give a whole file its final name, in the place of what has it."""
    if durable:
        sync(partial)
    _replace(partial, path)
    if durable:
        sync(path.parent)


def _replace(source: Path, target: Path) -> None:
    """Rename over what is there. On Windows somebody who reads that is in the way, mostly for a moment."""
    until_s = time.monotonic() + PROBE_S
    while True:
        try:
            os.replace(source, target)
            return
        except PermissionError:
            if POSIX or time.monotonic() > until_s:
                raise
        time.sleep(PROBE_S / 20)


def put_beside(source: Path, target: Path) -> None:
    """Give a file its final name on the same disk, so that a power cut cannot undo it.

    Raises:
        FileExistsError: if there is a file of that name; it stays as it is.
    """
    sync(source)
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        target.open("xb").close()
        put_in_place(source, target, durable=True)
        return
    sync(target.parent)
    source.unlink()


def sync(path: Path) -> None:
    """Wait until a file's content, or a folder's entries, are on the disk: a power cut may take either."""
    if not POSIX and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDONLY if POSIX else os.O_RDWR)  # Windows syncs what may be written
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP) or not path.is_dir():  # some file systems sync no folders
            raise
    finally:
        os.close(descriptor)


def replace_file(path: Path, data: bytes, *, durable: bool) -> None:
    """Write a file in one step."""
    with replacing(path, durable=durable) as partial:
        partial.write_bytes(data)


def write_json(path: Path, value: object) -> None:
    """Write a JSON file in one step."""
    replace_file(path, json.dumps(value).encode(), durable=False)


def read_json(path: Path) -> dict[str, object]:
    """An object from a JSON file; empty if there is none."""
    try:
        value = parse_json(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}


def hold(path: Path) -> AbstractContextManager[object]:
    """Take a lock file, made if need be, for a `with` block; the lock goes with the process, the file stays.

    Raises:
        TimeoutError: if another holds it.
    """
    from filelock import FileLock  # brings asyncio, and every config is saved through this file

    path.parent.mkdir(parents=True, exist_ok=True)
    return FileLock(path, timeout=PROBE_S).acquire()


def is_held(path: Path) -> bool:
    """Whether somebody holds a lock file now."""
    try:
        with path.open("rb") as file:
            lock_descriptor(file.fileno(), shared=True)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False


def lock_descriptor(descriptor: int, *, shared: bool = False) -> None:
    """Lock an open file itself, until it is closed: for one that no lock file lies beside.

    On Windows no two share a lock, whatever was asked for.

    Raises:
        BlockingIOError: if another has it locked.
    """
    if fcntl is not None:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        return
    from filelock import lock_descriptor as lock  # as late as in `hold`

    if not lock(descriptor, blocking=False):
        raise BlockingIOError(errno.EAGAIN, "another has it locked")


def write_at(descriptor: int, data: bytes | memoryview, offset: int) -> int:
    """Write into an open file at a place; how many bytes were taken. One thread at a time."""
    if hasattr(os, "pwrite"):
        return os.pwrite(descriptor, data, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.write(descriptor, data)


def usable_cores() -> int:
    """How many processes can work at a time: the cores that this one may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def end_with_parent() -> None:
    """In a child: end when the parent does, even if that was killed.

    A worker of `multiprocessing` ends at once. Any other child hears of it by the end of its standard input, a pipe
    that its parent holds, and is interrupted first.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
        else:
            sys.stdin.read()
            _thread.interrupt_main()
            time.sleep(GIVES_UP_AFTER_S)
        os._exit(1)

    threading.Thread(target=watch, name="end-with-parent", daemon=True).start()
