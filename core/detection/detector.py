"""Interface of all detectors, and their result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.events import Window


@dataclass(frozen=True, slots=True)
class Detection:
    """A ball in the picture of one camera."""

    t_us: int
    """The time at which the position is valid (`paper`: the end of its window)."""
    u_px: float
    v_px: float
    r_px: float

    @property
    def centre_covariance_px2(self) -> NDArray[np.float64] | None:
        """(2, 2) covariance of u and v, px^2; None for a method without an uncertainty."""
        return None


class Detector(Protocol):
    """Finds at most one ball per window, windows given in order of time."""

    @property
    def extra_circles(self) -> int:
        """Circles of the last window that passed every test besides the answer; 0 for methods with only one."""
        ...

    def reset(self) -> None:
        """Forget everything seen before."""
        ...

    def step(self, window: Window) -> Detection | None:
        """The ball in this window, or None. The window may be empty."""
        ...
