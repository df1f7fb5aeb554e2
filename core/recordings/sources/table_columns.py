"""Which column of a table is which, and what its times count."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError

_NAMES: Final = {
    "t": (
        "t",
        "ts",
        "time",
        "times",
        "timestamp",
        "timestamps",
        "t_us",
        "time_us",
        "timestamp_us",
        "t_s",
        "time_s",
        "timestamp_s",
        "t_ms",
        "time_ms",
        "timestamp_ms",
        "t_ns",
        "time_ns",
        "timestamp_ns",
        "timestamps_us",
        "timestamps_ns",
        "stamp",
        "time_stamp",
    ),
    "x": ("x", "xs", "x_px", "x_pos", "col", "column", "x_coordinate"),
    "y": ("y", "ys", "y_px", "y_pos", "row", "y_coordinate"),
    "p": ("p", "ps", "pol", "polarity", "polarities", "on", "sign"),
}
_MICROSECONDS_PER_S: Final = 1e6


def times_us(t: NDArray, *, seconds: bool | None = None) -> NDArray[np.int64]:
    """Microseconds of a column of times: floats count seconds, integers microseconds, unless `seconds` says otherwise.

    Raises:
        ValueError: if a time is not finite or too large for 64 bits.
    """
    if t.dtype.kind != "f":
        return t.astype(np.int64) * (1_000_000 if seconds else 1)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = t.astype(np.float64) * (_MICROSECONDS_PER_S if seconds is None or seconds else 1.0)
        if not (np.abs(scaled) < 2**62).all():
            raise ValueError("a time is not a finite number")
    return np.rint(scaled).astype(np.int64)


def addresses_from_column(column: NDArray) -> NDArray[np.int64]:
    """Whole pixel addresses; -1, which is on no sensor, for what is no number."""
    if column.dtype.kind == "f":
        column = np.where(np.abs(column) < 2**31, column, -1)
    return column.astype(np.int64)


def find_columns(names: Sequence[str], *, where: str) -> dict[str, int]:
    """Positions of t, x, y and p among column names, whatever their usual spelling.

    Raises:
        RecordingError: if one is missing.
    """
    spelled = [
        name.strip("\ufeff\"'# %\t\r\n").lower().replace(" ", "_").rstrip("])").replace("_[", "_").replace("_(", "_")
        for name in names
    ]
    found: dict[str, int] = {}
    for column, spellings in _NAMES.items():
        position = next((spelled.index(name) for name in spellings if name in spelled), None)
        if position is None:
            raise RecordingError(
                f"no column for {column}", expected=f"one of {', '.join(spellings)}", got=", ".join(names), where=where
            )
        found[column] = position
    return found


def unit_of_name(name: str) -> str | None:
    """Unit of a time column (`ns`, `us`, `ms`, `s`) that its name states; None if it does not."""
    found = re.search(r"[_\s\[(](ns|us|µs|ms|s)[\])]?$", name.strip("\ufeff\"' \t\r\n").lower())
    return None if found is None else found.group(1).replace("µ", "u")


def counts_seconds(name: str) -> bool | None:
    """Whether a time column of that name counts seconds; None if the name does not say."""
    name = name.strip().lower().rstrip("]")
    if name.endswith(("_us", "[us", " us")):
        return False
    return True if name.endswith(("_s", "[s", " s")) else None
