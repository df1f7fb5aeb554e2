"""How far away and how far aside to stand, so that all of something is in the picture, whatever its shape."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.views.viewpoint import Viewpoint
from core.geometry import look_at

MARGIN: Final = 0.06
"""Share of the picture's width and height that stays free on each side."""


def framed(viewpoint: Viewpoint, ps_world_m: ArrayLike, aspect: float, margin: float = MARGIN) -> Viewpoint:
    """The viewpoint moved so that the points (N, 3) just fill a picture of this width over height.

    It turns about the point of its line of sight that is nearest to what it looked at.
    """
    towards = np.subtract(viewpoint.look_at, viewpoint.position)
    right, down, forward = look_at(viewpoint.position, viewpoint.look_at)[:3, :3].T
    points = np.asarray(ps_world_m, np.float64) - viewpoint.look_at
    depth = points @ forward
    half = math.tan(viewpoint.fov_rad / 2) * (1 - 2 * margin)
    back, centre = 0.0, np.array(viewpoint.look_at)
    for axis, slope in ((right, half * aspect), (down, half)):
        # From a distance d every point must have |x - x_eye| <= slope (depth + d).
        low, high = (points @ axis + slope * depth).min(), (points @ axis - slope * depth).max()
        back = max(back, float(high - low) / (2 * slope))
        centre = centre + axis * (low + high) / 2
    distance = back / max(float(np.linalg.norm(towards)), 1e-9)
    return replace(viewpoint, position=_three(centre - distance * towards), look_at=_three(centre))


def _three(p: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = p.tolist()
    return x, y, z
