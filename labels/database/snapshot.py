"""A label store in a shared folder, read without locks: a copy of one moment in memory.

Another machine may write the file while it is copied, and its locks may not be seen here. A copy counts if the file
and its journal were the same before and after it. The writer's program may also have been killed in the middle of a
change: the journal then stays as it is, and undoes the change in the copy.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Final, NamedTuple

from core.errors import LabelError

LONGEST_VALUE: Final = 1_000_000
"""Bytes; a longer text in a file is no label's."""
LOOKS_EVERY_S: Final = 1.0
"""Between two looks whether the file has changed: each costs a network some exchanges."""
WAITS_S: Final = 20.0
"""For a moment in which nobody writes."""
FROZEN_S: Final = 2.0
"""A journal that stands so long is that of a writer who is gone; a change takes milliseconds."""
_COUNTER: Final = slice(24, 28)
"""Bytes of the file's header that every change counts up (SQLite's file format, 1.3.6)."""
_WRITE_VERSION: Final = 18
"""Byte of the header that is 2 if the file has a write-ahead log."""
_SUPER_JOURNAL: Final = bytes.fromhex("d9d505f920a163d7")
"""Ends a journal that names another file, which SQLite might delete. No store has one."""


class _Stamp(NamedTuple):
    """What changes with every change of a store."""

    counter: bytes
    file: tuple[int, int]
    """Bytes, and time of the last change, ns."""
    journal: tuple[int, int] | None
    """The same of a journal or a log with something in it."""


class Snapshot(sqlite3.Connection):
    """A copy in memory of a store in a shared folder."""

    source: Path
    stamp: _Stamp
    looked_s: float

    def refresh(self) -> bool:
        """Copy the store again if it has changed and nobody writes just now; whether that was done."""
        now_s = time.monotonic()
        if now_s - self.looked_s < LOOKS_EVERY_S:
            return False
        self.looked_s = now_s
        stamp = _stamp(self.source)
        if stamp is None or stamp == self.stamp or stamp.journal is not None:
            return False
        _fill(self)
        return True


_NEWEST: dict[Path, Snapshot] = {}
"""The latest copies: who asks again and again whose labels there are copies the file once."""
_MOST_KEPT: Final = 4
_LOCK: Final = threading.Lock()


def open_snapshot(path: Path) -> Snapshot:
    """A store as it is now, in memory.

    Raises:
        LabelError: if it is never at rest.
        OSError: if it cannot be read.
        sqlite3.Error: if it is damaged.
    """
    db = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False, factory=Snapshot)
    assert isinstance(db, Snapshot)
    try:
        db.source, db.looked_s = path, time.monotonic()
        _fill(db)
        distrust(db)
    except BaseException:
        db.close()
        raise
    return db


def is_write_ahead(path: Path) -> bool:
    """Whether a file says of itself that it has a write-ahead log."""
    header = _header(path)
    return header is not None and header[_WRITE_VERSION : _WRITE_VERSION + 1] == b"\x02"


def distrust(db: sqlite3.Connection) -> None:
    """The file may come from anywhere: its schema is not trusted, its pages are checked, nothing is attached."""
    db.execute("PRAGMA trusted_schema = OFF")
    db.execute("PRAGMA cell_size_check = ON")
    db.execute("PRAGMA mmap_size = 0")
    db.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_VALUE)


def _fill(db: Snapshot) -> None:
    with _LOCK:
        kept = _NEWEST.get(db.source)
        if kept is not None and kept.stamp == _stamp(db.source):
            db.stamp = kept.stamp
            kept.backup(db)
            return
        with tempfile.TemporaryDirectory(prefix="rallyscope-labels-", ignore_cleanup_errors=True) as folder:
            copy = Path(folder) / db.source.name
            db.stamp = _copy_of_one_moment(db.source, copy)
            with closing(sqlite3.connect(copy, isolation_level=None)) as file:
                distrust(file)
                file.backup(db)
        new = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False, factory=Snapshot)
        assert isinstance(new, Snapshot)
        new.stamp = db.stamp
        db.backup(new)
        if kept is not None:
            kept.close()
        elif len(_NEWEST) >= _MOST_KEPT:
            _NEWEST.pop(next(iter(_NEWEST))).close()
        _NEWEST[db.source] = new


def _copy_of_one_moment(path: Path, copy: Path) -> _Stamp:
    begun_s = since_s = time.monotonic()
    seen = _stamp(path)
    while True:
        now_s = time.monotonic()
        if seen is not None and (seen.journal is None or now_s - since_s > FROZEN_S):
            for side in ("", "-journal", "-wal"):
                _copy_if_there(path.with_name(path.name + side), copy.with_name(copy.name + side))
            if _stamp(path) == seen:
                return seen
        if now_s - begun_s > WAITS_S:
            raise LabelError("cannot read the labels", got="another program keeps writing", where=path)
        time.sleep(0.02)
        now = _stamp(path)
        if now != seen:
            seen, since_s = now, time.monotonic()


def _copy_if_there(path: Path, copy: Path) -> None:
    copy.unlink(missing_ok=True)
    try:
        shutil.copyfile(path, copy)
    except FileNotFoundError:
        return
    if path.name.endswith("-journal") and copy.read_bytes()[-len(_SUPER_JOURNAL) :] == _SUPER_JOURNAL:
        copy.unlink()
        raise LabelError("a journal beside these labels that is not theirs", where=path, remedy="move it elsewhere")


def _stamp(path: Path) -> _Stamp | None:
    """None if there is no file."""
    header = _header(path)
    if header is None:
        return None
    sides = [_size_and_time(path.with_name(path.name + side)) for side in ("-journal", "-wal")]
    own = _size_and_time(path)
    journal = next((side for side in sides if side is not None and side[0]), None)
    return None if own is None else _Stamp(header[_COUNTER], own, journal)


def _header(path: Path) -> bytes | None:
    try:
        with path.open("rb") as file:
            return file.read(100)
    except FileNotFoundError:
        return None


def _size_and_time(path: Path) -> tuple[int, int] | None:
    try:
        with path.open("rb"):  # to open a file of a network asks its server; its name alone may be remembered
            found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_size, found.st_mtime_ns
