"""A moment of a rally drawn by this program alone: a pinhole view of the 3D scene, without a browser or a GPU.

It is a drawing and not what the browser renders: no lights, no shadows, and of what hides what only the net.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.scene.ball import BALL_RGB, TRAIL_RGB, TRUTH_RGB
from app.scene.landing import CASE_RGB, TARGET_RGB
from app.scene.prediction import AFTER_RGB, BEFORE_RGB, PLANE_HEIGHT_M, PLANE_RGB, PLANE_WIDTH_M
from app.scene.racket import BLADE_RADIUS_M, FRONT_RGB, HANDLE_M, HANDLE_RGB
from app.scene.racket import TARGET_RGB as GHOST_RGB
from app.views.viewpoint import Viewpoint
from core.cameras import Camera
from core.events import SensorSize
from core.geometry import look_at, matrix_from_quaternion
from core.rally.history.rally_picture import Pose, RallyPicture
from core.table import (
    BALL_RADIUS_M,
    LINE_WIDTH_M,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

Rgb = tuple[int, int, int]
Image = NDArray[np.uint8]
BACK_RGB: Final = (24, 26, 31)
FLOOR_RGB: Final = (38, 41, 49)
TABLE_RGB: Final = (24, 74, 140)
LINE_RGB: Final = (235, 235, 235)
NET_RGB: Final = (150, 155, 165)
LEG_RGB: Final = (52, 55, 62)
BITS: Final = 4
"""Fixed-point digits of picture coordinates."""
NEAR_M: Final = 0.05
TURN: Final = np.linspace(0, 2 * np.pi, 33)[:-1]


class SceneDrawing:
    """Draws moments from one point of view; the parts that do not move are drawn once."""

    def __init__(self, size: SensorSize, view: Viewpoint, *, plane_x_m: float) -> None:
        f = size.height_px / 2 / math.tan(view.fov_rad / 2)
        K = np.array([[f, 0, (size.width_px - 1) / 2], [0, f, (size.height_px - 1) / 2], [0, 0, 1]])
        self._camera = Camera(size, K, np.zeros(5), look_at(view.position, view.look_at))
        self._plane_x_m = plane_x_m
        self._image = np.empty((size.height_px, size.width_px, 3), np.uint8)
        self._image[:] = BACK_RGB
        self._draw_room()
        self._still = self._image.copy()

    def draw(self, picture: RallyPicture) -> Image:
        """(height, width, 3) RGB."""
        self._image = self._still.copy()
        for spot in picture.spots:
            if math.isfinite(spot.x_m) and math.isfinite(spot.y_m):
                self._ring((spot.x_m, spot.y_m, 0.0), 0.02, CASE_RGB[spot.case], fill=True)
        if picture.landing_target is not None:
            self._ring((*picture.landing_target[:2].tolist(), 0.0), 0.05, TARGET_RGB)
        far = picture.ball is not None and picture.ball[0] * self._camera.position_world_m[0] < 0
        if not far:
            self._draw_net()
        self._draw_predictions(picture)
        if picture.racket_target is not None:
            self._racket(picture.racket_target, GHOST_RGB, GHOST_RGB, fill=False)
        if picture.racket is not None:
            self._racket(picture.racket, FRONT_RGB, HANDLE_RGB, fill=True)
        self._path(picture.trail, TRAIL_RGB, 2)
        if picture.truth is not None:
            self._ball(picture.truth, 1.3 * BALL_RADIUS_M, TRUTH_RGB, fill=False)
        if picture.ball is not None:
            self._ball(picture.ball, BALL_RADIUS_M, BALL_RGB, fill=True)
        if far:
            self._draw_net()
        return self._image

    def _draw_room(self) -> None:
        x, y, z = 4.5, 3.0, -TABLE_HEIGHT_M
        self._polygon([(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)], FLOOR_RGB)
        x, y = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2
        for corner in ((-1.1, 0.6), (1.1, 0.6), (-1.1, -0.6), (1.1, -0.6)):
            self._path(np.array([(*corner, -0.02), (*corner, z)]), LEG_RGB, 5)
        self._polygon([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], TABLE_RGB)
        x, y = x - LINE_WIDTH_M / 2, y - LINE_WIDTH_M / 2
        self._path(np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0), (-x, -y, 0)]), LINE_RGB, 3)
        self._path(np.array([(-x, 0, 0), (x, 0, 0)]), LINE_RGB, 1)
        x, y, z = self._plane_x_m, PLANE_WIDTH_M / 2, PLANE_HEIGHT_M
        self._path(np.array([(x, -y, 0), (x, y, 0), (x, y, z), (x, -y, z), (x, -y, 0)]), PLANE_RGB, 1)

    def _draw_net(self) -> None:
        half = TABLE_WIDTH_M / 2 + NET_OVERHANG_M
        for y in np.linspace(-half, half, 31):
            self._path(np.array([(0, y, 0), (0, y, NET_HEIGHT_M)]), NET_RGB, 1)
        for z in np.linspace(0, NET_HEIGHT_M, 5):
            self._path(np.array([(0, -half, z), (0, half, z)]), NET_RGB, 1)
        self._path(np.array([(0, -half, NET_HEIGHT_M), (0, half, NET_HEIGHT_M)]), LINE_RGB, 2)

    def _draw_predictions(self, picture: RallyPicture) -> None:
        self._path(picture.before_bounce, BEFORE_RGB, 2)
        self._path(picture.after_bounce, AFTER_RGB, 2)
        if picture.bounce is not None:
            self._ring((*picture.bounce[:2].tolist(), 0.0), 0.035, BEFORE_RGB)
        if picture.hit is not None:
            self._ball(picture.hit, 0.022, AFTER_RGB, fill=False)

    def _racket(self, pose: Pose, face: Rgb, handle: Rgb, *, fill: bool) -> None:
        R = matrix_from_quaternion(pose.wxyz)
        low, high = -BLADE_RADIUS_M - 0.9 * HANDLE_M[2], -0.9 * BLADE_RADIUS_M
        self._path(pose.p_world_m + np.array([(0, 0, low), (0, 0, high)]) @ R.T, handle, 4)
        rim = np.column_stack([np.zeros_like(TURN), np.cos(TURN), np.sin(TURN)]) * BLADE_RADIUS_M
        rim = pose.p_world_m + rim @ R.T
        if fill:
            self._polygon(rim, face)
        else:
            self._path(np.concatenate([rim, rim[:1]]), face, 2)

    def _ring(self, centre: ArrayLike, radius_m: float, colour: Rgb, *, fill: bool = False) -> None:
        circle = np.column_stack([np.cos(TURN), np.sin(TURN), np.zeros_like(TURN)]) * radius_m + np.asarray(centre)
        if fill:
            self._polygon(circle, colour)
        else:
            self._path(np.concatenate([circle, circle[:1]]), colour, 2)

    def _ball(self, centre: NDArray[np.float64], radius_m: float, colour: Rgb, *, fill: bool) -> None:
        depth = float(self._camera.to_camera(centre)[0, 2])
        if depth < NEAR_M:
            return
        x, y = self._pixels(centre[None])[0].tolist()
        radius = round(max(2.0, self._camera.K[0, 0] * radius_m / depth) * 2**BITS)
        cv2.circle(self._image, (x, y), radius, colour, -1 if fill else 2, cv2.LINE_AA, BITS)

    def _polygon(self, points: ArrayLike, colour: Rgb) -> None:
        corners = np.asarray(points, np.float64)
        if (self._camera.to_camera(corners)[:, 2] > NEAR_M).all():
            cv2.fillPoly(self._image, [self._pixels(corners)], colour, cv2.LINE_AA, BITS)

    def _path(self, points: NDArray[np.float64], colour: Rgb, thickness: int) -> None:
        if len(points) > 1 and (self._camera.to_camera(points)[:, 2] > NEAR_M).all():
            cv2.polylines(self._image, [self._pixels(points)], False, colour, thickness, cv2.LINE_AA, BITS)

    def _pixels(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        return np.round(np.clip(self._camera.project(points), -1e5, 1e5) * 2**BITS).astype(np.int32)
