"""HDF5 layouts of datasets: DSEC, MVSEC, and what is used for training networks.

/events/{x, y, t, p}, /t_offset                  DSEC: t in us, absolute = t + t_offset; the offset nearest to them
/davis/{left, right}/events                      MVSEC: rows of x, y, t in s, polarity -1 or 1
/events/{xs, ys, ts, ps}, sensor_resolution      the unit of ts is told from its values
/raw_events/{x, y, t, p}                         likewise
/events (N, 4): t in us, x, y, polarity          v2e, or another order that the values tell; /frame (M, height, width),
                                                 if there, tells the size
any group of columns, any dataset of records     whose names are those of `table_columns`; several are several cameras
"""

from __future__ import annotations

import importlib
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.foreign_tables import UNIT_KEYS, UNIT_NAMES, time_unit
from core.recordings.hdf5 import dataset_at, group_at
from core.recordings.sources.hdf5_reading import UNREADABLE, explain, read_in_parts, unit_by_index
from core.recordings.sources.making import make_table_source
from core.recordings.sources.source import DecodeReport, EventSource, FactOrigin, RawColumns
from core.recordings.sources.table_columns import (
    camera_column,
    find_columns,
    refuse_several_cameras,
    refuse_split_time,
    unit_of_name,
)
from core.recordings.sources.values.stated_sizes import size_in_attributes
from core.recordings.sources.values.table_order import TableOrder, guess_columns
from core.recordings.sources.values.table_values import TableSummary, summarise_table

_COLUMNS: Final = ("t", "x", "y", "p")
_LABELS: Final[dict[tuple[str, tuple[str, ...]], str]] = {
    ("events", ("t", "x", "y", "p")): "DSEC HDF5",
    ("events", ("ts", "xs", "ys", "ps")): "HDF5 of xs, ys, ts, ps",
    ("raw_events", ("t", "x", "y", "p")): "HDF5 of raw_events",
}
_DSEC_SENSOR: Final = SensorSize(640, 480)
_MVSEC_SENSOR: Final = SensorSize(346, 260)
_MOST_TABLES: Final = 16
_V2E_ORDER: Final = TableOrder({"t": 0, "x": 1, "y": 2, "p": 3}, seconds=False)
_SAMPLE_ROWS: Final = 10_000
_ROWS: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class _Table:
    """Where the events of a camera are in the file."""

    path: str
    """Path of the group of columns, or of the dataset of records."""
    names: tuple[str, ...]
    """Names of t, x, y, p: datasets of the group, or fields of the records."""
    records: bool

    def read(self, file: h5py.File, first: int, last: int) -> RawColumns:
        if self.records:
            rows = dataset_at(file, self.path)[first:last]
            return RawColumns(*(rows[name].reshape(-1) for name in self.names))
        group = group_at(file, self.path)
        columns = (dataset_at(group, name) for name in self.names)
        # MATLAB's dimensions are turned round in HDF5: its columns are (1, N).
        parts = (one[:, first:last] if _lies(one.shape) else one[first:last] for one in columns)
        return RawColumns(*(np.asarray(part).reshape(-1) for part in parts))

    def count(self, file: h5py.File, path: Path) -> int:
        """How many rows there are.

        Raises:
            RecordingError: if the columns do not fit together.
        """
        if self.records:
            return len(dataset_at(file, self.path))
        shapes = {name: dataset_at(group_at(file, self.path), name).shape for name in self.names}
        if any(not shape or np.prod(shape) != max(shape[0], shape[-1] * _lies(shape)) for shape in shapes.values()):
            raise RecordingError("event columns are no columns", expected="one number a row", got=shapes, where=path)
        lengths = {name: int(np.prod(shape)) for name, shape in shapes.items()}
        if len(set(lengths.values())) != 1:
            raise RecordingError("event columns differ in length", expected="equal lengths", got=lengths, where=path)
        return lengths[self.names[0]]


def _lies(shape: tuple[int, ...]) -> bool:
    return len(shape) == 2 and shape[0] == 1


def open_hdf5_table(path: Path, sensor: SensorSize | None) -> list[EventSource] | None:
    """The cameras of the file if it has one of these layouts, else None.

    Raises:
        RecordingError: if the columns do not fit together.
    """
    with h5py.File(path, "r") as file:
        events = file.get("events")
        if isinstance(events, h5py.Dataset) and not events.dtype.names:
            return [_open_rows(path, file, sensor)]
        if "davis" in file:
            return _open_mvsec(path, group_at(file, "davis"), sensor)
        found = _find_tables(file)
        usual = [table for table in found if table.path in ("events", "raw_events")]
        tables = usual[:1] or found
        unread = ", ".join(table.path for table in found if table not in tables)
        remarks = (f"{path.name} also holds events in {unread}, which are not read.",) if unread else ()
        names = _camera_names([table.path for table in tables])
        return [
            _open_table(path, file, table, name, sensor, remarks) for table, name in zip(tables, names, strict=True)
        ] or None


def _find_tables(file: h5py.File) -> list[_Table]:
    """Every group or dataset of the file whose columns are named as those of events."""
    found: list[_Table] = []

    def look(name: str, item: object) -> None:
        if len(found) >= _MOST_TABLES:
            return
        if not (isinstance(item, h5py.Group) or (isinstance(item, h5py.Dataset) and item.ndim)):
            return
        columns = _columns_of(item)
        try:
            places = find_columns(columns, where="")
        except RecordingError:
            return
        found.append(
            _Table(name, tuple(columns[places[column]] for column in _COLUMNS), isinstance(item, h5py.Dataset))
        )

    look("/", file)
    file.visititems(look)
    return found


def _columns_of(holder: h5py.Group | h5py.Dataset) -> list[str]:
    """Names of the datasets of a group, or of the fields of records."""
    if isinstance(holder, h5py.Dataset):
        return list(holder.dtype.names or ())
    return [str(key) for key, child in holder.items() if isinstance(child, h5py.Dataset)]


def _camera_names(paths: list[str]) -> list[str]:
    """The parts in which the places differ; "camera" for a single one."""
    if len(paths) == 1:
        return ["camera"]
    parts = [path.split("/") for path in paths]
    shared = set(parts[0]).intersection(*parts[1:]) if parts else set()
    return ["_".join(part for part in some if part not in shared) or "camera" for some in parts]


def _open_table(
    path: Path, file: h5py.File, table: _Table, name: str, sensor: SensorSize | None, remarks: tuple[str, ...]
) -> EventSource:
    count = table.count(file, path)
    where = dataset_at(file, table.path) if table.records else group_at(file, table.path)
    holders = [file, where, *([where.parent] if table.path != "/" else [])]
    _check_one_camera(path, file, table, count)
    _check_one_time(path, file, table)
    # DSEC's files of several cameras put into one have an offset beside the events of each.
    offset_at = next((one for one in (*holders[1:], file) if isinstance(one, h5py.Group) and "t_offset" in one), None)
    offset_us = 0 if offset_at is None else int(np.asarray(dataset_at(offset_at, "t_offset")[()]).reshape(-1)[0])
    label = "HDF5 of records" if table.records else _LABELS.get((table.path, table.names), "HDF5 of columns")
    dsec = label.startswith("DSEC") and "ms_to_idx" in file
    times = where if table.records else dataset_at(group_at(file, table.path), table.names[0])
    unit, unit_from = unit_of_name(table.names[0]) or _stated_unit([times, *holders]), FactOrigin.FILE
    if unit is None and dsec and isinstance(times, h5py.Dataset):
        unit, unit_from = _unit_of_dsec(dataset_at(file, "ms_to_idx"), times), FactOrigin.FORMAT
        if unit not in (None, "us"):
            unit_from = FactOrigin.FILE
            remarks += (f"{path.name}: the times count {UNIT_NAMES[unit]} by ms_to_idx.",)
    seen: TableSummary | None = None
    sensor_from = FactOrigin.FILE
    if sensor is None:
        columns = [] if table.records else [dataset_at(group_at(file, table.path), name) for name in table.names]
        sensor = _stated_sensor([*holders, *columns], None)
        if sensor is not None:  # some attributes do not tell which side is which: the events do
            seen = summarise_table(read_in_parts(path, table.read, count, DecodeReport()))
            sensor = _stated_sensor([*holders, *columns], seen.addresses.largest)
    if sensor is None and dsec and "t_offset" in file:
        sensor, sensor_from = _DSEC_SENSOR, FactOrigin.DATA_SET
    return make_table_source(
        path, name, label, sensor, lambda report: read_in_parts(path, table.read, count, report),
        unit=unit, unit_from=unit_from, shift_us=offset_us, seen=seen, sensor_from=sensor_from, remarks=remarks,
    )  # fmt: skip


def _check_one_camera(path: Path, file: h5py.File, table: _Table, count: int) -> None:
    """Raises RecordingError if a column beside the events says that they are of several cameras."""
    holder = dataset_at(file, table.path) if table.records else group_at(file, table.path)
    names = _columns_of(holder)
    place = camera_column(names)
    name = "" if place is None else names[place]
    if isinstance(holder, h5py.Group):
        other = holder.get(name) if name else None
        if not isinstance(other, h5py.Dataset) or other.shape != (count,):
            return
        column = dataset_at(holder, name)
    elif name:
        column = holder.fields(name)
    else:
        return
    try:
        parts = (np.unique(column[first : first + _ROWS]).tolist() for first in range(0, count, _ROWS))
        refuse_several_cameras(set().union(*parts), path)
    except UNREADABLE as error:
        raise RecordingError("the events cannot be read", got=explain(error), where=path) from error


def _check_one_time(path: Path, file: h5py.File, table: _Table) -> None:
    """Raises RecordingError if a time is split over two columns."""
    names = _columns_of(dataset_at(file, table.path) if table.records else group_at(file, table.path))

    def read(place: int) -> NDArray:
        return replace(table, names=(names[place],) * len(_COLUMNS)).read(file, 0, _SAMPLE_ROWS).t

    try:
        refuse_split_time(names, names.index(table.names[0]), read, path)
    except UNREADABLE as error:
        raise RecordingError("the events cannot be read", got=explain(error), where=path) from error


def _unit_of_dsec(marks: h5py.Dataset, times: h5py.Dataset) -> str | None:
    """Microseconds unless the index says otherwise; what cannot be read yet says nothing."""
    with suppress(ImportError):
        importlib.import_module("hdf5plugin")
    try:
        return unit_by_index(marks, times)
    except UNREADABLE:
        return "us"


def _stated_unit(holders: list[h5py.Group | h5py.Dataset]) -> str | None:
    """The unit of the times that an attribute, or a dataset of one word, states."""
    for holder in holders:
        for name in UNIT_KEYS:
            value = np.asarray(holder.attrs.get(name, _word_in(holder, name))).reshape(-1)
            word = value[0].decode("latin-1") if value.size and isinstance(value[0], bytes) else str(*value[:1])
            unit = time_unit(word)
            if unit is None and word.strip() and (holder is holders[0] or "time" in name):
                return word.strip()  # of the times, and none that is known: refused by this name
            if unit is not None:
                return unit
    return None


def _word_in(holder: h5py.Group | h5py.Dataset, name: str) -> object:
    word = holder.get(name) if isinstance(holder, h5py.Group) else None
    return word[()] if isinstance(word, h5py.Dataset) and word.shape in ((), (1,)) else ""


def _open_rows(path: Path, file: h5py.File, sensor: SensorSize | None) -> EventSource:
    """The rows of /events, four numbers each: v2e's t, x, y, polarity unless the values say otherwise."""
    events = dataset_at(file, "events")
    upright = events.ndim == 2 and events.shape[0] == 4 != events.shape[1]
    if events.ndim != 2 or 4 not in events.shape or events.dtype.kind not in "iuf":
        got = f"{events.dtype}{events.shape}"
        raise RecordingError(
            "/events holds no rows of events", expected="numbers (N, 4): t, x, y, p", got=got, where=path
        )
    count = events.shape[1] if upright else len(events)
    frames = file.get("frame")
    if sensor is None and isinstance(frames, h5py.Dataset) and frames.ndim == 3:
        sensor = SensorSize(int(frames.shape[2]), int(frames.shape[1]))
    sensor = sensor or size_in_attributes(dict(events.attrs)) or size_in_attributes(dict(file.attrs))
    with suppress(ImportError):
        importlib.import_module("hdf5plugin")
    try:
        sample = events[:, :_SAMPLE_ROWS].T if upright else events[:_SAMPLE_ROWS]
        order = guess_columns(sample, where=f"{path}, /events")
    except RecordingError:  # a few rows, or times that do not tell: then it is as v2e writes it
        order = _V2E_ORDER
    except UNREADABLE as error:
        raise RecordingError("the events cannot be read", got=explain(error), where=path) from error
    places = order.places

    def rows(file: h5py.File, first: int, last: int) -> RawColumns:
        events = dataset_at(file, "events")
        part = events[:, first:last] if upright else np.asarray(events[first:last]).T
        return RawColumns(*(part[places[name]] for name in _COLUMNS))

    label = "v2e HDF5" if order.places == _V2E_ORDER.places else "HDF5 of rows"
    return make_table_source(
        path, "camera", label, sensor, lambda report: read_in_parts(path, rows, count, report),
        assumed=(f"{path.name}: the columns of /events are taken for {order.text}.",),
    )  # fmt: skip


def _open_mvsec(path: Path, davis: h5py.Group, sensor: SensorSize | None) -> list[EventSource]:
    sources: list[EventSource] = []
    for side in ("left", "right"):
        if f"{side}/events" not in davis:
            continue
        dataset = dataset_at(group_at(davis, side), "events")
        if dataset.ndim != 2 or dataset.shape[1] != 4:
            raise RecordingError("not MVSEC events", expected="rows of 4", got=dataset.shape, where=path)

        # Defaults bind what the loop changes.
        def rows(file: h5py.File, first: int, last: int, side: str = side) -> RawColumns:
            x, y, t, p = np.asarray(dataset_at(group_at(file, f"davis/{side}"), "events")[first:last]).T
            return RawColumns(t, x, y, p)

        count, size = len(dataset), sensor or _MVSEC_SENSOR
        sources.append(
            make_table_source(
                path,
                side,
                "MVSEC HDF5",
                size,
                lambda report, rows=rows, count=count: read_in_parts(path, rows, count, report),
                unit="s",
                unit_from=FactOrigin.FORMAT,
                sensor_from=FactOrigin.FILE if sensor is not None else FactOrigin.DATA_SET,
            )
        )
    if not sources:
        raise RecordingError("the MVSEC file holds no events", where=path)
    return sources


def _stated_sensor(holders: list[h5py.Group | h5py.Dataset], largest: tuple[int, int] | None) -> SensorSize | None:
    """From attributes of the file, of the group or of the dataset, or from datasets of their names."""
    for item in holders:
        found = size_in_attributes(dict(item.attrs), largest)
        if found is None and isinstance(item, h5py.Group):
            small = {
                name: child for name, child in item.items() if isinstance(child, h5py.Dataset) and child.size in (1, 2)
            }
            found = size_in_attributes({str(name): child[()] for name, child in small.items()}, largest)
        if found is not None:
            return found
    return None
