"""A picture of an ordinary camera, for detectors that look at pictures instead of events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """One picture with the middle of its exposure."""

    t_us: int
    exposure_us: int
    image: NDArray[np.uint8]
    """(height, width) or (height, width, 3 = RGB), read-only."""
