"""From where one browser looks at the 3D scene, and what has to be done so that small things stay visible from
there.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from app.scene.arena import vertical_fov_rad
from app.views.viewpoint import Viewpoint
from core.cameras import Camera
from core.errors import CommandError
from core.geometry import look_at
from core.history.rally_picture import People
from core.table import NET_HEIGHT_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

MARGIN: Final = 0.06
"""Share of the picture's width and height that stays free on each side."""
Array = NDArray[np.float64]
View = Literal["Broadcast", "Side", "Top", "Robot", "Follow ball"]


VIEWPOINTS: Final[dict[str, Viewpoint]] = {
    "Broadcast": Viewpoint((-4.4, -3.4, 2.7), (0.0, 0.0, 0.0), fov_rad=math.radians(33)),
    "Side": Viewpoint((-0.1, -6.0, 1.5), (-0.1, 0.0, 0.15)),
    "Top": Viewpoint((0.0, -0.01, 6.2), (0.0, 0.0, 0.0)),
    "Robot": Viewpoint((-3.6, -0.5, 1.1), (0.4, 0.0, 0.1)),
    "Follow ball": Viewpoint((-2.2, -2.4, 1.3), (0.0, 0.0, 0.2)),
}
BROADCAST_DEG: Final = (26.0, 46.0)
"""From the table's length to the direction in which one looks, in a view that is high and in one that is wide: behind
the robot, so that racket, bounce and net are in front, and past the cameras at the table's sides."""
BROADCAST_ASPECTS: Final = (0.8, 1.5)
FRAMED: Final = frozenset({"Broadcast", "Side", "Top", "Robot"})
"""Only their direction counts: they stand where all of `STAGE` is in the picture."""
STAGE: Final = np.array(
    [
        *(
            (x, y, 0.0)
            for x in (-TABLE_LENGTH_M / 2, TABLE_LENGTH_M / 2)
            for y in (-TABLE_WIDTH_M / 2, TABLE_WIDTH_M / 2)
        ),
        *((x, y, -TABLE_HEIGHT_M) for x in (-1.1, 1.1) for y in (-0.62, 0.62)),
        *((0.0, y, NET_HEIGHT_M) for y in (-0.915, 0.915)),
        *((-1.72, y, z) for y in (-0.35, 0.35) for z in (0.0, 0.45)),
        *((1.3, y, 0.45) for y in (-0.3, 0.3)),
    ]
)
"""(N, 3) table with its legs and net, where the racket plays, and from where balls come."""
STANDING_M: Final = 0.15
"""So much more room persons need than they cover at one time."""
_CUBE: Final = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


def stage_with(people: People | None, cameras: Collection[Camera] = ()) -> Array:
    """(N, 3) `STAGE` with the persons who are there; of three `cameras` or more, with these too."""
    stage = STAGE
    if len(cameras) > 2:
        stage = np.concatenate([stage, [camera.position_world_m for camera in cameras]])
    if people is None:
        return stage
    low, high = people.ends_m.min(axis=(0, 1)) - STANDING_M, people.ends_m.max(axis=(0, 1)) + STANDING_M
    low[2] = -TABLE_HEIGHT_M
    return np.concatenate([stage, low + _CUBE * (high - low)])


def standpoint(view: str, aspect: float, *, stage: Array = STAGE, margin: float = MARGIN) -> Viewpoint:
    """One of `VIEWPOINTS` for a picture of this width over height; of those in `FRAMED` all of `stage` is seen.

    Args:
        view: name of the viewpoint.
        aspect: width over height of the picture.
        stage: (N, 3) points that are to be seen, world, m.
        margin: share of the picture left free on each side.
    """
    viewpoint = VIEWPOINTS[view]
    if view == "Broadcast":
        x, y, z = viewpoint.position
        turn = math.radians(float(np.interp(aspect, BROADCAST_ASPECTS, BROADCAST_DEG)))
        away = math.hypot(x, y)
        viewpoint = replace(viewpoint, position=(-away * math.cos(turn), -away * math.sin(turn), z))
    return framed(viewpoint, stage, aspect, margin) if view in FRAMED else viewpoint


def camera_view(name: str) -> str:
    """Name of the view from a camera: "Camera left" for "left", apart from fixed ones such as "Side"."""
    return name if name.lower().startswith("cam") else f"Camera {name}"


def viewpoint_of_camera(camera: Camera) -> Viewpoint:
    """Where a camera stands, looking as it looks."""
    position, forward, down = camera.T_world_camera[:3, 3], camera.T_world_camera[:3, 2], camera.T_world_camera[:3, 1]
    return Viewpoint(
        tuple(position.tolist()),
        tuple((position + 2.0 * forward).tolist()),
        tuple((-down).tolist()),
        vertical_fov_rad(camera),
    )


def follow_viewpoint(client: viser.ClientHandle, p_world_m: Array, share: float) -> None:
    """Turn the browser's camera some way towards a point."""
    camera = client.camera
    camera.look_at = np.asarray(camera.look_at) * (1 - share) + p_world_m * share


def framed(viewpoint: Viewpoint, ps_world_m: ArrayLike, aspect: float, margin: float = MARGIN) -> Viewpoint:
    """The viewpoint moved so that the points (N, 3) just fill a picture of this width over height.

    It turns about the point of its line of sight that is nearest to what it looked at.

    Args:
        viewpoint: direction and lens.
        ps_world_m: (N, 3) points that are to be seen.
        aspect: width over height of the picture.
        margin: share of the picture left free on each side.
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
    """The radius with which a ball (3,) is drawn: its own, or larger so that it stays `least_share` of the picture.

    Args:
        eye: the camera of the view.
        p_world_m: (3,) the ball.
        radius_m: its own radius.
        least_share: least radius as a share of the picture's height.
    """
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
    """A sprite on the line from the eye to a point (3,), `lift_m` nearer, that looks as one of `radius_m` there.

    Args:
        eye: the camera of the view.
        p_world_m: (3,) what the sprite stands for.
        radius_m: its radius there.
        lift_m: how much nearer the sprite is, so that nothing at that place hides it.
    """
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
    # A browser may render at the size of its own window.
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
