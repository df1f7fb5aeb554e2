"""Events in NumPy files: an .npz of columns, or one array of records or of rows in either kind of file.

Accepted: columns named as in `table_columns` (t, x, y, p and their usual spellings), or x and y in one of (N, 2); a
structured array with such fields; a plain array of (N, 4) or (4, N), whose order its values tell.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.foreign_tables import UNIT_KEYS, UNITS_US, time_unit
from core.recordings.sources.making import make_table_source
from core.recordings.sources.source import DecodeReport, EventSource, RawColumns
from core.recordings.sources.table_columns import (
    camera_column,
    find_columns,
    refuse_several_cameras,
    refuse_split_time,
    unit_of_name,
)
from core.recordings.sources.values.stated_sizes import size_in_attributes
from core.recordings.sources.values.table_order import guess_columns

_ROWS: Final = 1 << 18
BROKEN: Final = (OSError, ValueError, EOFError, zipfile.BadZipFile, KeyError, NotImplementedError)
"""What numpy and zipfile raise of a damaged file."""
_MEMORY_SHARE: Final = 0.5
"""An archive may unpack to this share of the machine's memory: a small one can hold a thousand times its size."""


class _Loaded(NamedTuple):
    rows: RawColumns
    unit: str | None
    """Unit of the times, as the file states it."""
    sensor: SensorSize | None
    assumed: tuple[str, ...] = ()
    """What is said of columns without names."""


def open_numpy(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file.

    Raises:
        RecordingError: if no events are found in it.
    """
    try:
        _check_unpacked_size(path)
        rows, unit, stated, assumed = _load(path)
    except (*BROKEN, MemoryError) as error:  # a header may claim any size
        if "allow_pickle" in str(error):
            raise pickled(path) from error
        raise RecordingError("the NumPy file cannot be read", got=error, where=path) from error
    return [
        make_table_source(
            path, "camera", "NumPy", sensor or stated, lambda report: in_parts(rows, report),
            unit=unit, assumed=assumed,
        )
    ]  # fmt: skip


def open_archive(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of an archive.

    Raises:
        RecordingError: if it is an archive of PyTorch or of no arrays, or no events are found in it.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
    except BROKEN:
        members = []
    if members and not any(name.endswith((".npy", ".pkl")) for name in members):
        files = [name for name in members if not name.endswith("/") and not name.startswith("__MACOSX")]
        got = ", ".join(files[:3]) + (", ..." if len(files) > 3 else "")
        raise RecordingError("a ZIP archive without NumPy arrays", got=got, where=path, remedy="unpack it first")
    if any(name.endswith("data.pkl") for name in members):
        raise pickled(path)
    return open_numpy(path, sensor)


def pickled(path: Path) -> RecordingError:
    """What is said of a file that only runs of a pickle could open."""
    return RecordingError(
        "a pickled file is not opened: it could run any program",
        expected="an .npz or .npy of plain arrays",
        where=path,
        remedy="where you trust it, load it with its own tool and save the arrays: numpy.savez(F, t=t, x=x, y=y, p=p)",
    )


def in_parts(rows: RawColumns, report: DecodeReport) -> Iterator[RawColumns]:
    """Rows that are in memory, or mapped into it, part after part."""
    count = len(rows.t)
    for first in range(0, count, _ROWS):
        yield RawColumns(*(column[first : first + _ROWS] for column in rows))
        report.share = min(1.0, (first + _ROWS) / count)


def _load(path: Path) -> _Loaded:
    """The columns, the unit of their times and the sensor's size, as far as the file states them."""
    loaded = np.load(path, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        return _from_array(loaded, path, None)
    with loaded:
        names = [name for name in loaded.files if f"{name}.npy" in loaded.zip.namelist()]
        if not names:
            raise ValueError("an archive without NumPy arrays; unpack it")
        broken = [name for name in names if not isinstance(loaded[name], np.ndarray)]
        if broken:  # np.savez was interrupted: NumPy then gives the bytes of the member
            raise ValueError(f"{broken[0]}.npy in it holds no array; was it written to its end?")
        small = {name: loaded[name] for name in names if _is_about_size(name)}
        stated = size_in_attributes(small)
        words = [name for name in names if name.lower() in UNIT_KEYS and loaded[name].size == 1]
        unit = next((found for name in words if (found := time_unit(str(loaded[name].item())))), None)
        others = [name for name in names if name not in small and (unit is None or name not in words)]
        whole = next((name for name in ("events", "arr_0") if name in names), others[0] if len(others) == 1 else None)
        whole = whole or _records_in(loaded, others)
        if whole is not None:
            rows = _from_array(loaded[whole], path, stated)
            return rows._replace(unit=rows.unit or unit)
        pair = next((name for name in ("xy", "xys", "coords", "coordinates") if name in names), None)
        if pair is not None and "x" not in names:
            places = find_columns([*names, "x", "y"], where=str(path))
            xy = loaded[pair]
            x, y = xy if xy.shape[0] == 2 != xy.shape[-1] else xy.T
            arrays = {"t": loaded[names[places["t"]]], "x": x, "y": y, "p": loaded[names[places["p"]]]}
        else:
            places = find_columns([name.rpartition("/")[2] for name in names], where=str(path))
            arrays = {column: loaded[names[place]] for column, place in places.items()}
        arrays = {column: array.reshape(-1) if 1 in array.shape else array for column, array in arrays.items()}
        lengths = {column: array.shape for column, array in arrays.items()}
        if len(set(lengths.values())) != 1 or arrays["t"].ndim != 1:
            raise RecordingError("event columns differ in shape", expected="equal lengths", got=lengths, where=path)
        refuse_split_time(names, places["t"], lambda place: loaded[names[place]].reshape(-1), path)
        camera = camera_column(names)
        if camera is not None and loaded[names[camera]].shape == arrays["t"].shape:
            refuse_several_cameras(np.unique(loaded[names[camera]]), path)
        found = _columns(arrays, unit_of_name(names[places["t"]]) or unit, stated)
        used = {pair, *(names[place] for place in places.values() if place < len(names))}
        unread = ", ".join(name for name in others if name not in used)
        return found._replace(assumed=(f"{path.name} also holds {unread}, which is not read.",)) if unread else found


def _records_in(loaded: np.lib.npyio.NpzFile, names: list[str]) -> str | None:
    """The one array of records with the columns of events, in an archive that has no such columns itself."""
    if _has_columns([name.rpartition("/")[2] for name in names]):
        return None
    found = [name for name in names if _has_columns(loaded[name].dtype.names or ())]
    return found[0] if len(found) == 1 else None


def _has_columns(names: Sequence[str]) -> bool:
    try:
        return bool(find_columns(names, where=""))
    except RecordingError:
        return False


def _is_about_size(name: str) -> bool:
    words = ("width", "height", "resolution", "geometry", "size", "shape", "dims")
    return name.lower() in ("w", "h", "hw") or any(word in name.lower() for word in words)


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


def _from_array(array: NDArray, path: Path, stated: SensorSize | None) -> _Loaded:
    if array.dtype.names is not None:
        fields = array.dtype.names
        places = find_columns(fields, where=str(path))
        refuse_split_time(fields, places["t"], lambda place: array[fields[place]].reshape(-1), path)
        if (camera := camera_column(fields)) is not None:
            refuse_several_cameras(np.unique(array[fields[camera]]), path)
        named = {column: array[fields[place]].reshape(-1) for column, place in places.items()}
        return _columns(named, unit_of_name(fields[places["t"]]), stated)
    if array.ndim == 2 and array.shape[0] == 4 != array.shape[1]:
        array = array.T
    if array.ndim != 2 or array.shape[1] != 4:
        raise RecordingError("not an array of events", expected="(N, 4) or records", got=array.shape, where=path)
    columns = list(array.T)
    if array.dtype.kind in "SU":  # text, as of polarities that are words
        columns = [_numbers_or_words(column) for column in columns]
    sample = [one if one.dtype.kind not in "SU" else np.unique(one, return_inverse=True)[1] for one in columns]
    order = guess_columns(np.stack([one[:10_000] for one in sample], axis=1), where=str(path))
    rows = _columns({column: columns[place] for column, place in order.places.items()}, None, stated)
    return rows._replace(assumed=(order.note(path.name),))


def _numbers_or_words(column: NDArray) -> NDArray:
    try:
        return column.astype(np.float64)
    except ValueError:
        return column


def _columns(arrays: dict[str, NDArray], unit: str | None, stated: SensorSize | None) -> _Loaded:
    if arrays["t"].dtype.kind in "mM":  # times of NumPy carry their unit
        unit = np.datetime_data(arrays["t"].dtype)[0]
        arrays = {**arrays, "t": arrays["t"].astype(np.int64)}
        if unit not in UNITS_US:
            raise ValueError(f"times count {unit}, expected one of {', '.join(UNITS_US)}")
    for name, kinds in (("t", "iuf"), ("x", "iuf"), ("y", "iuf"), ("p", "iufbSU")):
        if arrays[name].dtype.kind not in kinds:
            raise ValueError(f"column {name} is of type {arrays[name].dtype}")
    return _Loaded(RawColumns(arrays["t"], arrays["x"], arrays["y"], arrays["p"]), unit, stated, ())
