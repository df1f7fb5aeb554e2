"""Geometry: how round and how filled the convex hull of a cluster is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.detection.reasons import Reason


@dataclass(frozen=True, slots=True, kw_only=True)
class GeometryConfig:
    """Shape limits of a ball."""

    circularity_min: float = setting(0.65, 0.0, 1.0, step=0.01)
    """4 pi area / perimeter^2 of the convex hull: 1 for a disc, 0.79 for a square, 0.75 for half a disc. At 2 ms a
    ball is a crescent: 0.65 keeps 98 % of simulated balls, 0.8 half of them, but 0.8 rejects more of a moving person.
    Longer windows allow more."""
    solidity_min: float = setting(0.3, 0.0, 2.0, step=0.01)
    """Pixels with events per area of the hull. A crescent swept by the edge fills about 4 v dt / (pi r) of it. It goes
    beyond 2 for a few pixels, whose hull has hardly an area."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Convex hull of a set of pixels, with the measures that are compared with the thresholds."""

    hull_px: NDArray[np.float64]
    """(K, 2) corners in order."""
    circularity: float
    """0 for fewer than three corners."""
    solidity: float
    """May exceed 1: pixels are counted, while the hull runs through their centres. 0 where there is no area."""


def measure_shape(xy_px: NDArray[np.int32]) -> Shape:
    """Hull, circularity and solidity of N >= 1 events at (N, 2) addresses (paper, geometric constraints)."""
    hull = cv2.convexHull(xy_px.reshape(-1, 1, 2)).reshape(-1, 2).astype(np.float64)
    following = np.roll(hull, -1, axis=0)
    # OpenCV's arcLength works in single precision; in double the answer does not depend on the order of the corners.
    area = 0.5 * abs(float(np.sum(hull[:, 0] * following[:, 1] - following[:, 0] * hull[:, 1])))
    perimeter = float(np.sum(np.hypot(*(following - hull).T)))
    if area == 0.0:
        return Shape(hull, 0.0, 0.0)
    pixels = len(np.unique(xy_px[:, 1].astype(np.int64) * 65536 + xy_px[:, 0]))
    return Shape(hull, 4.0 * np.pi * area / perimeter**2, pixels / area)


def shape_reasons(shape: Shape, config: GeometryConfig) -> tuple[Reason, ...]:
    """Why this shape is rejected; empty if it is not."""
    measured = (
        ("circularity", "geometry.circularity_min", shape.circularity, config.circularity_min),
        ("solidity", "geometry.solidity_min", shape.solidity, config.solidity_min),
    )
    return tuple(
        Reason(name, setting_name, value, least, sentence=f"{name} {value:.2f} < {least:.2f}")
        for name, setting_name, value, least in measured
        if value < least
    )
