"""Which parts of a picture something has been in, for a calibration: a lens is known where points were."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.events import SensorSize

CELLS_ACROSS: Final = 8
CELLS_DOWN: Final = 6


def cells_of(uvs_px: ArrayLike, sensor: SensorSize) -> NDArray[np.int64]:
    """(N,) the cell of each pixel (N, 2), row by row from the upper left; those beside the picture in the nearest."""
    uvs = np.asarray(uvs_px, np.float64).reshape(-1, 2)
    share = (uvs + 0.5) / (sensor.width_px, sensor.height_px) * (CELLS_ACROSS, CELLS_DOWN)
    column, row = np.clip(np.nan_to_num(share), 0, (CELLS_ACROSS - 1, CELLS_DOWN - 1)).astype(np.int64).T
    return np.asarray(row * CELLS_ACROSS + column, np.int64)


def cell_box(cell: int, sensor: SensorSize) -> tuple[float, float, float, float]:
    """Left, top, right and bottom edge of a cell in sensor pixels."""
    row, column = divmod(cell, CELLS_ACROSS)
    width, height = sensor.width_px / CELLS_ACROSS, sensor.height_px / CELLS_DOWN
    left, top = column * width - 0.5, row * height - 0.5
    return left, top, left + width, top + height


def coverage(uvs_px: ArrayLike, sensor: SensorSize) -> float:
    """Share of the picture's cells that hold one of the pixels (N, 2)."""
    return len(np.unique(cells_of(uvs_px, sensor))) / (CELLS_ACROSS * CELLS_DOWN)
