"""Plain CSV: one row a label with everything it says, pixel centres at whole numbers, times in microseconds.

Contacts are in a table of their own beside it, `<camera>.contacts.csv`: time, kind, uncertainty, and who made them.

Read is also a 2D track of another tool: a table with a time (or the step to the row before), x and y, perhaps a radius.
`t_us,x,y` or any usual spelling of the columns; `dt` counts from the row before, the first from 0; a column `frame` has
its times in `--frame-times`. A time without a unit is in us if all are whole numbers, else in s, and a note says so.
Rows without a position are passed over: nobody says that there was no ball. So are those that a column `visible` or
`detected` calls none: their position is left from before. One at 0, 0 is rejected.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import LabelError
from core.files import file_stem
from core.foreign_tables import CAMERA_NAMES, NO_NUMBER, UNITS_US, several_values, split_unit
from core.text import counted
from labels.formats.deeplabcut import is_deeplabcut, read_deeplabcut
from labels.formats.exchange import (
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    add_rows,
    files_at,
    finite,
    read_text,
    table_rows,
    whole_number,
    write_text,
)
from labels.formats.flat import (
    COLUMNS,
    CONTACT_COLUMNS,
    REQUIRED,
    REQUIRED_OF_CONTACT,
    Value,
    contact_of_row,
    contact_row,
    flat_row,
    label_of_row,
)
from labels.formats.labelled_pictures import note_likely_size
from labels.model import Label, LabelState

_TIMES: Final = "t|dt|time|timestamp|ts|delta_?t"
_FRAMES: Final = ("frame", "frame_id", "frame_number", "frame_index", "frameid")
_X: Final = ("x", "x_px", "u", "cx", "x_center", "px")
_Y: Final = ("y", "y_px", "v", "cy", "y_center", "py")
_RADIUS: Final = ("r", "r_px", "radius", "radius_px")
_SEEN: Final = ("visible", "visibility", "is_visible", "detected", "is_detected", "found", "valid")
_UNSEEN: Final = ("0", "0.0", "false", "f", "no")
_WHOSE: Final = (*CAMERA_NAMES, "track_id", "object_id", "ball_id", "class_id")
"""Columns that tell apart what cannot be one track."""
_CENTRES: Final = ("cx", "x_center")
_SIDES: Final = (
    ("w", "h"), ("width", "height"), ("bb_width", "bb_height"), ("bbox_width", "bbox_height"), ("bbox_w", "bbox_h"),
    ("box_w", "box_h"), ("box_width", "box_height"), ("bw", "bh"), ("size_x", "size_y"),
)  # fmt: skip
_SHORTEST_STEP_US: Final = 100
"""Nobody labels a ball so often: by then it has moved by no more than a pixel."""


@dataclass(frozen=True, slots=True)
class TrackColumns:
    """Where a track has what."""

    count: int
    time: int
    unit: str | None
    steps: bool
    """Whether times count from the row before."""
    frames: bool
    x: int
    y: int
    radius: int | None
    seen: int | None
    """Whether there is a ball at all."""


def track_columns(header: list[str]) -> TrackColumns | None:
    """The columns of a track by its names in small letters; None if it is none."""
    x, y, radius, frame, seen = (
        next((header.index(name) for name in names if name in header), None)
        for names in (_X, _Y, _RADIUS, _FRAMES, _SEEN)
    )
    if x is None or y is None:
        return None
    found = [(at, times) for at, name in enumerate(header) if (times := split_unit(name, _TIMES, joined=True))]
    if len(found) == 1:
        ((place, (stem, unit)),) = found
        return TrackColumns(len(header), place, unit, stem.startswith("d"), False, x, y, radius, seen)
    return None if frame is None or found else TrackColumns(len(header), frame, None, False, True, x, y, radius, seen)


def read_track(
    rows: list[tuple[int, list[str]]], columns: TrackColumns, file: Path, context: ImportContext, collector: Collector
) -> None:
    """Add a label for each row with a position."""
    unit = columns.unit or _likely_unit(rows, columns)
    if columns.unit is None and not columns.frames and _are_too_close(rows, columns, unit):
        what = f"the unit of the times cannot be told: as {unit} they are less than {_SHORTEST_STEP_US} us apart"
        collector.reject(file, 1, f"{what}; name their column after it: t_us, t_ms or t_s")
        return
    if columns.unit is None and not columns.frames and rows:
        collector.note(f"{file.name} does not name the unit of its times: {unit} is assumed")
    across, down = context.stated_factors
    now, unseen = 0.0, 0
    seen: list[tuple[float, float]] = []

    def label_of(fields: list[str]) -> Label | None:
        nonlocal now, unseen
        time = finite(fields[columns.time], "the time")
        if columns.steps and time < 0:
            raise LabelError("a step back in time", got=time)
        now = now + time if columns.steps else time
        places = fields[columns.x].strip(), fields[columns.y].strip()
        if {place.lower() for place in places} & NO_NUMBER:
            return None
        if columns.seen is not None and fields[columns.seen].strip().lower() in _UNSEEN:
            unseen += 1
            return None
        if columns.frames:
            t_us = context.time_of_frame(whole_number(fields[columns.time], "the frame"))
        else:
            t_us = round(now * UNITS_US[unit])
        read = finite(places[0], "a coordinate"), finite(places[1], "a coordinate")
        if not any(read):  # as TrackNet and many trackers write where they found nothing
            raise LabelError("a ball in the very corner of the picture: 0, 0 stands for no position")
        seen.append(read)
        # A picture is scaled about its corner.
        x, y = ((place + HALF_PIXEL) * factor - HALF_PIXEL for place, factor in zip(read, (across, down), strict=True))
        text = "" if columns.radius is None else fields[columns.radius].strip()
        radius = None if text.lower() in NO_NUMBER else finite(text, "the radius") * (across + down) / 2
        return context.ball(t_us, LabelState.VISIBLE, x, y, radius)

    add_rows(rows, columns.count, file, collector, label_of)
    if unseen:
        collector.note(f"{file.name}: {counted(unseen, 'row')} left out: a column says that there is no ball")
    note_likely_size(seen, context, collector)


def _likely_unit(rows: list[tuple[int, list[str]]], columns: TrackColumns) -> str:
    """Microseconds where all times are whole numbers, else seconds."""
    texts = [fields[columns.time].strip() for _, fields in rows if len(fields) == columns.count]
    return "us" if all(re.fullmatch(r"[-+]?\d+(\.0*)?", text) for text in texts) else "s"


def _are_boxes(
    header: list[str], rows: list[tuple[int, list[str]]], columns: TrackColumns, context: ImportContext
) -> bool:
    """Whether x and y stand beside the sides of a box, and do not say that they are its centre."""
    sides = next((pair for pair in _SIDES if {*pair} <= {*header}), None)
    if sides is None or header[columns.x] in _CENTRES:
        return False
    at = header.index(sides[0])
    widths = [text for _, fields in rows if len(fields) == columns.count and (text := fields[at].strip())]
    # Columns of such names may also hold the size of the picture.
    return any(re.fullmatch(r"\d+(\.\d*)?", text) and float(text) < context.sensor.width_px / 2 for text in widths)


def _are_too_close(rows: list[tuple[int, list[str]]], columns: TrackColumns, unit: str) -> bool:
    """Whether whole numbers, taken for microseconds, follow each other faster than anybody labels: milliseconds do."""
    if unit != "us" or len(rows) < 3:
        return False
    times = [float(text) for _, fields in rows if len(fields) == columns.count and (text := fields[columns.time])]
    steps = sorted(times) if columns.steps else sorted(abs(b - a) for a, b in itertools.pairwise(times))
    return bool(steps) and 0 < steps[len(steps) // 2] < _SHORTEST_STEP_US


def write_csv(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`<camera>.csv` in the folder, and `<camera>.contacts.csv` if there are contacts."""
    stem = file_stem(labels.camera)
    files = [write_text(folder / f"{stem}.csv", _table(list(COLUMNS), map(flat_row, labels.labels)))]
    if labels.contacts:
        text = _table(list(CONTACT_COLUMNS), map(contact_row, labels.contacts))
        files.append(write_text(folder / f"{stem}.contacts.csv", text))
    return Exported(tuple(files), ())


def _table(columns: list[str], rows: Iterable[dict[str, Value]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: "" if value is None else value for name, value in row.items()})
    return text.getvalue()


def read_csv(path: Path, context: ImportContext) -> Imported:
    """Every CSV file of a folder, or one. Columns are found by their names; unknown ones are refused.

    A table without states is a 2D track of another tool if it has the columns of one.
    """
    collector = Collector()
    cameras = {file_stem(name): name for name in context.other_cameras}
    for file in files_at(path, ".csv", collector):
        if not collector.is_of(context, file, cameras.get(file.stem.removesuffix(".contacts"))):
            continue
        text = read_text(file, collector)
        if text is not None:
            _read_file(text, file, context, collector)
    return collector.done()


def _read_file(text: str, file: Path, context: ImportContext, collector: Collector) -> None:
    rows = table_rows(text, file, collector)
    _, names = next(rows, (1, []))
    header = [name.strip() for name in names]
    # Before names in other letters are made equal: DeepLabCut's are values.
    if is_deeplabcut(header):
        read_deeplabcut(header, rows, file, context, collector)
        return
    header = [name.lower() for name in header]
    if set(REQUIRED_OF_CONTACT) <= set(header) <= set(CONTACT_COLUMNS) and len(set(header)) == len(header):
        _read_contacts(rows, header, file, context, collector)
        return
    if "state" not in header and (columns := track_columns(header)) is not None:
        track = list(rows)
        if _are_boxes(header, track, columns, context):
            what = "x and y beside the sides of a box may be its corner: expected its centre, as cx, cy"
            collector.reject(file, 1, f"{what}, got {', '.join(header)[:200]}")
            return
        if several := several_values(header, (fields for _, fields in track), _WHOSE):
            collector.reject(file, 1, f"several tracks in one table: expected one value, got {several}; part the table")
            return
        read = {columns.time, columns.x, columns.y, columns.radius, columns.seen}
        if others := [name for at, name in enumerate(header) if at not in read and name]:
            collector.note(f"{file.name}: the columns {', '.join(others)} are not read")
        read_track(track, columns, file, context, collector)
        return
    unknown, missing = [name for name in header if name not in COLUMNS], set(REQUIRED) - set(header)
    if unknown or missing or len(set(header)) != len(header):
        found = ", ".join(header)[:200]
        collector.reject(file, 1, f"not a label table; expected columns {', '.join(REQUIRED)}, ..., got {found}")
        return

    def label_of(fields: list[str]) -> Label:
        return label_of_row(dict(zip(header, (field.strip() for field in fields), strict=True)), context.origin)

    add_rows(rows, len(header), file, collector, label_of)


def _read_contacts(
    rows: Iterable[tuple[int, list[str]]], header: list[str], file: Path, context: ImportContext, collector: Collector
) -> None:
    for line, fields in rows:
        with collector.entry(file, line):
            if len(fields) != len(header):
                raise LabelError("wrong number of fields", expected=len(header), got=len(fields))
            row = dict(zip(header, (field.strip() for field in fields), strict=True))
            collector.add_contact(contact_of_row(row, context.origin), file, line)
