"""Which column of a table is which, and the unit of time that its name states."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.foreign_tables import CAMERA_NAMES, UNITS_US, spelled, without_unit

_NAMES: Final = {
    "t": (
        "t", "ts", "time", "times", "timestamp", "timestamps", "stamp", "time_stamp", "event_time", "event_timestamp",
        "t_event", "device_timestamp",
    ),
    "x": (
        "x", "xs", "x_px", "x_pos", "col", "column", "cols", "x_coordinate", "x_addr", "addr_x", "pixel_x", "pos_x",
        "coord_x", "x_coord", "event_x", "u",
    ),
    "y": (
        "y", "ys", "y_px", "y_pos", "row", "rows", "y_coordinate", "y_addr", "addr_y", "pixel_y", "pos_y", "coord_y",
        "y_coord", "event_y", "v",
    ),
    "p": ("p", "ps", "pol", "pols", "polarity", "polarities", "on", "sign", "is_on", "on_off", "event_polarity"),
}  # fmt: skip
"""Usual spellings; that of a time may end with its unit."""
_AT_SIZE: Final = re.compile(r"([xy])@([0-9]{1,5})")


def addresses_from_column(column: NDArray) -> NDArray[np.int64]:
    """The nearest pixel addresses; -1, which is on no sensor, for what is no number."""
    if column.dtype.kind == "f":
        column = column.astype(np.float64)  # 2**31 is beyond float16
        column = np.rint(np.where(np.abs(column) < 2**31, column, -1))
    return column.astype(np.int64)


def has_fractions(column: NDArray) -> bool:
    """Whether there are numbers that are not whole."""
    if column.dtype.kind != "f":
        return False
    finite = column[np.isfinite(column)]
    return bool((finite != np.rint(finite)).any())


def find_columns(names: Sequence[str], *, where: str) -> dict[str, int]:
    """Positions of t, x, y and p among column names, whatever their usual spelling.

    Raises:
        RecordingError: if one is missing.
    """
    plain = [_spelled(name) for name in names]
    times = [without_unit(name)[0] for name in plain]
    found: dict[str, int] = {}
    for column, spellings in _NAMES.items():
        own = times if column == "t" else plain
        position = next((own.index(name) for name in spellings if name in own), None)
        if position is None:
            raise RecordingError(
                f"no column for {column}", expected=f"one of {', '.join(spellings)}", got=", ".join(names), where=where
            )
        found[column] = position
    return found


def camera_column(names: Sequence[str]) -> int | None:
    """Position of the column that says which camera an event is of; None if there is none."""
    return next((place for place, name in enumerate(names) if _spelled(name) in CAMERA_NAMES), None)


def refuse_several_cameras(cameras: Iterable[object], where: object) -> None:
    """Raise RecordingError if the different values of such a column are more than one: their events would be mixed."""
    found = sorted(map(str, cameras))
    if len(found) > 1:
        raise RecordingError(
            "the table holds the events of several cameras",
            expected="one value in the column that says which camera it is",
            got=", ".join(found[:8]),
            where=where,
            remedy="write the events of each camera into a file of its own, and import them together",
        )


def refuse_split_time(names: Sequence[str], times: int, read: Callable[[int], NDArray], where: object) -> None:
    """Raise RecordingError if seconds and what is beyond them stand in two columns, as ROS writes its times.

    One column alone would put all events of a second at one time. A time that is given twice, in two units, passes.

    Args:
        names: of all columns.
        times: position of the one that is taken for the times.
        read: gives the first values of the column at a position.
        where: what the error names.
    """
    stem = without_unit(_spelled(names[times]))[0]
    places = [place for place, name in enumerate(names) if without_unit(_spelled(name))[0] == stem]
    units_us = {place: UNITS_US[unit] for place in places if (unit := unit_of_name(names[place])) is not None}
    if len(set(units_us.values())) != 2:
        return
    whole, rest = max(units_us, key=units_us.__getitem__), min(units_us, key=units_us.__getitem__)
    in_one = round(units_us[whole] / units_us[rest])
    wholes, rests = (read(place).astype(np.float64) for place in (whole, rest))
    if len(wholes) == len(rests) > 0 and not has_fractions(wholes) and bool(((rests >= 0) & (rests < in_one)).all()):
        raise RecordingError(
            "the times are split over two columns",
            expected="one column of times",
            got=f"whole numbers in {names[whole]}, the rest in {names[rest]}",
            where=where,
            remedy=f"write one column of both, named with its unit: {in_one} * {names[whole]} + {names[rest]}",
        )


def unit_of_name(name: str) -> str | None:
    """Unit of a time column (`ns`, `us`, `ms`, `s`) that its name states; None if it does not."""
    return without_unit(_spelled(name))[1]


def size_in_names(names: Sequence[str]) -> SensorSize | None:
    """The size of the sensor that faery writes behind the names of the addresses: `t,x@320,y@240,on`."""
    found = {match[1]: int(match[2]) for name in names if (match := _AT_SIZE.fullmatch(name.strip().lower()))}
    return SensorSize(found["x"], found["y"]) if found.keys() == {"x", "y"} and min(found.values()) > 0 else None


def _spelled(name: str) -> str:
    """A column's name as `spelled` gives it, without the size of the sensor that may stand behind it."""
    sized = _AT_SIZE.fullmatch(name.strip().lower())
    return spelled(name) if sized is None else sized[1]
