"""Software drawing of a moment of a rally: a pinhole view of the 3D scene, without a browser or a GPU.

It is a drawing and not what the browser renders: no lights, and of what hides what only the net and the table.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.scene.arena import (
    APRON_M,
    APRON_RGB,
    BLADE_RADIUS_M,
    FRONT_RGB,
    HANDLE_M,
    HANDLE_RGB,
    LEGS_M,
    LINE_RGB,
    STEEL_RGB,
    TOP_THICKNESS_M,
)
from app.scene.arena import TARGET_RGB as GHOST_RGB
from app.scene.ball import BALL_RGB, CORE_RGB, DARKNESS, POINTS, RIM_RGB, TRUTH_RGB, resampled, shadow_of, speed_colours
from app.scene.painted import FLOOR_SIZE_M, RIM_TO, RING_TO, SHADOW_RGB, backdrop_picture, floor_picture
from app.scene.prediction import (
    AFTER_RGB,
    BEFORE_RGB,
    BOUNCE_M,
    CASE_RGB,
    PLANE_HEIGHT_M,
    PLANE_RGB,
    PLANE_WIDTH_M,
    TARGET_RGB,
)
from app.scene.view_camera import MIN_SHARE
from app.views.viewpoint import Viewpoint
from core.cameras import Camera
from core.events import SensorSize
from core.geometry import look_at, matrix_from_quaternion
from core.history.rally_picture import Pose, RallyPicture
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
TABLE_RGB: Final = (48, 122, 202)
"""Colour of the lit table in the browser."""
NET_RGB: Final = (196, 204, 216)
LINE_PX: Final = 2
TRAIL_PX: Final = 3
BITS: Final = 4
"""Fixed-point digits of picture coordinates."""
NEAR_M: Final = 0.05
TURN: Final = np.linspace(0, 2 * np.pi, 33)[:-1]


class SceneDrawing:
    """Draws moments from one viewpoint; static parts are drawn once."""

    def __init__(self, size: SensorSize, view: Viewpoint, *, plane_x_m: float) -> None:
        f = size.height_px / 2 / math.tan(view.fov_rad / 2)
        K = np.array([[f, 0, (size.width_px - 1) / 2], [0, f, (size.height_px - 1) / 2], [0, 0, 1]])
        self._camera = Camera(size, K, np.zeros(5), look_at(view.position, view.look_at))
        self._plane_x_m = plane_x_m
        stretched = cv2.resize(backdrop_picture(), (size.width_px, size.height_px), interpolation=cv2.INTER_LINEAR)
        self._image: Image = np.asarray(stretched, np.uint8)
        self._draw_room()
        self._still = self._image.copy()

    def draw(self, picture: RallyPicture) -> Image:
        """Picture of a moment, (height, width, 3) RGB."""
        self._image = self._still.copy()
        for spot in picture.spots:
            if math.isfinite(spot.x_m) and math.isfinite(spot.y_m):
                self._ring((spot.x_m, spot.y_m, 0.0), 0.02, CASE_RGB[spot.case], fill=True)
        if picture.landing_target is not None:
            for radius_m in (0.05, 0.10):
                self._ring((*picture.landing_target[:2].tolist(), 0.0), radius_m, TARGET_RGB)
        if picture.ball is not None:
            self._shadow(picture.ball)
        # Painted from back to front: a ball on the other side is behind the net.
        far = picture.ball is not None and picture.ball[0] * self._camera.position_world_m[0] < 0
        if not far:
            self._draw_net()
        self._draw_predictions(picture)
        if picture.racket_target is not None:
            self._racket(picture.racket_target, GHOST_RGB, GHOST_RGB, fill=False)
        if picture.racket is not None:
            self._racket(picture.racket, FRONT_RGB, HANDLE_RGB, fill=True)
        self._trail(picture)
        if picture.truth is not None:
            self._ball(picture.truth, BALL_RADIUS_M, TRUTH_RGB, fill=False)
        if picture.ball is not None:
            for share, rgb in ((RIM_TO, RIM_RGB), (RING_TO, BALL_RGB), (1.0, CORE_RGB)):
                self._ball(picture.ball, BALL_RADIUS_M, rgb, fill=True, share=share)
        if far:
            self._draw_net()
        return self._image

    def _draw_room(self) -> None:
        self._draw_floor()
        z = -TABLE_HEIGHT_M
        below = -TOP_THICKNESS_M - APRON_M[0]
        leg_x, leg_y = LEGS_M
        for x, y in ((-leg_x, leg_y), (leg_x, leg_y), (-leg_x, -leg_y), (leg_x, -leg_y)):
            self._path(np.array([(x, y, below), (x, y, z)]), STEEL_RGB, self._thick_px(0.05, (x, y, z / 2)))
        x, y = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2
        for end in (-x, x):
            self._polygon([(end, -y, 0), (end, y, 0), (end, y, below), (end, -y, below)], APRON_RGB)
        for side in (-y, y):
            self._polygon([(-x, side, 0), (x, side, 0), (x, side, below), (-x, side, below)], APRON_RGB)
        self._polygon([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], TABLE_RGB)
        x, y = x - LINE_WIDTH_M / 2, y - LINE_WIDTH_M / 2
        self._path(np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0), (-x, -y, 0)]), LINE_RGB, LINE_PX)
        self._path(np.array([(-x, 0, 0), (x, 0, 0)]), LINE_RGB, 1)
        x, y, z = self._plane_x_m, PLANE_WIDTH_M / 2, PLANE_HEIGHT_M
        self._path(np.array([(x, -y, 0), (x, y, 0), (x, y, z), (x, -y, z), (x, -y, 0)]), PLANE_RGB, 1)

    def _draw_floor(self) -> None:
        """Draw the floor."""
        floor = floor_picture()
        rows, columns = floor.shape[:2]
        K, T = self._camera.K, np.linalg.inv(self._camera.T_world_camera)
        metres = np.array(
            [[FLOOR_SIZE_M[0] / columns, 0, -FLOOR_SIZE_M[0] / 2], [0, FLOOR_SIZE_M[1] / rows, -FLOOR_SIZE_M[1] / 2]]
        )
        on_floor = np.array([*metres, [0, 0, -TABLE_HEIGHT_M], [0, 0, 1]])  # of a pixel of the floor, homogeneous
        to_picture = K @ T[:3] @ on_floor
        height, width = self._image.shape[:2]
        v, u = np.mgrid[:height, :width].astype(np.float64)
        x, y, w = np.tensordot(np.linalg.inv(to_picture), np.stack([u, v, np.ones_like(u)]), axes=1)
        there = cv2.remap(
            floor, (x / w).astype(np.float32), (y / w).astype(np.float32), cv2.INTER_LINEAR, borderValue=(0, 0, 0, 0)
        )
        depth = np.tensordot(to_picture[2], np.stack([x / w, y / w, np.ones_like(w)]), axes=1)
        alpha = np.where(depth > NEAR_M, there[..., 3] / 255.0, 0.0)[..., None]
        self._image = np.round(self._image * (1 - alpha) + there[..., :3] * alpha).astype(np.uint8)

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
            self._ring((*picture.bounce[:2].tolist(), 0.0), BOUNCE_M, AFTER_RGB)
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
        circle = _circle(centre, radius_m)
        if fill:
            self._polygon(circle, colour)
        else:
            self._path(np.concatenate([circle, circle[:1]]), colour, 2)

    def _trail(self, picture: RallyPicture) -> None:
        if len(picture.trail) < 2:
            return
        points, speeds = resampled(picture.trail, picture.trail_speeds_mps, min(POINTS, len(picture.trail)))
        for number, rgb in enumerate(speed_colours(speeds[1:]).tolist()):
            self._path(points[number : number + 2], rgb, TRAIL_PX)

    def _shadow(self, ball: NDArray[np.float64]) -> None:
        """Draw a soft shadow from several discs."""
        shadow = shadow_of(ball, self._radius_m(ball, BALL_RADIUS_M))
        centre, dark = (shadow.x_m, shadow.y_m, shadow.z_m), DARKNESS[shadow.strength] / 3
        where = self._box(_circle(centre, shadow.radius_m))
        before = self._image[where].copy()
        for share in (0.9, 0.65, 0.4):
            self._image[where] = before
            self._ring(centre, share * shadow.radius_m, SHADOW_RGB, fill=True)
            before = np.round(before * (1 - dark) + self._image[where] * dark).astype(np.uint8)
        self._image[where] = before

    def _box(self, points: NDArray[np.float64]) -> tuple[slice, slice]:
        """Rows and columns of the picture that contain the points; none if one is behind the camera."""
        if not (self._camera.to_camera(points)[:, 2] > NEAR_M).all():
            return slice(0), slice(0)
        pixels = self._pixels(points) >> BITS
        (left, top), (right, bottom) = np.maximum(pixels.min(axis=0) - 1, 0), np.maximum(pixels.max(axis=0) + 3, 0)
        return slice(top, bottom), slice(left, right)

    def _radius_m(self, centre: NDArray[np.float64], radius_m: float) -> float:
        """Radius to draw, m: at least the browser's minimum share of the picture."""
        depth = float(self._camera.to_camera(centre)[0, 2])
        return max(radius_m, MIN_SHARE * self._camera.sensor.height_px * depth / self._camera.K[0, 0])

    def _thick_px(self, thick_m: float, p_world_m: ArrayLike) -> int:
        depth = float(self._camera.to_camera(np.asarray(p_world_m, np.float64))[0, 2])
        return max(2, round(self._camera.K[0, 0] * thick_m / max(depth, NEAR_M)))

    def _ball(
        self, centre: NDArray[np.float64], radius_m: float, colour: Rgb, *, fill: bool, share: float = 1.0
    ) -> None:
        depth = float(self._camera.to_camera(centre)[0, 2])
        if depth < NEAR_M:
            return
        x, y = self._pixels(centre[None])[0].tolist()
        radius = round(share * self._camera.K[0, 0] * self._radius_m(centre, radius_m) / depth * 2**BITS)
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


def _circle(centre: ArrayLike, radius_m: float) -> NDArray[np.float64]:
    """(N, 3) points of a horizontal circle."""
    return np.column_stack([np.cos(TURN), np.sin(TURN), np.zeros_like(TURN)]) * radius_m + np.asarray(centre)
