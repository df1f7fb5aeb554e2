"""Faults that a process brings upon itself before it begins to work; each is for a process of its own.

What a fault touches is below one folder. Python's own writes can be made to fail; those of HDF5 and SQLite, which go to
the system directly, are reached by the limit of a file's size alone.
"""

from __future__ import annotations

import builtins
import ctypes
import errno
import io
import os
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

CAPABILITIES: Final = (1, 2, 3)
"""With which an administrator writes where the rights say no: CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH, CAP_FOWNER."""
_CAP_VERSION: Final = 0x20080522


@dataclass(frozen=True, slots=True, kw_only=True)
class Injection:
    """What is to go wrong in a process."""

    folder: Path
    """Where."""
    largest_bytes: int | None = None
    """No file may become larger, as on a disk that is full."""
    fails_from: int | None = None
    """This write, sync or rename and all after it fail with an error of the device."""
    as_plain_user: bool = False
    """An administrator gives up writing where the rights forbid it."""
    clock_step_s: float = 0.0
    """The wall clock, as Python's `time` tells it to this process alone, is stepped by so much, """
    clock_after_s: float = 0.0
    """so long after the beginning."""


class WatchedDisk:
    """Counts what Python writes, syncs and renames below a folder, and lets it fail from some number on."""

    def __init__(self, folder: Path, fails_from: int | None = None) -> None:
        self._folder, self._fails_from = str(folder.resolve()), fails_from
        self.steps = 0
        self.synced: set[int] = set()
        """Inodes of files that were synced after their last write."""
        self.named: set[str] = set()
        """Files whose name was on the disk when their folder was synced."""

    def install(self) -> None:
        """From now on, for this process."""
        for name in ("write", "pwrite", "fsync"):
            setattr(os, name, self._of_descriptor(getattr(os, name), syncs=name == "fsync"))
        for name in ("replace", "rename", "link"):
            setattr(os, name, self._of_names(getattr(os, name)))
        builtins.open = io.open = self._opening(io.open)  # type: ignore[assignment]

    def _step(self) -> None:
        self.steps += 1
        if self._fails_from is not None and self.steps >= self._fails_from:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    def _is_ours(self, path: object) -> bool:
        return isinstance(path, (str, os.PathLike)) and os.path.abspath(os.fspath(path)).startswith(self._folder)

    def _of_descriptor(self, act: Callable[..., Any], *, syncs: bool) -> Callable[..., Any]:
        def wrapped(descriptor: int, *rest: object) -> object:
            if not self._is_ours(os.readlink(f"/proc/self/fd/{descriptor}")):
                return act(descriptor, *rest)
            self._step()
            done = act(descriptor, *rest)
            (self.synced.add if syncs else self.synced.discard)(os.fstat(descriptor).st_ino)
            folder = os.readlink(f"/proc/self/fd/{descriptor}")
            if syncs and os.path.isdir(folder):
                self.named.update(os.path.join(folder, name) for name in os.listdir(folder))
            return done

        return wrapped

    def _of_names(self, act: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(source: str, target: str, **more: object) -> object:
            if self._is_ours(target):
                self._step()
                self.named.discard(os.path.realpath(target))
            return act(source, target, **more)

        return wrapped

    def _opening(self, act: Callable[..., Any]) -> Callable[..., Any]:
        watched = self

        class Raw(io.FileIO):
            def write(self, data: Any, /) -> int:
                watched._step()
                watched.synced.discard(os.fstat(self.fileno()).st_ino)
                return super().write(data)

        def wrapped(
            file: Any,
            mode: str = "r",
            buffering: int = -1,
            encoding: str | None = None,
            errors: str | None = None,
            newline: str | None = None,
            closefd: bool = True,
            opener: Any = None,
        ) -> Any:
            if not self._is_ours(file) or not set(mode) & set("wxa") or "+" in mode:
                return act(file, mode, buffering, encoding, errors, newline, closefd, opener)
            raw = Raw(file, mode.replace("b", "").replace("t", ""), opener=opener)
            buffered = io.BufferedWriter(raw)
            return buffered if "b" in mode else io.TextIOWrapper(buffered, encoding or "utf-8", errors, newline)

        return wrapped


def inject(injection: Injection) -> WatchedDisk:
    """Bring it about; the disk as it is seen from then on."""
    if injection.largest_bytes is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (injection.largest_bytes, injection.largest_bytes))
    if injection.clock_step_s:
        step_clock(injection.clock_step_s, injection.clock_after_s)
    if injection.as_plain_user and os.geteuid() == 0:
        _give_up_rights()
    disk = WatchedDisk(injection.folder, injection.fails_from)
    disk.install()
    return disk


def step_clock(by_s: float, after_s: float) -> None:
    """From then on the wall clock of this process is off; the machine's own and the files' times stay as they are."""
    at_s = time.monotonic() + after_s
    time_s, time_ns = time.time, time.time_ns

    def stepped_s() -> float:
        return time_s() + (by_s if time.monotonic() >= at_s else 0.0)

    def stepped_ns() -> int:
        return time_ns() + (int(by_s * 1e9) if time.monotonic() >= at_s else 0)

    time.time, time.time_ns = stepped_s, stepped_ns


def _give_up_rights() -> None:
    """Linux's capset without the capabilities that override the rights of files."""
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_CAP_VERSION, 0)
    data = (ctypes.c_uint32 * 6)()
    if libc.capget(ctypes.byref(header), ctypes.byref(data)):
        raise OSError(ctypes.get_errno(), "capget")
    keep = ~sum(1 << number for number in CAPABILITIES) & 0xFFFFFFFF
    for set_of in range(3):  # effective, permitted, inheritable of the first 32
        data[set_of] &= keep
    if libc.capset(ctypes.byref(header), ctypes.byref(data)):
        raise OSError(ctypes.get_errno(), "capset")
