"""Events in MAT-files of MATLAB: a struct such as TD with x, y, p and ts, or variables of such names.

Version 5 to 7 is read here; version 7.3 is HDF5, see `hdf5_tables`. MATLAB counts from 1: where no address is 0, that
is taken for the first.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.making import make_table_source
from core.recordings.sources.numpy_files import in_parts
from core.recordings.sources.source import EventSource, FactOrigin, RawColumns
from core.recordings.sources.table_columns import addresses_from_column, find_columns, refuse_split_time, unit_of_name
from core.recordings.sources.values.assumed_sizes import AddressCounts
from core.recordings.sources.values.stated_sizes import size_in_attributes

MAT5_MAGIC: Final = b"MATLAB 5.0"
_DEEPEST: Final = 4
"""Structs in structs, as of jAER's and AEDAT tools' `aedat.data.polarity`."""


def open_matlab(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file.

    Raises:
        RecordingError: if no variable or struct has the columns of events, or several have.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        variables = loadmat(str(path), simplify_cells=True)
    # NotImplementedError: version 7.3, which is HDF5. The others are what damaged files raise.
    except (MatReadError, OSError, ValueError, TypeError, EOFError, NotImplementedError, MemoryError) as error:
        raise RecordingError("the MAT-file cannot be read", got=" ".join(str(error).split()), where=path) from error
    variables = {name: value for name, value in variables.items() if not name.startswith("__")}
    found = _tables(variables, path.name, 0)
    if len(found) != 1:
        listed = ", ".join(found) if found else ", ".join(variables) or "nothing"
        what = "several tables of events" if found else "no events in the MAT-file"
        expected = "a struct with x, y, p and ts" if not found else "one"
        raise RecordingError(what, expected=expected, got=listed, where=path, remedy="save one struct: save(F, 'TD')")
    ((_, holder),) = found.items()
    places = find_columns(list(holder), where=str(path))
    names = list(holder)

    def column_at(place: int) -> NDArray:
        return np.asarray(holder[names[place]]).reshape(-1)

    refuse_split_time(names, places["t"], column_at, path)
    columns = {column: column_at(place) for column, place in places.items()}
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) != 1 or any(values.dtype.kind not in "iufb" for values in columns.values()):
        got = {column: f"{values.dtype}{values.shape}" for column, values in columns.items()}
        raise RecordingError("event columns differ in shape", expected="numbers of equal lengths", got=got, where=path)
    remarks: tuple[str, ...] = ()
    x, y = columns["x"], columns["y"]
    sizes = {name: value for name, value in holder.items() if np.asarray(value).size < 3}
    size, size_from = sensor or size_in_attributes(sizes), FactOrigin.FILE
    if size is None:
        addresses = AddressCounts()
        addresses.add(addresses_from_column(x), addresses_from_column(y))
        size, size_from = addresses.filled_from_1, FactOrigin.ASSUMED
    if len(x) and _count_from_1(x, y, size):
        columns |= {"x": x.astype(np.int64) - 1, "y": y.astype(np.int64) - 1}
        remarks = (f"{path.name}: its addresses count from 1, as MATLAB does; now from 0.",)
    rows = RawColumns(columns["t"], columns["x"], columns["y"], columns["p"])
    return [
        make_table_source(
            path, "camera", "MATLAB", size, lambda report: in_parts(rows, report),
            unit=unit_of_name(names[places["t"]]), sensor_from=size_from, remarks=remarks,
        )
    ]  # fmt: skip


def _count_from_1(x: NDArray, y: NDArray, size: SensorSize | None) -> bool:
    """Whether no address is 0 and one is as large as the sensor: nothing else tells it."""
    if min(x.min(), y.min()) < 1 or size is None:
        return False
    return bool(x.max() == size.width_px or y.max() == size.height_px)


def _tables(values: dict[str, object], where: str, depth: int) -> dict[str, dict[str, object]]:
    """The structs, or the variables themselves, that have the columns of events, by their places."""
    try:
        find_columns(list(values), where=where)
    except RecordingError:
        inner = {f"{where}.{name}": value for name, value in values.items() if isinstance(value, dict)}
        found: dict[str, dict[str, object]] = {}
        for name, value in inner.items() if depth < _DEEPEST else ():
            found |= _tables(value, name, depth + 1)  # pyright: ignore[reportArgumentType]
        return found
    return {where: values}
