"""The size of a sensor that no file states, told from the addresses of its events."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize

LARGEST_PX: Final = 4096
"""No event camera has more columns or rows; addresses beyond are odd rows, no size."""
_USUAL: Final = tuple(
    SensorSize(*size)
    for size in ((128, 128), (240, 180), (304, 240), (320, 240), (320, 320), (346, 260), (640, 480), (1280, 720))
)
_NEARLY: Final = 0.97
"""Share of each side that addresses reach which fill a sensor."""
_FEW_BEYOND: Final = 3
_ENOUGH_EVENTS: Final = 1000
"""From so many events on, a few beyond a usual sensor are odd addresses, and no larger sensor."""


def _none() -> NDArray[np.int64]:
    return np.zeros(LARGEST_PX, np.int64)


@dataclass(slots=True, eq=False)
class AddressCounts:
    """How many events each column and each row of a sensor has."""

    columns: NDArray[np.int64] = field(default_factory=_none)
    rows: NDArray[np.int64] = field(default_factory=_none)

    def add(self, x: NDArray[np.int64], y: NDArray[np.int64]) -> None:
        """Take in the addresses of some events, but for those that no sensor has."""
        for counts, addresses in ((self.columns, x), (self.rows, y)):
            possible = addresses[(addresses >= 0) & (addresses < LARGEST_PX)]
            counts += np.bincount(possible, minlength=LARGEST_PX)

    @property
    def largest(self) -> tuple[int, int]:
        """Largest column and row; 0 if there are no events."""
        column, row = (int(np.flatnonzero(counts)[-1]) if counts.any() else 0 for counts in (self.columns, self.rows))
        return column, row

    def are_turned(self, sensor: SensorSize) -> bool:
        """Whether a sensor that is higher than wide has width and height exchanged: no row needs its height, and more
        than a few columns lie beside it.
        """
        width, height = sensor.width_px, sensor.height_px
        beside = int(self.columns[width:height].sum())
        return height > width and beside > _FEW_BEYOND and not self.rows[width:].any()

    @property
    def filled_by_turned(self) -> SensorSize | None:
        """The usual sensor that the addresses would fill if columns were rows; None if there is none."""
        column, row = self.largest
        for sensor in _USUAL:
            width, height = sensor.width_px, sensor.height_px
            if height < width and _NEARLY * width <= row + 1 <= width and _NEARLY * height <= column + 1 <= height:
                return sensor
        return None

    def may_count_from_1(self, sensor: SensorSize) -> bool:
        """Whether no address is 0, and the largest is the one behind the sensor's last."""
        sides = ((self.columns, sensor.width_px), (self.rows, sensor.height_px))
        if any(counts[0] or counts[side + 1 :].any() for counts, side in sides):
            return False
        return any(bool(counts[side : side + 1].any()) for counts, side in sides)

    @property
    def filled_from_1(self) -> SensorSize | None:
        """The usual sensor that the addresses fill if they count from 1; None if there is none."""
        size = SensorSize(*(max(1, side) for side in self.largest))
        return size if size in _USUAL and self.may_count_from_1(size) else None

    def usual_sensor(self) -> SensorSize:
        """The smallest usual sensor that has all addresses but a few odd ones, else one just large enough for all."""
        events = int(self.columns.sum())
        allowed = _FEW_BEYOND if events >= _ENOUGH_EVENTS else 0
        for sensor in _USUAL:
            beyond = self.columns[sensor.width_px :].sum() + self.rows[sensor.height_px :].sum()
            if beyond <= allowed:
                return sensor
        column, row = self.largest
        return SensorSize(column + 1, row + 1)
