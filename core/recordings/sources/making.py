"""Sources from decoders and from tables; where the file does not name its sensor size, one is assumed and said."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.foreign_tables import allowed_odd
from core.recordings.sources.checking import check_stream, check_table
from core.recordings.sources.source import (
    BINARY_FACTS,
    Columns,
    DecodeReport,
    EventSource,
    Fact,
    FactOrigin,
    RawColumns,
)
from core.recordings.sources.table_columns import addresses_from_column
from core.recordings.sources.values.assumed_sizes import AddressCounts
from core.recordings.sources.values.table_values import (
    TableInterpretation,
    TableSummary,
    interpret_table,
    summarise_table,
)


class Check(Protocol):
    """A check of a source: `check_stream` or `check_table`."""

    def __call__(
        self, parts: Iterable[Columns], sensor: SensorSize, report: DecodeReport, *, where: str
    ) -> Iterator[Events]: ...


def make_source(
    path: Path,
    name: str,
    label: str,
    sensor: SensorSize | None,
    decode: Callable[[DecodeReport], Iterator[Columns]],
    check: Check = check_stream,
    *,
    sensor_from: FactOrigin = FactOrigin.FILE,
    facts: Mapping[str, Fact] = BINARY_FACTS,
) -> EventSource:
    """One camera of a file, its events checked: what cannot be true is left out and counted, the rest is kept.

    Args:
        path: The file, named in notes.
        name: What the file calls the camera, or "camera".
        label: What the format is called.
        sensor: Its size; None: assumed from all addresses, for which the file is decoded once more.
        decode: Finds the columns, part by part, times in microseconds.
        check: Of a binary stream, or of a table.
        sensor_from: Where `sensor` is from.
        facts: What the format defines of its values.
    """
    size = sensor or _assume_sensor(decode(DecodeReport()))
    origin = FactOrigin.ASSUMED if sensor is None else sensor_from

    def read(report: DecodeReport) -> Iterator[Events]:
        _note_size(report, path, size, origin, label)
        return check(decode(report), size, report, where=path.name)

    return EventSource(name, label, size, read, sensor_from=origin, facts=facts)


def make_table_source(
    path: Path,
    name: str,
    label: str,
    sensor: SensorSize | None,
    rows: Callable[[DecodeReport], Iterator[RawColumns]],
    *,
    unit: str | None = None,
    shift_us: int = 0,
    unit_from: FactOrigin = FactOrigin.FILE,
    seen: TableSummary | None = None,
    sensor_from: FactOrigin = FactOrigin.FILE,
    assumed: tuple[str, ...] = (),
    remarks: tuple[str, ...] = (),
) -> EventSource:
    """The camera `name` of a table, whose values are looked at as a whole before they are read.

    `unit` is the unit of time that the file or its format states, `shift_us` is added to its times, `seen` what all
    `rows` have in common if that is known already, `assumed` what was taken for granted on opening it, `remarks` are
    other notes.
    """
    known = [] if seen is None else [seen]

    def look() -> TableSummary:
        # A pass over the whole file: once, and only when something is to be inferred.
        if not known:
            known.append(summarise_table(rows(DecodeReport())))
        return known[0]

    size = sensor or look().addresses.usual_sensor()
    origin = FactOrigin.ASSUMED if sensor is None else sensor_from

    def decode(report: DecodeReport, meaning: TableInterpretation) -> Iterator[Columns]:
        odd, total = 0, 0
        for part in rows(report):
            columns, left_out = meaning.columns(part)
            odd, total = odd + left_out, total + len(part.t)
            yield columns
        if odd > allowed_odd(total):
            what = f"{odd:,} of {total:,} events have a time or a polarity that is none"
            raise RecordingError(what, where=path, remedy="check the columns of the file")
        note = f"{path.name}: {odd:,} events were left out: their times or polarities are no such."
        report.leave_out("odd values", odd, note)

    def read(report: DecodeReport) -> Iterator[Events]:
        _note_size(report, path, size, origin, label)
        if look().addresses.are_turned(size):
            column, row = look().addresses.largest
            raise RecordingError(
                "width and height of the sensor are exchanged",
                expected=f"{size.height_px}x{size.width_px}, which holds all addresses up to {column}, {row}",
                got=str(size),
                where=path,
                remedy="give --width and --height",
            )
        _refuse_bytes(look(), size, path)
        if origin != FactOrigin.ASSUMED and look().addresses.may_count_from_1(size):
            column, row = look().addresses.largest
            report.assume(f"{path.name}: no address is 0, the last ones are {column}, {row}; do they count from 1?")
        if origin == FactOrigin.ASSUMED and (filled := look().addresses.filled_from_1) is not None:
            text = "no address is 0; they may count from 1"
            report.assume(f"{path.name}: {text}: then they are those of a {filled} sensor (--width, --height).")
        for note in assumed:
            report.assume(note)
        if assumed and origin == FactOrigin.ASSUMED and (turned := look().addresses.filled_by_turned) is not None:
            column, row = look().addresses.largest
            text = f"the addresses go up to {column}, {row}, which fills a {turned} sensor if y stands before x"
            report.assume(f"{path.name}: {text}; then name the columns.")
        report.notes.extend(remarks)
        meaning = interpret_table(look(), unit, report, where=path.name, unit_from=unit_from)
        lengths = meaning.clock_lengths_us
        events = check_table(decode(report, meaning), size, report, where=path.name, clock_lengths_us=lengths)
        return (_shifted(part, shift_us) for part in events) if shift_us else events

    return EventSource(name, label, size, read, sensor_from=origin)


def _refuse_bytes(seen: TableSummary, size: SensorSize, path: Path) -> None:
    """Raise RecordingError if addresses in 8 bits, which begin again at 0 after 255, are of a larger sensor."""
    largest = np.iinfo(np.uint8).max
    column, row = seen.addresses.largest
    for name, narrow, found, side in (
        ("x", seen.bytes_x, column, size.width_px),
        ("y", seen.bytes_y, row, size.height_px),
    ):
        if narrow and found == largest < side - 1:
            raise RecordingError(
                f"{name} is stored in 8 bits, which cannot hold the addresses of the {size} sensor",
                got=f"0 to {largest}",
                where=path,
                remedy="write x and y in 16 bits, or give the size of the part that was stored (--width, --height)",
            )


def _note_size(report: DecodeReport, path: Path, size: SensorSize, origin: FactOrigin, label: str) -> None:
    """Say of a sensor size that the file does not state why it is taken, and of an upright one that it is one."""
    if origin == FactOrigin.FILE and size.height_px > size.width_px:
        report.assume(f"{path.name} states a sensor that is higher than wide, {size}; see --width and --height.")
    if origin == FactOrigin.ASSUMED:
        report.assume(f"{path.name} does not name its sensor size; {size} is assumed from the events.")
    elif origin == FactOrigin.DATA_SET:
        report.assume(f"{path.name} does not name its sensor size; {size} is assumed, that of {label}.")


def _shifted(part: Events, shift_us: int) -> Events:
    """The events on another clock: a clock that began again has been put right before."""
    return Events.from_columns(part.t_us + shift_us, part.x_px, part.y_px, part.on, part.sensor)


def _assume_sensor(parts: Iterable[Columns]) -> SensorSize:
    """The sensor that the addresses of all events tell."""
    addresses = AddressCounts()
    for part in parts:
        addresses.add(addresses_from_column(part.x_px), addresses_from_column(part.y_px))
    return addresses.usual_sensor()
