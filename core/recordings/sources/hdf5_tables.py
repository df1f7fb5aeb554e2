"""HDF5 layouts of datasets: DSEC, MVSEC, and the two spellings used for training networks.

/events/{x, y, t, p}, /t_offset                  DSEC: t in us, absolute = t + t_offset
/davis/{left, right}/events                      MVSEC: rows of x, y, t in s, polarity -1 or 1
/events/{xs, ys, ts, ps}, sensor_resolution      ts in s if they are floats, else in us
/raw_events/{x, y, t, p}                         likewise
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.hdf5 import dataset_at, group_at
from core.recordings.sources.checking import check_table
from core.recordings.sources.hdf5_errors import UNREADABLE, explain
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource
from core.recordings.sources.table_columns import addresses_from_column, times_us

_ROWS: Final = 1 << 18
_DSEC_SENSOR: Final = SensorSize(640, 480)
_MVSEC_SENSOR: Final = SensorSize(346, 260)

Rows = Callable[[h5py.File, int, int], Columns]
"""Reads rows first to last - 1."""


def open_hdf5_table(path: Path, sensor: SensorSize | None) -> list[EventSource] | None:
    """The cameras of the file if it has one of these layouts, else None.

    Raises:
        RecordingError: if the columns do not fit together.
    """
    with h5py.File(path, "r") as file:
        if "davis" in file:
            return _open_mvsec(path, group_at(file, "davis"), sensor)
        for group, names, label in (
            ("events", ("t", "x", "y", "p"), "DSEC HDF5"),
            ("events", ("ts", "xs", "ys", "ps"), "HDF5 of xs, ys, ts, ps"),
            ("raw_events", ("t", "x", "y", "p"), "HDF5 of raw_events"),
        ):
            if all(f"{group}/{name}" in file for name in names):
                return [_open_columns(path, file, group, names, label, sensor)]
    return None


def _open_columns(
    path: Path, file: h5py.File, group: str, names: tuple[str, ...], label: str, sensor: SensorSize | None
) -> EventSource:
    lengths = {name: len(dataset_at(group_at(file, group), name)) for name in names}
    if len(set(lengths.values())) != 1:
        raise RecordingError("event columns differ in length", expected="equal lengths", got=lengths, where=path)
    offset_us = int(np.asarray(dataset_at(file, "t_offset")[()]).reshape(-1)[0]) if "t_offset" in file else 0

    def rows(file: h5py.File, first: int, last: int) -> Columns:
        t, x, y, p = (dataset_at(group_at(file, group), name)[first:last] for name in names)
        return Columns(times_us(t) + offset_us, addresses_from_column(x), addresses_from_column(y), p > 0)

    count = lengths[names[0]]
    stated = _stated_sensor(file, group)
    if stated is None and label.startswith("DSEC") and "ms_to_idx" in file:
        stated = _DSEC_SENSOR
    return _source(path, "camera", label, sensor or stated, rows, count)


def _open_mvsec(path: Path, davis: h5py.Group, sensor: SensorSize | None) -> list[EventSource]:
    sources: list[EventSource] = []
    for side in ("left", "right"):
        if f"{side}/events" not in davis:
            continue
        dataset = dataset_at(group_at(davis, side), "events")
        if dataset.ndim != 2 or dataset.shape[1] != 4:
            raise RecordingError("not MVSEC events", expected="rows of 4", got=dataset.shape, where=path)

        def rows(file: h5py.File, first: int, last: int, side: str = side) -> Columns:
            x, y, t, p = np.asarray(dataset_at(group_at(file, f"davis/{side}"), "events")[first:last]).T
            return Columns(times_us(t), addresses_from_column(x), addresses_from_column(y), p > 0)

        sources.append(_source(path, side, "MVSEC HDF5", sensor or _MVSEC_SENSOR, rows, len(dataset)))
    if not sources:
        raise RecordingError("the MVSEC file holds no events", where=path)
    return sources


def _stated_sensor(file: h5py.File, group: str) -> SensorSize | None:
    """From attributes width and height, or sensor_resolution, which lists the height first."""
    for item in (file, group_at(file, group)):
        if "width" in item.attrs and "height" in item.attrs:
            return SensorSize(int(item.attrs["width"]), int(item.attrs["height"]))  # pyright: ignore[reportArgumentType]
        if "sensor_resolution" in item.attrs:
            height, width = (int(value) for value in np.asarray(item.attrs["sensor_resolution"]).reshape(-1)[:2])
            return SensorSize(max(width, height), min(width, height))
    return None


def _source(path: Path, name: str, label: str, sensor: SensorSize | None, rows: Rows, count: int) -> EventSource:
    return make_source(path, name, label, sensor, lambda report: _decode(path, rows, count, report), check_table)


def _decode(path: Path, rows: Rows, count: int, report: DecodeReport) -> Iterator[Columns]:
    _load_filters()
    first = 0
    with h5py.File(path, "r") as file:
        while first < count:
            try:
                part = rows(file, first, min(first + _ROWS, count))
            except UNREADABLE as error:
                if not first:
                    raise RecordingError("the events cannot be read", got=explain(error), where=path) from error
                report.notes.append(f"{path.name}: stopped at event {first:,} of {count:,}: {explain(error)}.")
                return
            yield part
            first += len(part.t_us)
            report.share = first / count


def _load_filters() -> None:
    """DSEC files are packed with blosc; the plug-in for it is optional."""
    try:
        importlib.import_module("hdf5plugin")
    except ImportError:
        return
