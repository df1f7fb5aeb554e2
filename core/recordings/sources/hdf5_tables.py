"""HDF5 layouts of datasets: DSEC, MVSEC, and the two spellings used for training networks.

/events/{x, y, t, p}, /t_offset                  DSEC: t in us, absolute = t + t_offset
/davis/{left, right}/events                      MVSEC: rows of x, y, t in s, polarity -1 or 1
/events/{xs, ys, ts, ps}, sensor_resolution      the unit of ts is told from its values
/raw_events/{x, y, t, p}                         likewise
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import h5py
import numpy as np

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.hdf5 import dataset_at, group_at
from core.recordings.sources.hdf5_reading import read_in_parts
from core.recordings.sources.making import make_table_source
from core.recordings.sources.source import DecodeReport, EventSource, RawColumns, Whence
from core.recordings.sources.table_columns import unit_of_name
from core.recordings.sources.values.stated_sizes import size_in_attributes
from core.recordings.sources.values.table_values import Survey, survey

_UNIT_WORDS: Final = {"seconds": "s", "milliseconds": "ms", "microseconds": "us", "nanoseconds": "ns", "µs": "us"}
_DSEC_SENSOR: Final = SensorSize(640, 480)
_MVSEC_SENSOR: Final = SensorSize(346, 260)


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

    def rows(file: h5py.File, first: int, last: int) -> RawColumns:
        t, x, y, p = (np.asarray(dataset_at(group_at(file, group), name)[first:last]).reshape(-1) for name in names)
        return RawColumns(t, x, y, p)

    count = lengths[names[0]]
    dsec = label.startswith("DSEC") and "ms_to_idx" in file
    unit, unit_from = unit_of_name(_unit_attribute(dataset_at(group_at(file, group), names[0]))), Whence.FILE
    if unit is None and dsec:
        unit, unit_from = "us", Whence.FORMAT
    seen: Survey | None = None
    if sensor is None and any("sensor_resolution" in item.attrs for item in (file, group_at(file, group))):
        seen = survey(read_in_parts(path, rows, count, DecodeReport()))
    sensor, sensor_from = sensor or _stated_sensor(file, group, seen), Whence.FILE
    if sensor is None and dsec and "t_offset" in file:
        sensor, sensor_from = _DSEC_SENSOR, Whence.DATA_SET
    return make_table_source(
        path, "camera", label, sensor, lambda report: read_in_parts(path, rows, count, report),
        unit=unit, unit_from=unit_from, shift_us=offset_us, seen=seen, sensor_from=sensor_from,
    )  # fmt: skip


def _unit_attribute(times: h5py.Dataset) -> str:
    """The unit that an attribute of the times states, as the end of a name; empty if there is none."""
    for name in ("unit", "units"):
        value = times.attrs.get(name)
        if value is not None:
            word = value.decode("latin-1") if isinstance(value, bytes) else str(value)
            return f"t_{_UNIT_WORDS.get(word.strip().lower(), word.strip())}"
    return ""


def _open_mvsec(path: Path, davis: h5py.Group, sensor: SensorSize | None) -> list[EventSource]:
    sources: list[EventSource] = []
    for side in ("left", "right"):
        if f"{side}/events" not in davis:
            continue
        dataset = dataset_at(group_at(davis, side), "events")
        if dataset.ndim != 2 or dataset.shape[1] != 4:
            raise RecordingError("not MVSEC events", expected="rows of 4", got=dataset.shape, where=path)

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
                unit_from=Whence.FORMAT,
                sensor_from=Whence.FILE if sensor is not None else Whence.DATA_SET,
            )
        )
    if not sources:
        raise RecordingError("the MVSEC file holds no events", where=path)
    return sources


def _stated_sensor(file: h5py.File, group: str, seen: Survey | None) -> SensorSize | None:
    """From attributes of the file or of the group, or from datasets of their names."""
    largest = None if seen is None else seen.largest
    for item in (file, group_at(file, group)):
        found = size_in_attributes(dict(item.attrs), largest)
        if found is None and "width" in item and "height" in item:
            found = size_in_attributes({side: dataset_at(item, side)[()] for side in ("width", "height")})
        if found is not None:
            return found
    return None
