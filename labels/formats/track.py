"""A 2D track of another tool: a table with a time (or the step to the row before), x and y, perhaps a radius.

`t_us,x,y` or any usual spelling of the columns; `dt` counts from the row before, the first from 0; a column `frame` has
its times in `--frame-times`. A time without a unit is in us if all are whole numbers, else in s, and a note says so.
Rows without a position are passed over: nobody says that there was no ball.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import LabelError
from labels.formats.exchange import (
    HALF_PIXEL,
    Collector,
    ImportContext,
    finite,
    whole_number,
)
from labels.model import LabelState

_TIMES: Final = re.compile(r"(t|dt|time|timestamp|ts|delta_?t)(?:[ _\[(]*(us|ms|ns|s)[\])]?)?")
_FRAMES: Final = ("frame", "frame_id", "frame_number", "frame_index", "frameid")
_X: Final = ("x", "x_px", "u", "cx", "x_center", "px")
_Y: Final = ("y", "y_px", "v", "cy", "y_center", "py")
_RADIUS: Final = ("r", "r_px", "radius", "radius_px")
_UNITS_US: Final = {"us": 1.0, "ms": 1e3, "s": 1e6, "ns": 1e-3}
_NO_PLACE: Final = frozenset({"", "nan", "none", "null", "na"})


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


def track_columns(header: list[str]) -> TrackColumns | None:
    """The columns of a track by its names in small letters; None if it is none."""
    x, y, radius, frame = (
        next((header.index(name) for name in names if name in header), None) for names in (_X, _Y, _RADIUS, _FRAMES)
    )
    if x is None or y is None:
        return None
    found = [(place, match) for place, name in enumerate(header) if (match := _TIMES.fullmatch(name))]
    if len(found) == 1:
        ((place, match),) = found
        return TrackColumns(len(header), place, match[2], match[1].startswith("d"), False, x, y, radius)
    return None if frame is None or found else TrackColumns(len(header), frame, None, False, True, x, y, radius)


def read_track(
    rows: list[tuple[int, list[str]]], columns: TrackColumns, file: Path, context: ImportContext, collector: Collector
) -> None:
    """Add a label for each row with a position."""
    unit = columns.unit or _likely_unit(rows, columns)
    if columns.unit is None and not columns.frames and rows:
        collector.note(f"{file.name} does not name the unit of its times: {unit} is assumed")
    across, down = context.stated_factors
    now = 0.0
    for line, fields in rows:
        with collector.entry(file, line):
            if len(fields) != columns.count:
                raise LabelError("wrong number of fields", expected=columns.count, got=len(fields))
            time = finite(fields[columns.time], "the time")
            if columns.steps and time < 0:
                raise LabelError("a step back in time", got=time)
            now = now + time if columns.steps else time
            places = fields[columns.x].strip(), fields[columns.y].strip()
            if {place.lower() for place in places} & _NO_PLACE:
                continue
            if columns.frames:
                t_us = context.time_of_frame(whole_number(fields[columns.time], "the frame"))
            else:
                t_us = round(now * _UNITS_US[unit])
            x, y = (
                (finite(place, "a coordinate") + HALF_PIXEL) * factor - HALF_PIXEL
                for place, factor in zip(places, (across, down), strict=True)
            )
            text = "" if columns.radius is None else fields[columns.radius].strip()
            radius = None if text.lower() in _NO_PLACE else finite(text, "the radius") * (across + down) / 2
            collector.add(context.ball(t_us, LabelState.VISIBLE, x, y, radius), file, line)


def _likely_unit(rows: list[tuple[int, list[str]]], columns: TrackColumns) -> str:
    """Microseconds where all times are whole numbers, else seconds."""
    texts = [fields[columns.time].strip() for _, fields in rows if len(fields) == columns.count]
    return "us" if all(re.fullmatch(r"[-+]?\d+(\.0*)?", text) for text in texts) else "s"
