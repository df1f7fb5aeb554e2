"""A policy's map as a picture: the opponent's half from above, cells by error, arrows from target to mean landing."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app.scene.landing import TARGET_RGB
from core.learning.evaluation.policy_map import PolicyMap
from core.table import NET_OVERHANG_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
LOW_M: Final = (-0.2, -0.92)
HIGH_M: Final = (1.65, 0.92)
"""What is in the picture; an arrow to a place beyond ends at its edge."""
PIXELS_PER_M: Final = 360
LEGEND_PX: Final = 64
"""Below the table."""
FLOOR_RGB: Final = (34, 37, 44)
LINE_RGB: Final = (214, 219, 226)
ARROW_RGB: Final = (255, 255, 255)
LOST_RGB: Final = (20, 20, 24)
"""A target's dot where fewer than `MOST_RETURNED` come back."""
MAX_RETURNED: Final = 0.9
ERROR_COLOURS: Final = (
    (0.0, (40, 140, 96)),
    (50.0, (104, 160, 70)),
    (100.0, (190, 170, 60)),
    (200.0, (210, 110, 50)),
    (400.0, (140, 36, 60)),
)
"""mm and RGB, linear in between; larger errors have the last one."""


def draw_map(found: PolicyMap) -> Picture:
    """(H, W, 3) RGB: the net at the left, the opponent's end at the right, +y up, a legend below."""
    size = (np.array(HIGH_M) - LOW_M) * PIXELS_PER_M
    picture = np.full((round(size[1]) + LEGEND_PX, round(size[0]), 3), FLOOR_RGB, np.uint8)
    half_cell = np.array(found.cell_m) / 2
    for target, error_mm in zip(found.targets_m, found.errors_mm, strict=True):
        cv2.rectangle(
            picture, _pixel(target - half_cell), _pixel(target + half_cell), error_rgb(float(error_mm)), cv2.FILLED
        )
    _draw_table(picture)
    _draw_trained(picture, found)
    for target, landing, returned in zip(found.targets_m, found.landings_m, found.returned, strict=True):
        if np.isfinite(landing).all():
            length_px = PIXELS_PER_M * max(0.02, float(np.hypot(*(landing - target))))
            tip = min(0.4, 9 / length_px)
            cv2.arrowedLine(picture, _pixel(target), _pixel(landing), ARROW_RGB, 2, cv2.LINE_AA, 0, tip)
        dot = ARROW_RGB if returned >= MAX_RETURNED else LOST_RGB
        cv2.circle(picture, _pixel(target), 6, dot, cv2.FILLED, cv2.LINE_AA)
    _draw_legend(picture)
    return picture


def error_rgb(error_mm: float) -> tuple[int, int, int]:
    """The colour of a cell."""
    steps = [step for step, _ in ERROR_COLOURS]
    red, green, blue = (
        round(float(np.interp(error_mm, steps, [rgb[k] for _, rgb in ERROR_COLOURS]))) for k in range(3)
    )
    return red, green, blue


def _draw_table(picture: Picture) -> None:
    end, side = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2
    cv2.rectangle(picture, _pixel((0.0, -side)), _pixel((end, side)), LINE_RGB, 2)
    reach = side + NET_OVERHANG_M
    cv2.line(picture, _pixel((0.0, -reach)), _pixel((0.0, reach)), LINE_RGB, 6)


def _draw_trained(picture: Picture, found: PolicyMap) -> None:
    """The box of targets of the training, or rings round the one target."""
    if found.trained.is_one:
        for radius_m in (0.05, 0.10):
            cv2.circle(picture, _pixel(found.trained.low_m), round(radius_m * PIXELS_PER_M), TARGET_RGB, 3, cv2.LINE_AA)
    else:
        cv2.rectangle(picture, _pixel(found.trained.low_m), _pixel(found.trained.high_m), TARGET_RGB, 3)


def _draw_legend(picture: Picture) -> None:
    height, width = picture.shape[:2]
    left, right, top = 30, width - 100, height - LEGEND_PX + 6
    highest = ERROR_COLOURS[-1][0]
    for x in range(left, right):
        rgb = error_rgb(highest * (x - left) / (right - left))
        cv2.line(picture, (x, top), (x, top + 18), rgb, 1)
    for step, _ in ERROR_COLOURS:
        x = round(left + (right - left) * step / highest)
        text = f"{step:.0f}" if step < highest else f"{step:.0f}+ mm"
        wide = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.75, 1)[0][0]
        at = min(x - 14, width - wide - 12), top + 46
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.75, LINE_RGB, 1, cv2.LINE_AA)


def _pixel(point_m: Array | tuple[float, float]) -> tuple[int, int]:
    x, y = np.clip(point_m, np.array(LOW_M) + 0.02, np.array(HIGH_M) - 0.02)
    return round((x - LOW_M[0]) * PIXELS_PER_M), round((HIGH_M[1] - y) * PIXELS_PER_M)
