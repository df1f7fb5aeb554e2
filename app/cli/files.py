"""Where verbs write: checked before the long work, and what goes wrong then is one line."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from core.errors import WRITE_REMEDY, CommandError
from core.files import replace_file


def check_folder(path: Path | None, where: str = "--out") -> None:
    """Raises CommandError if a file that is asked for has no folder to be in."""
    if path is not None and not path.parent.is_dir():
        raise CommandError("no such folder", got=path.parent, where=where)


def write_text(path: Path, text: str) -> None:
    """Write a file in one step: never half of it.

    Raises:
        CommandError: if it cannot be written.
    """
    try:
        replace_file(path, text.encode(), durable=True)
    except OSError as error:
        raise CommandError(f"cannot write: {error.strerror}", where=path, remedy=WRITE_REMEDY) from error


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Raises CommandError if it cannot be written."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerows([columns, *rows])
    write_text(path, table.getvalue())
