"""How far the clock of one camera was from another's over time, as a small CSV file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError

COLUMNS: Final = "stamp_us,shift_us"
LARGEST_BYTES: Final = 64 << 20
"""A row a second for a week is a tenth of it."""
MAX_SLOPE: Final = 0.01
"""Steepest shift, s/s: real clocks are a thousand times better, and more would put events out of order."""


@dataclass(frozen=True, slots=True, eq=False)
class ClockTable:
    """What to add to the times of a camera, around some of them; on a straight line between, the same beyond."""

    stamp_us: NDArray[np.int64]
    """(N,) of the camera's clock, growing."""
    shift_us: NDArray[np.int64]
    """(N,) to get those of the other."""

    @property
    def known(self) -> bool:
        """Whether anything is said at all."""
        return len(self.stamp_us) > 0

    def shifted(self, t_us: NDArray[np.int64]) -> NDArray[np.int64]:
        """The other clock's times; their order stays."""
        if not self.known:
            return t_us
        return t_us + np.rint(np.interp(t_us, self.stamp_us, self.shift_us)).astype(np.int64)

    @property
    def digest(self) -> str:
        """Tells it from others."""
        return hashlib.sha256(self.stamp_us.tobytes() + self.shift_us.tobytes()).hexdigest()


def read_clock_table(path: Path) -> ClockTable:
    """The table that was written while two cameras were recorded; a last line that was cut short is left out.

    There is no row in it if one of the cameras sent nothing.

    Raises:
        RecordingError: if it cannot be read, or is no such table.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise RecordingError("too long for a table of clocks", expected=f"up to {LARGEST_BYTES} bytes", where=path)
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise RecordingError("cannot read the table of clocks", got=error.strerror, where=path) from error
    lines = text[: text.rfind("\n") + 1].splitlines()
    if not lines or lines[0].strip() != COLUMNS:
        raise RecordingError("not a table of clocks", expected=f"a first line {COLUMNS}", where=path)
    try:
        rows = np.array([[int(word) for word in line.split(",")] for line in lines[1:]], np.int64)
    except (ValueError, OverflowError) as error:
        raise RecordingError("not a table of clocks", got=str(error), where=path) from error
    # An empty list has one dimension.
    rows = rows.reshape(-1, 2) if not rows.size else rows
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise RecordingError("a table of clocks without two numbers in each row", where=path)
    steps = np.diff(rows, axis=0)
    if (steps[:, 0] <= 0).any() or (np.abs(steps[:, 1]) > MAX_SLOPE * steps[:, 0]).any():
        raise RecordingError("times of this table of clocks run backwards, or jump", where=path)
    return ClockTable(rows[:, 0].copy(), rows[:, 1].copy())
