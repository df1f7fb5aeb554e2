"""Runs one export of a workspace at a time, for all browsers, and lists the exported files."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import stat
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from app.background.jobs import Job
from app.export.unfinished import Cancelled, ExportCancelledError, Progress
from app.formatting import size_text
from app.shared.workspace import Workspace, free_path, slug_from
from core.errors import WRITE_REMEDY, CommandError, RallyscopeError
from core.files import POSIX, lock_descriptor

logger = logging.getLogger(__name__)
CLOSE_WITHIN_S: Final = 5.0
LOCK: Final = ".exporting"
"""Lock file for systems that cannot lock a folder."""
Work = Callable[[Path, Progress, Cancelled], tuple[Path, ...]]
"""Writes the files to the given path."""


@dataclass(frozen=True, slots=True)
class ExportState:
    """State of the latest export."""

    name: str
    running: bool
    share: float
    """Progress, 0..1."""
    seconds: float
    """Time since it began, or its duration, s."""
    message: str
    """Result message; empty while it runs."""
    failed: bool

    @property
    def left_s(self) -> float | None:
        """Estimated time left, s; None while unknown."""
        # In the first fiftieth, what is loaded and compiled would be taken for the work's own pace.
        return None if self.share < 0.02 else self.seconds * (1 - self.share) / self.share


@dataclass(frozen=True, slots=True)
class ExportedFile:
    """One of the files in the folder of exports."""

    name: str
    """Path below that folder."""
    size: int
    changed_s: float


class Exporter:
    """Shared by all browsers; every method may be called from any thread."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._lock = threading.Lock()
        self._job: Job[tuple[Path, ...]] | None = None
        self._name = ""
        self._started_s = self._ended_s = 0.0
        self._message = self._note = ""
        self._failed = False

    def start(self, stem: str, suffix: str, work: Work, note: Callable[[], str] = lambda: "") -> str:
        """Start an export; returns the free name, made of `stem`, of its file (or folder, without a suffix).

        `note` is called in the thread of the export, for a sentence that stands behind the result.

        Raises:
            CommandError: if another export runs, or the folder cannot be written.
        """
        with self._lock:
            if self._job is not None and self._job.running:
                raise CommandError("another export runs", got=self._name, remedy="wait for it, or cancel it")
            with ExitStack() as begun:
                begun.callback(os.close, _lock(self._workspace))
                start, folder = slug_from(stem)[:50], self._workspace.exports
                paths = (folder / f"{start}-{number}{suffix}" for number in itertools.count(1))
                path = begun.enter_context(free_path(paths))
                holds = begun.pop_all()
            self._name = path.name
            self._started_s, self._ended_s, self._message, self._failed = time.monotonic(), 0.0, "", False

            def run(progress: Progress, cancelled: Cancelled) -> tuple[Path, ...]:
                self._note = note()  # first: a live rally forgets
                return work(path, progress, cancelled)

            self._job = Job(run, self._done, self._went_wrong, holds)
            return self._name

    def cancel(self) -> None:
        """Stop the running export; it leaves no file."""
        with self._lock:
            if self._job is not None and self._job.running and not self._message:
                self._job.cancel()
                self._ended_s, self._message = time.monotonic(), "cancelled"

    def state(self) -> ExportState | None:
        """State of the latest export; None if there was none."""
        job = self._job
        if job is None:
            return None
        running = job.running and not self._message
        until_s = self._ended_s or time.monotonic()
        return ExportState(self._name, running, job.share, until_s - self._started_s, self._message, self._failed)

    def files(self) -> tuple[ExportedFile, ...]:
        """Exported files, newest first."""
        root = self._workspace.exports
        found: list[ExportedFile] = []
        for path in (below for top in _shown_in(root) for below in (top, *_shown_in(top))):
            with contextlib.suppress(FileNotFoundError):  # a person or another server removes files meanwhile
                about = path.stat()
                if stat.S_ISREG(about.st_mode):
                    found.append(ExportedFile(path.relative_to(root).as_posix(), about.st_size, about.st_mtime))
        return tuple(sorted(found, key=lambda file: (-file.changed_s, file.name)))

    def path_of(self, name: str) -> Path:
        """Path of a listed file by its name.

        Raises:
            CommandError: if it is not in the list.
        """
        if name not in {file.name for file in self.files()}:  # never a path made from what a browser sent
            raise CommandError("no such export", got=repr(name[:80]), remedy="choose one from the list")
        return self._workspace.exports / name

    def close(self) -> None:
        """Stop the running export and wait until it has removed its unfinished file."""
        self.cancel()
        if self._job is not None:
            self._job.wait(CLOSE_WITHIN_S)

    def _done(self, files: tuple[Path, ...]) -> None:
        size = sum(path.stat().st_size for path in files)
        note = f". {self._note}" if self._note else ""
        # The whole message at once: whoever sees one takes it for the result.
        self._ended_s, self._message = time.monotonic(), f"{self._name}: {size_text(size)}{note}"

    def _went_wrong(self, error: Exception) -> None:
        if not isinstance(error, RallyscopeError | ExportCancelledError):
            logger.error("an export failed", exc_info=error)
        self._failed, self._ended_s = True, time.monotonic()
        self._message = str(error) or "it could not be made; the log says why"


def _shown_in(folder: Path) -> list[Path]:
    """What is in a folder and not hidden; nothing of what is no folder, or has gone meanwhile."""
    try:
        return [path for path in folder.iterdir() if not path.name.startswith(".")]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _lock(workspace: Workspace) -> int:
    """Lock the export folder until the descriptor is closed: one server on it exports at a time.

    Raises:
        CommandError: if another does, or the folder cannot be written.
    """
    folder = workspace.exports
    try:
        lock = os.open(folder, os.O_RDONLY) if POSIX else os.open(folder / LOCK, os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise CommandError("cannot export", got=error.strerror, where=folder, remedy=WRITE_REMEDY) from error
    try:
        lock_descriptor(lock)
    except BlockingIOError as error:
        os.close(lock)
        remedy = "wait for it, or cancel it there"
        raise CommandError("another server on this folder exports", where=folder, remedy=remedy) from error
    except OSError:  # a file system without locks
        pass
    return lock
