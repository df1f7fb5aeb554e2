"""Files appear under their final names only when they are complete."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from core.errors import CommandError
from core.files import lock_descriptor, put_in_place

PREFIX: Final = ".unfinished-"
Progress = Callable[[float], None]
Cancelled = Callable[[], bool]


class ExportCancelledError(Exception):
    """Somebody asked the export to stop; nothing was left behind."""


def check_cancelled(cancelled: Cancelled) -> None:
    """Raises ExportCancelledError if somebody asked for it."""
    if cancelled():
        raise ExportCancelledError


@contextmanager
def unfinished_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A temporary name beside `path`, renamed to it at the end of the block; removed if the block raises.

    Raises:
        CommandError: if `path` exists and `overwrite` is not set, or it cannot be written.
    """
    with unfinished_folder(path.parent, [path.name], overwrite=overwrite) as folder:
        yield folder / path.name


@contextmanager
def unfinished_folder(folder: Path, names: list[str], *, overwrite: bool) -> Iterator[Path]:
    """A temporary folder inside `folder` for the named files; they are moved to `folder` at the end of the block.

    Raises:
        CommandError: if one of them exists and `overwrite` is not set, or it cannot be written.
    """
    there = [name for name in names if (folder / name).exists()]
    if there and not overwrite:
        raise CommandError("exists already", where=folder / there[0], remedy="take another name, or --force")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _clear_abandoned(folder)
        temporary = Path(tempfile.mkdtemp(prefix=PREFIX, dir=folder))
        held = os.open(temporary, os.O_RDONLY)
    except OSError as error:
        raise _not_written(folder, error) from error
    try:
        lock_descriptor(held)
        yield temporary
        for name in names:
            put_in_place(temporary / name, folder / name, durable=True)
    except OSError as error:
        raise _not_written(folder, error) from error
    finally:
        os.close(held)
        with suppress(OSError):
            shutil.rmtree(temporary)


def _not_written(folder: Path, error: OSError) -> CommandError:
    remedy = "free some space, or choose a folder that can be written"
    return CommandError(f"cannot write: {error.strerror or error}", where=folder, remedy=remedy)


def _clear_abandoned(folder: Path) -> None:
    """Take away what killed processes have left: the lock on a folder goes with its process."""
    for path in folder.glob(f"{PREFIX}*"):
        with suppress(OSError):
            held = os.open(path, os.O_RDONLY)
            try:
                lock_descriptor(held)
                shutil.rmtree(path, ignore_errors=True)
            finally:
                os.close(held)
