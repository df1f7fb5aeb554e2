"""Reading columns of an HDF5 file part after part, and what HDF5 says when it cannot read, in words that help."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, TypeVar

import h5py

from core.errors import RecordingError
from core.foreign_tables import UNITS_US
from core.recordings.sources.source import Columns, DecodeReport, RawColumns

UNREADABLE: Final = (OSError, ValueError, RuntimeError)
ROWS: Final = 1 << 18
"""Rows of a part."""
_TOLERANCE: Final = 2.0
"""By this factor the time of an event may be off its place in the index before its unit is another one."""
_SHORTEST_INDEX: Final = 10
Part = TypeVar("Part", Columns, RawColumns)


def read_in_parts(
    path: Path, rows: Callable[[h5py.File, int, int], Part], count: int, report: DecodeReport
) -> Iterator[Part]:
    """All rows of a file, part after part; what cannot be read ends them with a note.

    `rows` reads rows first to last - 1.

    Raises:
        RecordingError: if not even the first part can be read.
    """
    with suppress(ImportError):  # DSEC files are packed with blosc; what needs no plug-in is read without
        importlib.import_module("hdf5plugin")
    first = 0
    with h5py.File(path, "r") as file:
        while first < count:
            try:
                part = rows(file, first, min(first + ROWS, count))
            except UNREADABLE as error:
                if not first:
                    raise RecordingError("the events cannot be read", got=explain(error), where=path) from error
                report.notes.append(f"{path.name}: stopped at event {first:,} of {count:,}: {explain(error)}.")
                return
            yield part
            first += len(part[0])
            report.share = first / count


def unit_by_index(marks: h5py.Dataset, t: h5py.Dataset) -> str | None:
    """The unit of times that fits an index of milliseconds: `marks[k]` is the first event of millisecond k.

    "us" where the index is too short to tell, None where no unit fits.
    """
    last = len(marks) - 1
    if last < _SHORTEST_INDEX or not len(t):
        return "us"
    time = float(t[min(int(marks[last]), len(t) - 1)])
    fits = (unit for unit, us in UNITS_US.items() if last / _TOLERANCE <= time * us / 1000 <= last * _TOLERANCE)
    return next(fits, None)


def explain(error: Exception) -> str:
    """One clause for a note or an error."""
    text = " ".join(str(error).split())
    if "filter" in text or "plugin" in text:
        return f"its compression needs a plug-in (pip install 'rallyscope[dsec]'): {text}"
    # libhdf5: "truncated file: eof = SIZE, sblock->base_addr = 0, stored_eof = WHOLE"
    if (cut := re.search(r"truncated file: eof = (\d+).* stored_eof = (\d+)", text)) is not None:
        return f"{int(cut[1]):,} of its {int(cut[2]):,} bytes: it was cut short, so copy it again"
    return text
