"""The right to write a label store in a shared folder: one program at a time, whatever machine it runs on.

The lease is a file beside the store that its holder renews. No clock of another machine is ever read: a lease is stale
when its content has not changed for a while on the clock of whoever wants it. Whoever takes over a stale one puts his
own in its place in one step, waits, and looks whether it is still his. The holder looks at the file before and after
each transaction, so one whose lease was taken while his machine slept does not write any more.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import LabelError
from core.files import BINARY, write_at
from core.text import parse_json

SUFFIX: Final = "-writer"
LENGTH: Final = 512
"""Bytes, always: where only a file's size is looked at for a while (sshfs), the content is read up to its end."""
BOOT: Final = Path("/proc/sys/kernel/random/boot_id")
PROCESSES: Final = Path("/proc/self/ns/pid")


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaseTimes:
    """How often a lease is renewed, and when it is stale."""

    renew_s: float = 3.0
    """Between two renewals."""
    stale_s: float = 15.0
    """Without a change for so long, its holder is gone: five renewals."""
    settle_s: float = 2.0
    """Between putting one's own lease in the place of a stale one and writing: of two who do so, the later holds it."""


TIMES: Final = LeaseTimes()


class WriteLease:
    """The right of this program to write one store, shared by all that have it open here. Safe to use from threads."""

    def __init__(self, store: Path, times: LeaseTimes = TIMES) -> None:
        self.path = lease_path(store)
        self._store, self._times = store, times
        self._token = ""
        self._file: int | None = None
        self._renewals = 0
        self._renewed_s = 0.0
        self._lock = threading.RLock()
        self._ended = threading.Event()

    def take(self) -> None:
        """Get the lease; waits for one that seems stale.

        Raises:
            LabelError: if another program holds it, or the file cannot be made.
        """
        with self._lock, self._file_errors():
            self._take()
        threading.Thread(target=self._keep_renewing, name="label lease", daemon=True).start()

    def ensure(self) -> None:
        """Make sure that the lease is held; take it anew if it was lost while this machine slept and is free now.

        Raises:
            LabelError: if another program holds it.
        """
        with self._lock, self._file_errors():
            if not self.is_held:
                self._take()

    def confirm(self) -> None:
        """Do nothing if the lease is held.

        Raises:
            LabelError: if it was lost.
        """
        with self._lock, self._file_errors():
            if not self.is_held:
                raise LabelError("the right to write these labels was lost meanwhile", where=self.path)

    def release(self) -> None:
        """Let others write."""
        self._ended.set()
        with self._lock, contextlib.suppress(OSError):
            # a lease that was not renewed may be another's by now, and may become so between this look and the end
            if self.is_held:
                self.path.unlink()
            self._let_go()

    @contextmanager
    def _file_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise LabelError("cannot hold the right to write here", got=error.strerror, where=self.path) from error

    def _take(self) -> None:
        self._let_go()
        while True:
            found = _read(self.path)
            if found is None:
                if self._create():
                    return
                continue
            if not self._is_own(found) and not _has_ended(found):  # one's own, if this machine slept
                self._wait_until_stale(found)
            if _read(self.path) == found:
                self._replace()
                return

    def _create(self) -> bool:
        """Whether there was no lease, and this one is there now."""
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL | BINARY, 0o644)
        except FileExistsError:
            return False
        self._token = uuid.uuid4().hex
        self._write()
        return True

    def _replace(self) -> None:
        self._token = uuid.uuid4().hex
        own = self.path.with_name(f"{self.path.name}.{self._token}")
        self._file = os.open(own, os.O_RDWR | os.O_CREAT | os.O_EXCL | BINARY, 0o644)
        try:
            self._write()
            if os.name == "nt":  # an open file is not renamed there
                os.close(self._file)
                self._file = None
            own.replace(self.path)
        except BaseException:
            own.unlink(missing_ok=True)
            raise
        time.sleep(self._times.settle_s)
        if not self._is_own(_read(self.path)):
            self._let_go()
            raise _busy(self._store, _read(self.path))
        if self._file is None:
            self._file = os.open(self.path, os.O_RDWR | BINARY)
        self._write()

    def _wait_until_stale(self, found: bytes) -> None:
        """Return when the lease was the same for long enough, or is gone.

        Raises:
            LabelError: if somebody renews it.
        """
        since_s = _now_s()
        while _now_s() - since_s < self._times.stale_s:
            time.sleep(self._times.renew_s / 6)
            now = _read(self.path)
            if now is None:
                return
            if now != found:
                raise _busy(self._store, now)

    def _keep_renewing(self) -> None:
        while not self._ended.wait(self._times.renew_s):
            with self._lock, contextlib.suppress(OSError):
                if self._file is not None and self._is_fresh():
                    self._write()

    def _write(self) -> None:
        """Renew it in place: an own file that another has replaced takes the bytes, and nobody reads them."""
        assert self._file is not None
        begun_s = _now_s()
        self._renewals += 1
        content = {
            "host": socket.gethostname()[:64],
            "process": os.getpid(),
            "machine": _machine(),
            "token": self._token,
            "renewals": self._renewals,
        }
        write_at(self._file, json.dumps(content).encode().ljust(LENGTH), 0)
        os.fsync(self._file)
        self._renewed_s = begun_s

    @property
    def is_held(self) -> bool:
        """Whether this program may write now."""
        with self._lock:
            return self._file is not None and self._is_fresh() and self._is_own(_read(self.path))

    def _is_fresh(self) -> bool:
        """Whether nobody can have found it stale yet: half of the time is left for what differs between clocks."""
        return _now_s() - self._renewed_s < self._times.stale_s / 2

    def _is_own(self, content: bytes | None) -> bool:
        return content is not None and _fields(content).get("token") == self._token

    def _let_go(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):
                os.close(self._file)
            self._file = None


class _Holder:
    """The lease of one store in this program, and how many use it."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.lease: WriteLease | None = None
        self.users = 0


_HOLDERS: dict[Path, _Holder] = {}
_HOLDERS_LOCK = threading.Lock()


def lease_path(store: Path) -> Path:
    """Where the lease of a store is while somebody writes it."""
    return store.with_name(store.name + SUFFIX)


def borrow_lease(store: Path, times: LeaseTimes = TIMES) -> WriteLease:
    """The lease of a store, taken by the first of this program that writes it; each calls `return_lease` once.

    Raises:
        LabelError: if another program holds it.
    """
    with _HOLDERS_LOCK:
        holder = _HOLDERS.setdefault(store.resolve(), _Holder())
    with holder.lock:
        if holder.lease is None:
            lease = WriteLease(store, times)
            lease.take()
            holder.lease = lease
        else:
            holder.lease.ensure()
        holder.users += 1
        return holder.lease


def return_lease(store: Path, at_end: Callable[[], None] = lambda: None) -> None:
    """One user less; the last one calls `at_end` and lets other programs write."""
    with _HOLDERS_LOCK:
        holder = _HOLDERS[store.resolve()]
    with holder.lock:
        holder.users -= 1
        if not holder.users and holder.lease is not None:
            if holder.lease.is_held:
                at_end()
            holder.lease.release()
            holder.lease = None


def _busy(store: Path, content: bytes | None) -> LabelError:
    fields = {} if content is None else _fields(content)
    return LabelError(
        "another program writes these labels",
        expected="one writer at a time in a shared folder",
        got=f"process {fields.get('process', '?')} on {fields.get('host', '?')}",
        where=store,
        remedy="close it there to write here; they can be read meanwhile",
    )


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None


def _fields(content: bytes) -> dict[str, object]:
    try:
        value = parse_json(content)
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}


def _has_ended(content: bytes) -> bool:
    """Whether the holder ran on this machine and is gone: nobody waits after a kill.

    Where its number was given to another process meanwhile, one waits as for any other lease.
    """
    fields, machine = _fields(content), _machine()
    process = fields.get("process")
    if not machine or fields.get("machine") != machine or not isinstance(process, int) or process <= 0:
        return False
    try:
        os.kill(process, 0)  # never on Windows, where it ends the process: no machine is known there
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False


def _machine() -> str:
    """Names this start of this machine, and within it the processes that can see each other; empty if unknown.

    Host names repeat, and two containers have the same numbers for different processes.
    """
    try:
        return f"{BOOT.read_text().strip()}:{os.stat(PROCESSES).st_ino}"
    except OSError:
        return ""


def _now_s() -> float:
    """A clock that goes on while the machine sleeps, where there is one."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)
