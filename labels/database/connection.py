"""Connections to a label store, and what SQLite's errors mean to a person."""

from __future__ import annotations

import contextlib
import os
import re
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import quote

from core.errors import LabelError
from core.files import sync
from labels.database.folder import FILE
from labels.database.schema import (
    VERSION,
    check_schema,
    create_tables,
    is_empty,
    recording_of,
    upgrade_tables,
    version_of,
)

MOUNTS: Final = Path("/proc/mounts")
# fmt: off
NETWORK: Final = frozenset((
    "nfs", "nfs4", "cifs", "smb", "smb2", "smb3", "smbfs", "smbnetfs", "ncpfs", "9p", "afs", "ceph",
    "glusterfs", "lustre", "gpfs", "davfs", "davfs2", "sshfs", "s3fs", "rclone", "curlftpfs", "gcsfuse",
    "beegfs", "ocfs2", "gfs2",
))
# fmt: on
"""Types of file systems, without the `fuse.` in front of those that a program serves."""
_OCTAL = re.compile(r"\\([0-7]{3})")


class Mount(NamedTuple):
    """A row of `/proc/mounts`."""

    source: str
    kind: str
    """Type of the file system."""
    options: str

    @property
    def is_network(self) -> bool:
        """Whether other machines may write to it."""
        return self.kind.removeprefix("fuse.") in NETWORK

    @property
    def is_windows_disk(self) -> bool:
        """Whether it is a disk of Windows, as a Linux within Windows (WSL) sees it: by 9p, virtiofs or its own type."""
        served = any(option.startswith("aname=drvfs") for option in self.options.split(","))
        return served or "drvfs" in (self.kind, self.source)


def refuse_network_drive(path: Path, mounts: str | None = None) -> None:
    """Do nothing for a path on a disk of this system. `mounts` is the text of `/proc/mounts`; None: read it.

    Raises:
        LabelError: if it is on a network drive, or on a disk of Windows seen from WSL.
    """
    mount = mount_of(path, _read_mounts() if mounts is None else mounts)
    if mount is not None and mount.is_windows_disk:
        # no other machine writes there, but SQLite's log needs memory and locks that all programs of a file share
        raise LabelError(
            "labels cannot be kept on a disk of Windows from within WSL: programs of Windows see no locks of it",
            expected="a folder of the Linux system",
            got=mount.kind,
            where=path,
            remedy="give --data a folder in your Linux home; Windows shows it under \\\\wsl.localhost",
        )
    if mount is not None and mount.is_network:
        raise LabelError(
            "labels cannot be kept on a network drive: two machines that write would damage them",
            expected="a disk of this machine",
            got=mount.kind,
            where=path,
            remedy="choose a folder with --data, and copy the finished file",
        )


def filesystem_of(path: Path, mounts: str) -> str | None:
    """Type of the file system of a path, which need not exist; None if the table does not tell."""
    mount = mount_of(path, mounts)
    return None if mount is None else mount.kind


def mount_of(path: Path, mounts: str) -> Mount | None:
    """The row of `/proc/mounts` that a path, which need not exist, lies on; None if there is none."""
    parts = path.resolve().parts
    best, depth = None, -1
    for line in mounts.splitlines():
        fields = line.split(" ")
        if len(fields) < 3:
            continue
        point = Path(_OCTAL.sub(lambda match: chr(int(match[1], 8)), fields[1])).parts
        if parts[: len(point)] == point and len(point) >= depth:  # of two on one place, the later one is seen
            best, depth = Mount(fields[0], fields[2], "".join(fields[3:4])), len(point)
    return best


def _read_mounts() -> str:
    try:
        return MOUNTS.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


WAITS_S: Final = 20.0
"""For others who write; each of them takes some milliseconds."""
CHECKPOINT_PAGES: Final = 1000
"""So long the log grows before it is worked into the file: some 4 MB."""
LONGEST_VALUE: Final = 1_000_000
"""Bytes; a longer text in a file is no label's."""


class DamagedStoreError(LabelError):
    """A file that SQLite cannot make sense of."""


def open_to_write(path: Path, recording_uuid: str) -> sqlite3.Connection:
    """A connection that writes, made durable by each commit; the file is made if there is none.

    Raises:
        LabelError: if it cannot be written, is damaged, or is not the store of this recording.
    """
    refuse_network_drive(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _not_writable(path, error.strerror) from error
    with sqlite_errors(path, "cannot write labels here"):
        db = _connect(path, "rwc")
    try:
        with sqlite_errors(path, "cannot write labels here"):
            _log_ahead(db)
            db.execute("PRAGMA synchronous = FULL")
            db.execute("PRAGMA foreign_keys = ON")
            db.execute(f"PRAGMA wal_autocheckpoint = {CHECKPOINT_PAGES}")
            _create_if_empty(db, path, recording_uuid)
            check_schema(db, path)
            _check_recording(db, path, recording_uuid)
            _upgrade(db)
    except BaseException:
        db.close()
        raise
    return db


def open_to_read(path: Path, *, untouched: bool = False) -> sqlite3.Connection:
    """A connection that writes nothing: others may write meanwhile, the disk may be read-only.

    `untouched`: a file that no program has open is read as it is, without a log being made beside it.

    Raises:
        LabelError: if there is no store, it cannot be read, or it is damaged.
    """
    refuse_network_drive(path)
    log = path.with_name(f"{path.name}-wal")
    with sqlite_errors(path, "cannot read the labels"):
        if untouched and path.is_file() and not log.exists():
            return _checked(_connect(path, "ro&immutable=1"), path)
        try:
            return _checked(_connect(path, "ro"), path)
        except sqlite3.OperationalError:
            # No log beside it and no way to make one: nobody writes, and the file is all there is.
            if not path.is_file() or (log.exists() and log.stat().st_size):
                raise
            return _checked(_connect(path, "ro&immutable=1"), path)


def work_in_log(db: sqlite3.Connection) -> None:
    """Copy what stands in the log into the file, so that the file alone holds all labels; waits for nobody."""
    db.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()


def work_in_logs(folder: Path) -> None:
    """Copy the logs that killed programs have left beside the stores of a folder into the stores.

    A store that cannot be opened stays as it is: whoever reads it is told why.
    """
    for log in sorted(folder.glob(f"*/{FILE}-wal")):
        with contextlib.suppress(sqlite3.Error, OSError):
            if log.stat().st_size:
                with contextlib.closing(_connect(log.with_name(FILE), "rw")) as db:
                    work_in_log(db)


@contextmanager
def transaction(db: sqlite3.Connection) -> Iterator[None]:
    """All of the block or nothing; the end of it waits until it is on the disk."""
    db.execute("BEGIN IMMEDIATE")
    try:
        yield
        db.execute("COMMIT")
    except BaseException:
        with contextlib.suppress(sqlite3.Error):  # SQLite may have rolled back itself
            if db.in_transaction:
                db.execute("ROLLBACK")
        raise


@contextmanager
def sqlite_errors(path: Path, what: str, remedy: str = "") -> Iterator[None]:
    """Inside, an error of SQLite becomes one line.

    Raises:
        DamagedStoreError: if the file is damaged.
        LabelError: for any other error of SQLite.
    """
    try:
        yield
    except sqlite3.OperationalError as error:
        if "locked" in str(error):
            raise LabelError(what, got="another program keeps it busy", where=path, remedy="try again") from error
        if getattr(error, "sqlite_errorname", "") in ("SQLITE_CANTOPEN", "SQLITE_READONLY") and not remedy:
            raise _not_writable(path, str(error), what) from error
        raise LabelError(what, got=error, where=path, remedy=remedy or None) from error
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # the second over text that is none any more
        advice = f"what can be read of it: rallyscope labels merge {path} --out NEW.sqlite"
        raise DamagedStoreError("a damaged label store", got=error, where=path, remedy=advice) from error


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    address = f"file:{quote(os.fsencode(path.absolute()))}?mode={mode}"
    db = sqlite3.connect(address, uri=True, timeout=WAITS_S, isolation_level=None, check_same_thread=False)
    distrust(db)
    return db


def distrust(db: sqlite3.Connection) -> None:
    """The file may come from anywhere: its schema is not trusted, its pages are checked, nothing is attached."""
    db.execute("PRAGMA trusted_schema = OFF")
    db.execute("PRAGMA cell_size_check = ON")
    db.execute("PRAGMA mmap_size = 0")
    db.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_VALUE)


def _checked(db: sqlite3.Connection, path: Path) -> sqlite3.Connection:
    try:
        check_schema(db, path)
    except BaseException:
        db.close()
        raise
    return db


def _log_ahead(db: sqlite3.Connection) -> None:
    """Several that open a new file at once must wait for each other, which SQLite does not do here by itself."""
    until_s = time.monotonic() + WAITS_S
    while True:
        try:
            db.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or time.monotonic() > until_s:
                raise
            time.sleep(0.005)


def _create_if_empty(db: sqlite3.Connection, path: Path, recording_uuid: str) -> None:
    if not is_empty(db):
        return
    with transaction(db):
        if is_empty(db):  # else another has made it meanwhile
            create_tables(db, recording_uuid)
    sync(path.parent)  # a new file survives a power cut only with its folder's entry


def _upgrade(db: sqlite3.Connection) -> None:
    """Give a store of an earlier version the newest tables, in one step: a kill leaves it as it was."""
    if version_of(db) < VERSION:
        with transaction(db):
            upgrade_tables(db)  # looks again: another program may have done it meanwhile


def _check_recording(db: sqlite3.Connection, path: Path, recording_uuid: str) -> None:
    found = recording_of(db, path)
    if found != recording_uuid:
        raise LabelError("labels of something else", expected=recording_uuid, got=found, where=path)


def _not_writable(path: Path, got: str | None, what: str = "cannot write labels here") -> LabelError:
    return LabelError(what, got=got, where=path, remedy="choose a folder on a writable disk with --data")
