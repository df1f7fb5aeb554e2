"""Files appear under their final names only when they are complete."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from core.errors import WRITE_REMEDY, CommandError
from core.files import begin_unfinished, end_unfinished, put_beside, put_in_place

Progress = Callable[[float], None]
Cancelled = Callable[[], bool]


class ExportCancelledError(Exception):
    """The export was cancelled; no file is left."""


def check_cancelled(cancelled: Cancelled) -> None:
    """Raise ExportCancelledError if the export was cancelled."""
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
        raise _is_there(folder / there[0])
    try:
        folder.mkdir(parents=True, exist_ok=True)
        temporary = begin_unfinished(folder)
    except OSError as error:
        raise _not_written(folder, error) from error
    try:
        yield temporary
        for name in names:
            if overwrite:
                put_in_place(temporary / name, folder / name, durable=True)
            else:
                put_beside(temporary / name, folder / name)
    except FileExistsError as error:  # created by another process meanwhile
        raise _is_there(Path(str(error.filename2 or folder))) from error
    except OSError as error:
        raise _not_written(folder, error) from error
    finally:
        end_unfinished(temporary)


def _is_there(path: Path) -> CommandError:
    return CommandError("exists already", where=path, remedy="take another name, or --force")


def _not_written(folder: Path, error: OSError) -> CommandError:
    return CommandError(f"cannot write: {error.strerror or error}", where=folder, remedy=WRITE_REMEDY)
