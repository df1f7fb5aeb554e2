"""Events in NumPy files: an .npz of columns, or one array of records or of rows in either kind of file.

Accepted: columns named as in `table_columns` (t, x, y, p and their usual spellings); a structured array with such
fields; a plain (N, 4) array of t, x, y, p or x, y, t, p, told apart by which column never decreases.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.making import make_table_source
from core.recordings.sources.source import DecodeReport, EventSource, RawColumns
from core.recordings.sources.table_columns import find_columns, unit_of_name
from core.recordings.sources.values.stated_sizes import size_in_attributes
from core.recordings.sources.values.table_order import guess_columns

_ROWS: Final = 1 << 18
_BROKEN: Final = (OSError, ValueError, EOFError, zipfile.BadZipFile, KeyError, NotImplementedError, MemoryError)
_MEMORY_SHARE: Final = 0.5
"""An archive may unpack to this share of the machine's memory: a small one can hold a thousand times its size."""


class _Loaded(NamedTuple):
    rows: RawColumns
    unit: str | None
    """Of the times, as the file states it."""
    sensor: SensorSize | None
    assumed: str | None = None
    """What is said of columns without names."""


def open_numpy(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file.

    Raises:
        RecordingError: if no events are found in it.
    """
    try:
        _check_unpacked_size(path)
        loaded = _load(path)
    except _BROKEN as error:
        raise RecordingError("the NumPy file cannot be read", got=error, where=path) from error
    return [
        make_table_source(
            path,
            "camera",
            "NumPy",
            sensor or loaded.sensor,
            lambda report: _parts(loaded.rows, report),
            unit=loaded.unit,
            assumed=loaded.assumed,
        )
    ]


def _parts(rows: RawColumns, report: DecodeReport) -> Iterator[RawColumns]:
    count = len(rows.t)
    for first in range(0, count, _ROWS):
        yield RawColumns(*(column[first : first + _ROWS] for column in rows))
        report.share = min(1.0, (first + _ROWS) / count)


def _load(path: Path) -> _Loaded:
    """The columns, and what the file states of them."""
    loaded = np.load(path, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        return _from_array(loaded, path)
    with loaded:
        names = list(loaded.files)
        small = {name: loaded[name] for name in names if _is_about_size(name)}
        stated = size_in_attributes(small)
        whole = next((name for name in ("events", "arr_0") if name in names), None)
        if whole is not None:
            return _from_array(loaded[whole], path)._replace(sensor=stated)
        places = find_columns(names, where=str(path))
        arrays = {column: loaded[names[place]] for column, place in places.items()}
        arrays = {column: array.reshape(-1) if 1 in array.shape else array for column, array in arrays.items()}
        lengths = {column: array.shape for column, array in arrays.items()}
        if len(set(lengths.values())) != 1 or arrays["t"].ndim != 1:
            raise RecordingError("event columns differ in shape", expected="equal lengths", got=lengths, where=path)
        return _Loaded(_columns(arrays), unit_of_name(names[places["t"]]), stated)


def _is_about_size(name: str) -> bool:
    return any(
        word in name.lower() for word in ("width", "height", "resolution", "geometry", "sensor_size", "image_size")
    )


def _check_unpacked_size(path: Path) -> None:
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    most = _memory_bytes() * _MEMORY_SHARE
    if unpacked > most:
        raise RecordingError(
            "the archive is too large once it is unpacked",
            expected=f"at most {most / 1e9:.1f} GB, half of the memory here",
            got=f"{unpacked / 1e9:.1f} GB",
            where=path,
            remedy="save it as HDF5, which is read in parts",
        )


def _memory_bytes() -> int:
    """Memory of the machine, bytes; a usual size where it is unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 8 << 30


def _from_array(array: NDArray, path: Path) -> _Loaded:
    if array.dtype.names is not None:
        places = find_columns(array.dtype.names, where=str(path))
        named = {column: array[array.dtype.names[place]].reshape(-1) for column, place in places.items()}
        return _Loaded(_columns(named), unit_of_name(array.dtype.names[places["t"]]), None)
    if array.ndim != 2 or array.shape[1] != 4:
        raise RecordingError("not an array of events", expected="(N, 4) or records", got=array.shape, where=path)
    order = guess_columns(array[:10_000], where=str(path))
    columns = {column: array[:, place] for column, place in order.places.items()}
    return _Loaded(_columns(columns), None, None, order.note(path.name))


def _columns(arrays: dict[str, NDArray]) -> RawColumns:
    for name, kinds in (("t", "iuf"), ("x", "iuf"), ("y", "iuf"), ("p", "iufbSU")):
        if arrays[name].dtype.kind not in kinds:
            raise ValueError(f"column {name} is of type {arrays[name].dtype}")
    t = arrays["t"]
    if t.dtype.kind == "f" and not np.isfinite(t).all():
        raise ValueError("a time is not a finite number")
    return RawColumns(t, arrays["x"], arrays["y"], arrays["p"])
