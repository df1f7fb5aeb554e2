"""Localise: the minimum enclosing circle of a cluster is the ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.detection.reasons import Reason
from core.errors import ConfigError

TOLERANCE_PX: Final = 1e-3
"""Tolerance of the radius limits: OpenCV's circle is up to 2e-4 px too large, and round radii are common."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocaliseConfig:
    """Size limits of a ball in the picture, and when it was there."""

    radius_min_px: float = setting(4.0, 1.0, 100.0, step=0.5)
    """A table-tennis ball at the far end of the table, seen with a focal length of 1000 px: about 5 px."""
    radius_max_px: float = setting(24.0, 2.0, 200.0, step=0.5)
    """The nearest ball, about 20 px, plus what it moves during a window."""
    delay_us: int = setting(0, -2000, 5000, step=10)
    """Delay of the sensor and the method: an estimate is valid this long before the end of its window, the paper's at
    its end. Less than 0 where the circle round the leading edge lies ahead of the ball by more than the sensor's delay:
    -200 to -300 in simulated flights of 5 to 9 m/s."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.radius_max_px <= self.radius_min_px:
            raise ConfigError(
                "no radius is allowed",
                expected=f"radius_max_px above {self.radius_min_px:g}",
                got=self.radius_max_px,
                where="LocaliseConfig.radius_max_px",
            )


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle in the picture."""

    u_px: float
    v_px: float
    r_px: float


def enclosing_circle(xy_px: NDArray[np.float64]) -> Circle:
    """The smallest circle round N >= 1 points (N, 2) (paper, localisation)."""
    (u, v), r = cv2.minEnclosingCircle(xy_px.astype(np.float32).reshape(-1, 1, 2))
    return Circle(float(u), float(v), float(r))


def circle_reason(circle: Circle, config: LocaliseConfig) -> Reason | None:
    """Why this circle is rejected, or None."""
    r, low, high = circle.r_px, config.radius_min_px, config.radius_max_px
    if r < low - TOLERANCE_PX:
        return Reason("radius", "localise.radius_min_px", r, low, "px", sentence=f"radius {r:.1f} px < {low:.1f}")
    if r > high + TOLERANCE_PX:
        return Reason("radius", "localise.radius_max_px", r, high, "px", sentence=f"radius {r:.1f} px > {high:.1f}")
    return None
