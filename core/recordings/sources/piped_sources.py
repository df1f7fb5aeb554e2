"""Sources that can be read only once: a pipe is kept as a file, since a file is recognised before it is read."""

from __future__ import annotations

import logging
import os
import select
import stat
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from core.errors import RecordingError

logger = logging.getLogger(__name__)
_PART_BYTES: Final = 1 << 20
_LOOK_MS: Final = 100
"""So often a wait for the writer looks whether it is cancelled."""
_QUIET_S: Final = 2.0
"""A pipe that lasts longer is spoken of: nobody else says what is waited for."""


def is_pipe(path: Path) -> bool:
    """Whether a path is a pipe: `/dev/stdin` behind `|`, `<(...)` of a shell, or one made by mkfifo."""
    try:
        return stat.S_ISFIFO(path.stat().st_mode)
    except OSError:
        return False


@contextmanager
def files_of_pipes(paths: Sequence[Path], cancelled: Callable[[], bool]) -> Iterator[list[Path] | None]:
    """The paths with a temporary file for each pipe, which has its name; None if cancelled while one is read."""
    if not any(map(is_pipe, paths)):
        yield list(paths)
        return
    with TemporaryDirectory(prefix="rallyscope-") as folder:
        files: list[Path] | None = []
        for number, path in enumerate(paths):
            file = path
            if is_pipe(path):
                file = Path(folder) / str(number) / path.name
                file.parent.mkdir()
                if not _keep(path, file, cancelled):
                    files = None
                    break
            files.append(file)
        yield files


def _keep(pipe: Path, file: Path, cancelled: Callable[[], bool]) -> bool:
    """Write all that comes through a pipe to a file; False if cancelled before its end."""
    began_s, announced = time.monotonic(), False
    try:
        # Not blocking: neither the opening of a pipe that nobody writes to, nor the reading, could be cancelled.
        with open(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as source, file.open("wb") as kept:
            waiting = select.poll()
            waiting.register(source, select.POLLIN)
            while not cancelled():
                if not announced and time.monotonic() - began_s > _QUIET_S:
                    announced = True
                    logger.warning("%s is a pipe: it is read until who writes to it ends", pipe)
                events = waiting.poll(_LOOK_MS)
                part = source.read(_PART_BYTES) if events else None
                if part:
                    kept.write(part)
                elif events and part is not None:  # the end: every writer has closed it
                    return True
    except OSError as error:
        what, remedy = "the pipe cannot be kept as a file", "save it to a file first"
        raise RecordingError(what, got=error.strerror, where=pipe, remedy=remedy) from error
    return False
