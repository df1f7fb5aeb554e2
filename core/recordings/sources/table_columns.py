"""Which column of a table is which, and the unit of time that its name states."""

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
    "x": (
        "x",
        "xs",
        "x_px",
        "x_pos",
        "col",
        "column",
        "x_coordinate",
        "x_addr",
        "addr_x",
        "pixel_x",
        "pos_x",
        "coord_x",
    ),
    "y": ("y", "ys", "y_px", "y_pos", "row", "y_coordinate", "y_addr", "addr_y", "pixel_y", "pos_y", "coord_y"),
    "p": ("p", "ps", "pol", "pols", "polarity", "polarities", "on", "sign", "is_on", "on_off"),
}


def addresses_from_column(column: NDArray) -> NDArray[np.int64]:
    """The nearest pixel addresses; -1, which is on no sensor, for what is no number."""
    if column.dtype.kind == "f":
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
    spelled = [
        re.sub(
            r"[\s_\[(]+", "_", name.strip("\ufeff\"'# %\t\r\n").lower().replace("µ", "u").replace("μ", "u").rstrip("])")
        )
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
    found = re.search(r"[_\s\[(](ns|us|[µμ]s|ms|s)[\])]?$", name.strip("\ufeff\"' \t\r\n").lower())
    return None if found is None else found.group(1).replace("µ", "u").replace("μ", "u")
