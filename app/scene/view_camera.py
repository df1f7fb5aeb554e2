"""From where one browser looks, and what has to be done so that small things stay visible from there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from core.errors import CommandError
from core.table import TABLE_HEIGHT_M

Array = NDArray[np.float64]

MIN_SHARE: Final = 0.0075
"""The ball's radius is drawn at least as this share of the picture's height: 5 px of 720."""
LIFT_M: Final = 0.3
"""A sprite stands so much nearer to the eye than what it marks, or table and racket would cut it in two."""
NEAREST_M: Final = 0.2
"""What is nearer to the eye's plane is drawn as if it were so far away."""

FLOOR_MIDDLE: Final = np.array([0.0, 0.0, -TABLE_HEIGHT_M])
BEFORE_FLOOR_M: Final = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class ViewCamera:
    """The camera of a browser."""

    p_world_m: Array
    """(3,)"""
    wxyz: Array
    """(4,) rotation from the camera's frame (x right, y down, z forward) to the world."""
    fov_rad: float
    """From the picture's top edge to its bottom edge."""

    def depth_m(self, p_world_m: Array) -> float:
        """Distance of a point (3,) along the line of sight, at least `NEAREST_M`."""
        w, x, y, z = self.wxyz.tolist()
        forward = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
        away = (p_world_m - self.p_world_m).tolist()
        return max(NEAREST_M, sum(a * b for a, b in zip(forward, away, strict=True)))

    def same_as(self, other: ViewCamera | None) -> bool:
        """Whether both see the same."""
        if other is None or self.fov_rad != other.fov_rad:
            return False
        return bool((self.p_world_m == other.p_world_m).all() and (self.wxyz == other.wxyz).all())


@dataclass(frozen=True, slots=True, eq=False)
class SpritePose:
    """Where a flat picture stands that faces the eye, and how large it is."""

    p_world_m: Array
    wxyz: Array
    scale: float
    """Metres for each metre at the place that it marks, times the radius drawn there."""


def view_camera_of(client: viser.ClientHandle) -> ViewCamera:
    """What a browser reported last of its camera."""
    camera = client.camera
    return ViewCamera(np.asarray(camera.position, np.float64), np.asarray(camera.wxyz, np.float64), float(camera.fov))


def drawn_radius_m(eye: ViewCamera, p_world_m: Array, radius_m: float, least_share: float = MIN_SHARE) -> float:
    """The radius with which a ball (3,) is drawn: its own, or larger so that it stays `least_share` of the picture."""
    picture_height_m = 2 * eye.depth_m(p_world_m) * math.tan(eye.fov_rad / 2)
    return max(radius_m, least_share * picture_height_m)


def lift_before_floor_m(eye: ViewCamera, p_world_m: Array, lift_m: float = LIFT_M) -> float:
    """`lift_m`, or as much more as brings a sprite at a point (3,) nearer to the eye than the middle of the floor.

    viser draws pictures in the order of their middles, the farthest first, and what is clear in one hides what is drawn
    behind it later: a sprite beyond the floor's middle would stand in a dark square.
    """
    depth_m, floor_m = eye.depth_m(p_world_m), eye.depth_m(FLOOR_MIDDLE)
    distance_m = float(np.linalg.norm(eye.p_world_m - p_world_m))
    return max(lift_m, (1.0 - (floor_m - BEFORE_FLOOR_M) / depth_m) * distance_m)


def sprite_pose(eye: ViewCamera, p_world_m: Array, radius_m: float, lift_m: float = LIFT_M) -> SpritePose:
    """A sprite on the line from the eye to a point (3,), `lift_m` nearer, that looks as one of `radius_m` there."""
    to_view_camera = eye.p_world_m - p_world_m
    distance = math.sqrt(float(to_view_camera @ to_view_camera))
    share = min(lift_m, distance / 2) / max(distance, 1e-9)
    return SpritePose(p_world_m + share * to_view_camera, eye.wxyz, radius_m * (1 - share))


WITHIN_S: Final = 60.0
BEHIND_RGB: Final = (20, 20, 20)
"""Colour of the page behind the scene in the browser; the scene has no background of its own."""
GONE: Final = "the browser that draws the picture is gone"


def render_view(client: viser.ClientHandle, width_px: int, height_px: int, eye: ViewCamera) -> NDArray[np.uint8]:
    """(height, width, 3) RGB of what the scene shows now, seen by `eye`. Not to be called by the loop: it waits.

    Raises:
        CommandError: if the browser is gone, or does not answer.
    """
    try:
        pixels = client.get_render(
            height_px,
            width_px,
            wxyz=eye.wxyz,
            position=eye.p_world_m,
            fov=eye.fov_rad,
            transport_format="png",
            timeout=WITHIN_S,
        )
    except TimeoutError as error:
        remedy = "keep its window in front"
        raise CommandError(
            "the browser did not draw its view", expected=f"within {WITHIN_S:.0f} s", remedy=remedy
        ) from error
    except RuntimeError as error:
        raise CommandError(GONE) from error
    if pixels.shape[:2] != (height_px, width_px):
        got = f"{pixels.shape[1]}x{pixels.shape[0]}"
        raise CommandError("the browser drew another size", expected=f"{width_px}x{height_px}", got=got)
    return over_background(pixels)


def over_background(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3 or 4) as it is seen on the page."""
    if pixels.shape[2] == 3:
        return pixels
    alpha = pixels[..., 3:].astype(np.uint16)
    behind = np.array(BEHIND_RGB, np.uint16)
    return ((pixels[..., :3] * alpha + behind * (255 - alpha) + 127) // 255).astype(np.uint8)
