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


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table with a first row of names."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerows([columns, *rows])
    return table.getvalue()


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Raises CommandError if it cannot be written."""
    write_text(path, csv_text(columns, rows))


def table_paths(recordings: Sequence[Path], out: Path) -> list[Path]:
    """Where the table of each recording goes: one to `out` itself, several into it as a folder, by their names.

    Raises:
        CommandError: if `out` cannot be that, or two recordings have one name.
    """
    if len(recordings) == 1:
        check_folder(out)
        return [out]
    if out.exists() and not out.is_dir():
        raise CommandError("several recordings need a folder", got="a file", where=f"--out {out}")
    check_folder(out)
    names = [f"{recording.stem}.csv" for recording in recordings]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise CommandError("two recordings of one name would have one table", got=twice, where="REC")
    return [out / name for name in names]
