"""Boxes round balls, for formats that know no points. Edges count from the corner: a pixel's centre is at +0.5."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError
from core.events import SensorSize
from labels.formats.exchange import HALF_PIXEL
from labels.model import Label

LONGEST = 4.0
"""Radii from the centre of a polygon to its farthest corner: more is not one ball."""


@dataclass(frozen=True, slots=True)
class Box:
    """Edge-based, inside the picture."""

    x0: float
    y0: float
    x1: float
    y1: float
    clipped: bool
    """The ball is cut off by the edge of the picture: the box's centre is not the ball's."""


def box_of(label: Label, sensor: SensorSize, default_radius_px: float) -> Box | None:
    """The part inside the picture of the box round a ball; None without a position or if nothing is inside."""
    if label.x_px is None or label.y_px is None:
        return None
    x, y, r = label.x_px + HALF_PIXEL, label.y_px + HALF_PIXEL, label.r_px or default_radius_px
    edges = (x - r, y - r, x + r, y + r)
    width, height = sensor.width_px, sensor.height_px
    inside = (max(edges[0], 0.0), max(edges[1], 0.0), min(edges[2], width), min(edges[3], height))
    if inside[2] <= inside[0] or inside[3] <= inside[1]:
        return None
    return Box(*inside, clipped=inside != edges)


def circle_of_polygon(corners: NDArray[np.float64]) -> tuple[float, float, float]:
    """Centre and radius of the circle with the centroid and the area of a polygon with the corners (N, 2).

    Raises:
        LabelError: if it has no area, or is too long for a ball.
    """
    start = corners[0]
    first, second = corners - start, np.roll(corners, -1, axis=0) - start
    cross = first[:, 0] * second[:, 1] - second[:, 0] * first[:, 1]
    area = float(cross.sum()) / 2
    if not abs(area) > 0:
        raise LabelError("the polygon is empty", got=f"{len(corners)} corners")
    centre = start + ((first + second) * cross[:, None]).sum(axis=0) / (6 * area)
    radius = float(np.sqrt(abs(area) / np.pi))
    farthest = float(np.hypot(*(corners - centre).T).max())
    if farthest > LONGEST * radius:
        got = f"a corner {farthest:.1f} px from the centre of an area of radius {radius:.1f} px"
        raise LabelError("the polygon is no ball", got=got)
    return float(centre[0]), float(centre[1]), radius


def losses_of_box(label: Label, box: Box | None) -> list[str]:
    """What a box does not say of a label."""
    if label.x_px is None:
        return []
    if box is None:
        return ["position outside the picture: written without a box"]
    losses = ["no radius: the box has the default size"] if label.r_px is None else []
    return [*losses, "cut off by the edge: the box's centre is not the ball's"] if box.clipped else losses
