"""Connections to a label store, and what SQLite's errors mean to a person."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final
from urllib.parse import quote

from core.errors import LabelError
from core.files import sync
from labels.database.file_system import is_shared, refuse_unsafe_folder, refuse_whole_files
from labels.database.folder import FILE
from labels.database.schema import check_schema, create_tables, is_empty, recording_of
from labels.database.snapshot import distrust, is_write_ahead, open_snapshot
from labels.database.write_lease import WriteLease, borrow_lease, lease_path, return_lease

WAITS_S: Final = 20.0
"""For others who write; each of them takes some milliseconds."""
CHECKPOINT_PAGES: Final = 1000
"""So long the log grows before it is worked into the file: some 4 MB."""


class DamagedStoreError(LabelError):
    """A file that SQLite cannot make sense of."""


def open_to_write(path: Path, recording_uuid: str) -> sqlite3.Connection:
    """A connection that writes, made durable by each commit; the file is made if there is none.

    On a disk of this machine any number of programs may have one. In a shared folder one program at a time has, for as
    long as it holds the lease: a write-ahead log needs memory that all programs of a file share.

    Raises:
        LabelError: if it cannot be written, is damaged, is not the store of this recording, or another program writes
            it in a shared folder.
    """
    refuse_whole_files(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _not_writable(path, error.strerror) from error
    shared = is_shared(path)
    # on a disk of this machine there is a lease while another machine, for which the folder is shared, writes
    db = _connect_as_only_writer(path) if shared or lease_path(path).exists() else _connect_to_write(path)
    try:
        with sqlite_errors(path, "cannot write labels here"):
            db.execute("PRAGMA synchronous = FULL")
            db.execute("PRAGMA foreign_keys = ON")
            db.execute(f"PRAGMA wal_autocheckpoint = {CHECKPOINT_PAGES}")
            _create_if_empty(db, path, recording_uuid)
            # Before anything of the file is run: a schema can hold triggers of a stranger.
            check_schema(db, path)
            _check_recording(db, path, recording_uuid)
    except BaseException:
        db.close()
        raise
    return db


def _connect_to_write(path: Path) -> sqlite3.Connection:
    with sqlite_errors(path, "cannot write labels here"):
        db = _connect(path, "rwc")
        try:
            _set_journal(db, "WAL")
        except BaseException:
            db.close()
            raise
    return db


def _connect_as_only_writer(path: Path) -> sqlite3.Connection:
    refuse_unsafe_folder(path.parent)
    lease = borrow_lease(path)
    try:
        _refuse_open_log(path)
        with sqlite_errors(path, "cannot write labels here"):
            db = _connect(path, "rwc", LeasedConnection)
    except BaseException:
        return_lease(path)
        raise
    assert isinstance(db, LeasedConnection)
    db.lease, db.store = lease, path
    try:
        with sqlite_errors(path, "cannot write labels here"):
            if is_write_ahead(path):
                db.execute("PRAGMA locking_mode = EXCLUSIVE")  # a log is then read without shared memory
            # the journal stays as an empty file: who opens it sees its length, while the absence of a name may be old
            _set_journal(db, "TRUNCATE")
            db.execute("PRAGMA locking_mode = NORMAL")
            db.execute("SELECT count(*) FROM sqlite_schema").fetchone()  # lets go of the lock
    except BaseException:
        db.close()
        raise
    return db


class LeasedConnection(sqlite3.Connection):
    """Writes a store in a shared folder while this program holds its lease."""

    lease: WriteLease | None = None
    store: Path

    def close(self) -> None:
        """Close the file, then let other programs write."""
        super().close()
        if self.lease is None:
            return
        self.lease = None
        return_lease(self.store, self._remove_empty_journal)

    def _remove_empty_journal(self) -> None:
        journal = self.store.with_name(f"{self.store.name}-journal")
        with contextlib.suppress(OSError):
            if not journal.stat().st_size:
                journal.unlink()


def _refuse_open_log(path: Path) -> None:
    """A file of shared memory is there while a program of the machine that has the disk writes; no lock shows that."""
    memory = path.with_name(f"{path.name}-shm")
    if memory.exists():
        raise LabelError(
            "these labels are open on the machine that has this disk",
            expected="no other program that writes them",
            got=memory.name,
            where=path,
            remedy="close them there; after a crash start Rallyscope there once, or delete the -shm file (never -wal)",
        )


def open_to_read(path: Path, *, untouched: bool = False, own: bool = False) -> sqlite3.Connection:
    """A connection that writes nothing: others may write meanwhile, the disk may be read-only.

    Of a store in a shared folder it reads a copy in memory (`Snapshot`), since locks may not reach other machines.
    `untouched`: a file that no program has open is read as it is, without a log being made beside it. `own`: this
    program has it open for writing, so no other writes.

    Raises:
        LabelError: if there is no store, it cannot be read, or it is damaged.
    """
    if not own and path.is_file() and (is_shared(path) or lease_path(path).exists()):
        with sqlite_errors(path, "cannot read the labels"):
            return _checked(open_snapshot(path), path)
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

    In a shared folder nothing is done: the next writer does it, once it holds the lease. A store that cannot be opened
    stays as it is: whoever reads it is told why.
    """
    if is_shared(folder):
        return
    for log in sorted(folder.glob(f"*/{FILE}-wal")):
        with contextlib.suppress(sqlite3.Error, OSError):
            if log.stat().st_size:
                with contextlib.closing(_connect(log.with_name(FILE), "rw")) as db:
                    work_in_log(db)


@contextmanager
def transaction(db: sqlite3.Connection) -> Iterator[None]:
    """All of the block or nothing; the end of it waits until it is on the disk.

    Raises:
        LabelError: if another program writes the store in a shared folder now.
    """
    lease = db.lease if isinstance(db, LeasedConnection) else None
    if lease is not None:
        lease.ensure()
    db.execute("BEGIN IMMEDIATE")
    try:
        if lease is not None:
            lease.confirm()
        yield
        if lease is not None:
            lease.confirm()
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


def _connect(path: Path, mode: str, factory: type[sqlite3.Connection] = sqlite3.Connection) -> sqlite3.Connection:
    address = f"file:{quote(os.fsencode(path.absolute()))}?mode={mode}"
    db = sqlite3.connect(
        address, uri=True, timeout=WAITS_S, isolation_level=None, check_same_thread=False, factory=factory
    )
    distrust(db)
    return db


def _checked(db: sqlite3.Connection, path: Path) -> sqlite3.Connection:
    try:
        check_schema(db, path)
    except BaseException:
        db.close()
        raise
    return db


def _set_journal(db: sqlite3.Connection, mode: str) -> None:
    """Several that open a new file at once must wait for each other, which SQLite does not do here by itself."""
    until_s = time.monotonic() + WAITS_S
    while True:
        try:
            db.execute(f"PRAGMA journal_mode = {mode}")
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


def _check_recording(db: sqlite3.Connection, path: Path, recording_uuid: str) -> None:
    found = recording_of(db, path)
    if found != recording_uuid:
        raise LabelError("labels of something else", expected=recording_uuid, got=found, where=path)


def _not_writable(path: Path, got: str | None, what: str = "cannot write labels here") -> LabelError:
    return LabelError(what, got=got, where=path, remedy="choose a folder on a writable disk with --data")
