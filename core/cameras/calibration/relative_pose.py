"""A first guess of how two cameras stand to each other and how far their clocks are apart.

For each of many time offsets the essential matrix is estimated (OpenCV, RANSAC) from what both would have seen at one
time; the offset at which the most sightings agree is taken. The translation has length 1: two views know no scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.errors import CalibrationError
from core.geometry import make_transform

Array = NDArray[np.float64]

POINTS_AT_LEAST: Final = 30
SEARCH_POINTS: Final = 300
SEARCH_ROUNDS: Final = 60
"""Rounds of RANSAC at each offset; at the best one it goes on."""
ROUNDS: Final = 2000
FLAT_SHARE: Final = 0.9
"""Share of the sightings; when so many are on one plane (a homography explains them) a mirrored pose fits as well."""
THRESHOLD_PX: Final = 3.0
"""Distance from the epipolar line of a sighting that agrees, wide because the offset is searched in steps."""


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """The second camera in the first one's frame."""

    T_first_second: Array
    """(4, 4), the translation of length 1."""
    offset_us: float
    """The second camera's clock minus the first one's."""
    agreeing: float
    """Share of the sightings on their epipolar lines."""


def guess_relative_pose(
    first: Array,
    second_at: Callable[[float], Array],
    offsets_us: Array,
    focal_px: float,
    *,
    progress: Callable[[float], None] = lambda share: None,
) -> RelativePose:
    """The best guess over the offsets (K,), from pinhole coordinates (N, 2) of the first camera.

    `second_at(offset_us)` gives those of the second (N, 2) if its clock is ahead by so much; nan: not seen.

    Raises:
        CalibrationError: if the two saw too little at the same time, or nothing agrees.
    """
    best: tuple[float, float] | None = None
    most_common = 0
    for number, offset_us in enumerate(offsets_us.tolist()):
        second = second_at(offset_us)
        common = np.flatnonzero(np.isfinite(first[:, 0]) & np.isfinite(second[:, 0]))
        most_common = max(most_common, len(common))
        if len(common) >= POINTS_AT_LEAST:
            chosen = common[np.linspace(0, len(common) - 1, min(len(common), SEARCH_POINTS)).astype(int)]
            E = _essential(first[chosen], second[chosen], focal_px, SEARCH_ROUNDS)
            score = 0.0 if E is None else _agreement(E, first[chosen], second[chosen], focal_px)
            if best is None or score > best[0]:
                best = score, offset_us
        progress((number + 1) / len(offsets_us))
    if best is None:
        raise CalibrationError(
            "the cameras saw too little at the same time",
            expected=f"{POINTS_AT_LEAST} common sightings or more",
            got=most_common,
            remedy="sweep the ball where both see it; --max-offset-ms must exceed the clocks' difference",
        )
    score, offset_us = best
    second = second_at(offset_us)
    common = np.isfinite(first[:, 0]) & np.isfinite(second[:, 0])
    return _refined(first[common], second[common], focal_px, offset_us, score)


def _essential(first: Array, second: Array, focal_px: float, rounds: int) -> Array | None:
    cv2.setRNGSeed(0)  # the same sightings, the same answer
    threshold = THRESHOLD_PX / focal_px
    E, _ = cv2.findEssentialMat(
        first, second, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=threshold, maxIters=rounds
    )
    return None if E is None or np.shape(E) != (3, 3) else np.asarray(E, np.float64)


def _agreement(E: Array, first: Array, second: Array, focal_px: float) -> float:
    """Mean over the points of 1 on the epipolar line, falling to 0 at the threshold (MSAC)."""
    squared = (sampson_distance(E, first, second) * focal_px / THRESHOLD_PX) ** 2
    return float(np.maximum(0.0, 1.0 - squared).mean())


def sampson_distance(E: Array, first: Array, second: Array) -> Array:
    """(N,) first-order distance of pairs of pinhole coordinates from the epipolar geometry."""
    ones = np.ones((len(first), 1))
    a, b = np.hstack([first, ones]), np.hstack([second, ones])
    lines_b, lines_a = a @ E.T, b @ E
    across = np.einsum("ij,ij->i", b, lines_b)
    return np.abs(across) / np.sqrt((lines_b[:, :2] ** 2).sum(axis=1) + (lines_a[:, :2] ** 2).sum(axis=1))


def _refined(first: Array, second: Array, focal_px: float, offset_us: float, score: float) -> RelativePose:
    chosen = np.linspace(0, len(first) - 1, min(len(first), 4 * SEARCH_POINTS)).astype(int)
    E = _essential(first[chosen], second[chosen], focal_px, ROUNDS)
    _, on_plane = cv2.findHomography(first[chosen], second[chosen], cv2.RANSAC, THRESHOLD_PX / focal_px)
    remedy = "sweep the ball through the whole volume, in all directions"
    if on_plane is not None and np.mean(on_plane) > FLAT_SHARE:
        raise CalibrationError("the ball was seen in one plane only, which fits two poses", remedy=remedy)
    if E is None:
        raise CalibrationError("the sightings fix no pose", remedy=remedy)
    _, R, t, in_front = cv2.recoverPose(E, first, second, np.eye(3))
    if np.count_nonzero(in_front) < 0.5 * len(first):
        raise CalibrationError("no pose puts the ball in front of both cameras", remedy=remedy)
    R = np.asarray(R, np.float64)
    return RelativePose(make_transform(R.T, -R.T @ np.ravel(t)), offset_us, score)
