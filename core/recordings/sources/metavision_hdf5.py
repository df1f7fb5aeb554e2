"""Metavision's HDF5 layout: records in /CD/events and /EXT_TRIGGER/events, usually packed with ECF."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.hdf5 import dataset_at, group_at
from core.recordings.sources.checking import check_stream
from core.recordings.sources.ecf import decode_ecf
from core.recordings.sources.hdf5_reading import UNREADABLE, explain
from core.recordings.sources.making import make_source
from core.recordings.sources.source import (
    BINARY_FACTS,
    MICROSECONDS,
    TIME_UNIT,
    Columns,
    DecodeReport,
    EventSource,
    FactOrigin,
    RawColumns,
)
from core.recordings.sources.values.stated_sizes import size_in_attributes
from core.recordings.sources.values.table_values import interpret_table, summarise_table

_ECF_FILTER: Final = 0x8ECF
"""Prophesee's filter in HDF5, number 36559; h5py has no decoder for it, `ecf` has."""
_ROWS: Final = 1 << 18


def open_metavision_hdf5(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file.

    Raises:
        RecordingError: if /CD/events does not hold records of x, y, p, t.
    """
    with h5py.File(path, "r") as file:
        events = dataset_at(group_at(file, "CD"), "events")
        if not {"x", "y", "p", "t"} <= set(events.dtype.names or ()):
            raise RecordingError("/CD/events has other fields", expected="x, y, p, t", got=events.dtype, where=path)
        packed = _is_ecf(events)
        sensor = sensor or size_in_attributes(dict(file.attrs))
    name = "Metavision HDF5, ECF" if packed else "Metavision HDF5"
    facts = BINARY_FACTS if packed else {TIME_UNIT: MICROSECONDS}
    return [make_source(path, "camera", name, sensor, lambda report: _decode(path, report), check_stream, facts=facts)]


def _decode(path: Path, report: DecodeReport) -> Iterator[Columns]:
    with h5py.File(path, "r") as file:
        done, total = 0, 1
        try:
            if "EXT_TRIGGER" in file:
                _read_triggers(dataset_at(group_at(file, "EXT_TRIGGER"), "events"), report)
            events = dataset_at(group_at(file, "CD"), "events")
            total = max(1, len(events))
            for columns in _ecf_chunks(events) if _is_ecf(events) else _records(events, path, report):
                yield columns
                done += len(columns.t_us)
                report.share = done / total
        except UNREADABLE as error:
            report.notes.append(f"{path.name}: stopped at event {done:,} of {total:,}: {explain(error)}.")


def _is_ecf(dataset: h5py.Dataset) -> bool:
    plan = dataset.id.get_create_plist()
    return any(plan.get_filter(i)[0] == _ECF_FILTER for i in range(plan.get_nfilters()))


def _ecf_chunks(dataset: h5py.Dataset) -> Iterator[Columns]:
    assert dataset.chunks is not None  # only chunked datasets have filters
    length = dataset.chunks[0]
    for start in range(0, len(dataset), length):
        skipped_filters, chunk = dataset.id.read_direct_chunk((start,))
        if skipped_filters:  # HDF5 stores a chunk plain when its filter failed
            records = np.frombuffer(chunk, dataset.dtype)
            yield _columns(records[: len(dataset) - start])
        else:
            columns = decode_ecf(chunk)
            expected = min(length, len(dataset) - start)
            if len(columns.t_us) < expected:
                raise ValueError(f"a chunk holds {len(columns.t_us)} events, expected {expected}")
            yield Columns(*(column[:expected] for column in columns))


def _records(dataset: h5py.Dataset, path: Path, report: DecodeReport) -> Iterator[Columns]:
    """Records as another tool may have written them: what their polarities mean is looked at first."""
    meaning = interpret_table(
        summarise_table(_raw(dataset)), "us", report, where=path.name, unit_from=FactOrigin.FORMAT
    )
    odd = 0
    for part in _raw(dataset):
        columns, left_out = meaning.columns(part)
        odd += left_out
        yield columns
    report.leave_out("odd values", odd, f"{path.name}: {odd:,} events were left out: their polarities are no such.")


def _raw(dataset: h5py.Dataset) -> Iterator[RawColumns]:
    for start in range(0, len(dataset), _ROWS):
        records = dataset[start : start + _ROWS]
        yield RawColumns(*(records[name] for name in ("t", "x", "y", "p")))


def _columns(records: NDArray) -> Columns:
    return Columns(records["t"].astype(np.int64), records["x"], records["y"], records["p"] > 0)


def _read_triggers(dataset: h5py.Dataset, report: DecodeReport) -> None:
    if not len(dataset) or not {"p", "t", "id"} <= set(dataset.dtype.names or ()):
        return
    try:
        records = dataset[()]
    except UNREADABLE as error:
        report.notes.append(f"The external triggers cannot be read: {explain(error)}.")
        return
    report.add_triggers(records["t"], records["p"] > 0, records["id"])
