"""Files that others may look at, hold or be killed over: replaced in one step, locked, and children that end in time.

After a kill there is the old file or the new one, never half of one. A lock goes with the process that holds it.
"""

from __future__ import annotations

import _thread
import errno
import fcntl
import itertools
import json
import multiprocessing
import os
import re
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Final

from core.text.json_text import parse_json

PROBE_S: Final = 0.2
"""Who wants a lock waits as long: `is_held` has it for a moment, and that is no reason to give up."""
GIVES_UP_AFTER_S: Final = 10.0
"""A child that was told of its parent's end has as long to tidy up."""
ABANDONED_S: Final = 3600.0
"""A partial file that is as old and whose writer is gone is taken away."""
_PARTIAL: Final = re.compile(r"\.(\d{1,9})-\d+\.part$")
_cleared: set[Path] = set()
_numbers = itertools.count()


@contextmanager
def replacing(path: Path, *, durable: bool, partial: Path | None = None) -> Iterator[Path]:
    """A name beside `path` to write to: it becomes `path` at the end of the block, and is gone if the block raises.

    The name is this writer's own, unless it is given: then what a kill has left is found, and written over, next time.
    `durable` waits until a power cut cannot undo it.
    """
    partial = partial or path.with_name(f".{path.name}.{os.getpid()}-{next(_numbers)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _clear_abandoned(path.parent)
        yield partial
        put_in_place(partial, path, durable=durable)
    except BaseException:
        with suppress(OSError):  # the folder itself may be a file
            partial.unlink(missing_ok=True)
        raise


def _clear_abandoned(folder: Path) -> None:
    """Take away, once for each folder, what writers that were killed have left there long ago."""
    if folder in _cleared:
        return
    _cleared.add(folder)
    for path in folder.glob(".*.part"):
        process = _PARTIAL.search(path.name)
        with suppress(OSError):
            if process and not _is_running(int(process[1])) and time.time() - path.stat().st_mtime > ABANDONED_S:
                path.unlink()


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def put_in_place(partial: Path, path: Path, *, durable: bool) -> None:
    """Give a whole file its final name, in the place of what has it."""
    if durable:
        sync(partial)
    os.replace(partial, path)
    if durable:
        sync(path.parent)


def sync(path: Path) -> None:
    """Wait until a file's content, or a folder's entries, are on the disk: a power cut may take either."""
    descriptor = os.open(path, os.O_RDONLY)
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

    Raises:
        BlockingIOError: if another has it locked.
    """
    fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


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
