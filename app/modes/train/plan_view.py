"""Pictures of landing points: on the table from above, and relative to their targets."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app.scene.prediction import CASE_RGB, TARGET_RGB
from core.physics.episode import Case
from core.table import NET_OVERHANG_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
LOW_M: Final = (-1.55, -1.2)
HIGH_M: Final = (2.25, 1.2)
"""Extent of the picture; landing points beyond it are drawn at its edge."""
PIXELS_PER_M: Final = 180
FLOOR_RGB: Final = (34, 37, 44)
TABLE_RGB: Final = (18, 62, 120)
LINE_RGB: Final = (214, 219, 226)
NET_RGB: Final = (160, 165, 174)
OLDEST_SHARE: Final = 0.35
"""Opacity of the oldest landing point; newer ones have more."""
SUB_PIXEL_BITS: Final = 4
OFFSETS_REACH_M: Final = 0.5
"""Half the side of the picture around the target; balls farther off are drawn at its edge."""
OFFSETS_PX: Final = 680
OFFSETS_RINGS_M: Final = (0.1, 0.2, 0.3, 0.4)
RING_RGB: Final = (74, 79, 90)
NEW_BALLS: Final = 25
"""Number of newest balls that are highlighted."""
OLD_RGB: Final = (120, 84, 56)
NEW_RGB: Final = (255, 140, 40)


def draw_plan(cases: Array, landings_m: Array, goal_m: Array | None) -> Picture:
    """(H, W, 3) RGB: the robot plays at the left, spots (N, 2) with cases (N,) oldest first, the newest target."""
    size = (np.array(HIGH_M) - LOW_M) * PIXELS_PER_M
    picture = np.full((round(size[1]), round(size[0]), 3), FLOOR_RGB, np.uint8)
    _draw_table(picture)
    known = np.isfinite(landings_m).all(axis=1) & np.isin(cases, [case.value for case in Case])
    cases, landings_m = cases[known], landings_m[known]
    shares = np.linspace(OLDEST_SHARE, 1.0, len(cases))
    for case, landing, share in zip(cases, landings_m, shares, strict=True):
        colour = np.array(CASE_RGB[Case(int(case))]) * share + np.array(FLOOR_RGB) * (1 - share)
        _dot(picture, landing, 4.5, tuple(colour.tolist()))
    if goal_m is not None:
        for radius_m in (0.05, 0.10):
            _ring(picture, goal_m, radius_m * PIXELS_PER_M, TARGET_RGB)
    return picture


def draw_offsets(landings_m: Array, goals_m: Array) -> Picture:
    """(S, S, 3) RGB: landings (N, 2) as seen from their targets (N, 2), oldest first, the last ones bright.

    The target is the middle, with a ring every 10 cm; right is farther from the robot, up is to its left.
    """
    picture = np.full((OFFSETS_PX, OFFSETS_PX, 3), FLOOR_RGB, np.uint8)
    scale = OFFSETS_PX / 2 / OFFSETS_REACH_M
    middle = OFFSETS_PX // 2
    for radius_m in OFFSETS_RINGS_M:
        cv2.circle(picture, (middle, middle), round(radius_m * scale), RING_RGB, 2, cv2.LINE_AA)
        above = (middle + 6, middle - round(radius_m * scale) - 6)
        cv2.putText(picture, f"{100 * radius_m:.0f} cm", above, cv2.FONT_HERSHEY_SIMPLEX, 0.6, LINE_RGB, 1, cv2.LINE_AA)
    offsets = landings_m - goals_m
    offsets = offsets[np.isfinite(offsets).all(axis=1)]
    distances = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), 1e-9)
    edge = OFFSETS_REACH_M * (1 - 16 / OFFSETS_PX)
    places = offsets * np.minimum(1.0, edge / distances)[:, None] * [scale, -scale] + middle
    for k, place in enumerate(places):
        is_new = k >= len(places) - NEW_BALLS
        centre = (round(place[0] * 2**SUB_PIXEL_BITS), round(place[1] * 2**SUB_PIXEL_BITS))
        radius = round((8 if is_new else 6) * 2**SUB_PIXEL_BITS)
        cv2.circle(picture, centre, radius, NEW_RGB if is_new else OLD_RGB, -1, cv2.LINE_AA, SUB_PIXEL_BITS)
    cv2.drawMarker(picture, (middle, middle), LINE_RGB, cv2.MARKER_CROSS, 24, 2)
    return picture


def _draw_table(picture: Picture) -> None:
    half = np.array([TABLE_LENGTH_M, TABLE_WIDTH_M]) / 2
    corner_a, corner_b = _pixel(-half), _pixel(half)
    cv2.rectangle(picture, corner_a, corner_b, TABLE_RGB, -1)
    cv2.rectangle(picture, corner_a, corner_b, LINE_RGB, 3)
    cv2.line(picture, _pixel(np.array([-half[0], 0.0])), _pixel(np.array([half[0], 0.0])), LINE_RGB, 1)
    reach = half[1] + NET_OVERHANG_M
    cv2.line(picture, _pixel(np.array([0.0, -reach])), _pixel(np.array([0.0, reach])), NET_RGB, 5)


def _dot(picture: Picture, point_m: Array, radius_px: float, rgb: tuple[float, ...]) -> None:
    cv2.circle(picture, _fixed(point_m), round(radius_px * 2**SUB_PIXEL_BITS), rgb, -1, cv2.LINE_AA, SUB_PIXEL_BITS)


def _ring(picture: Picture, point_m: Array, radius_px: float, rgb: tuple[int, ...]) -> None:
    cv2.circle(picture, _fixed(point_m), round(radius_px * 2**SUB_PIXEL_BITS), rgb, 2, cv2.LINE_AA, SUB_PIXEL_BITS)


def _pixel(point_m: Array) -> tuple[int, int]:
    x, y = _place(point_m)
    return round(x), round(y)


def _fixed(point_m: Array) -> tuple[int, int]:
    x, y = _place(point_m)
    return round(x * 2**SUB_PIXEL_BITS), round(y * 2**SUB_PIXEL_BITS)


def _place(point_m: Array) -> tuple[float, float]:
    """Picture coordinates, +y up; points outside are moved to the edge."""
    x, y = np.clip(point_m, np.array(LOW_M) + 0.03, np.array(HIGH_M) - 0.03)
    return (x - LOW_M[0]) * PIXELS_PER_M, (HIGH_M[1] - y) * PIXELS_PER_M


def encode_plan(picture: Picture) -> bytes:
    """Encode the plan view as PNG."""
    ok, data = cv2.imencode(".png", picture[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    assert ok
    return data.tobytes()
