"""The ball and the truth beside it, its trail coloured by speed, the rays that found it, and its soft shadow: the
higher the ball, the wider and fainter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from app import theme
from app.scene.painted import (
    BALL_CORE_RGB,
    BALL_RIM_RGB,
    BALL_RING_RGB,
    GLOW_TO,
    ball_picture,
    ring_picture,
    shadow_picture,
)
from app.scene.view_camera import FLOOR_MIDDLE, LIFT_M, ViewCamera, drawn_radius_m, lift_before_floor_m, sprite_pose
from core.table import BALL_RADIUS_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

DARKNESS: Final = (0.85, 0.6, 0.38)
"""In the shadow's middle, of a ball that is low, higher, high."""
STEPS_M: Final = (0.15, 0.4)
"""Heights between those."""
ABOVE_TABLE_M: Final = 0.0016
"""Above the lines of the table."""
ABOVE_FLOOR_M: Final = 0.004
OWN_RADII: Final = 1.7
"""Radius of the shadow of a ball on the table, in ball radii; the soft edge takes half of it."""
WIDER: Final = 0.10
"""Metres a metre of height."""


@dataclass(frozen=True, slots=True)
class Shadow:
    """A soft disc that lies on the table or on the floor."""

    x_m: float
    y_m: float
    z_m: float
    radius_m: float
    strength: int
    """Index of its darkness in `DARKNESS`."""


def shadow_of(p_world_m: Array, radius_m: float) -> Shadow:
    """The shadow of a ball (3,), drawn with `radius_m`, in light from straight above."""
    x, y, z = p_world_m.tolist()
    over_table = abs(x) <= TABLE_LENGTH_M / 2 and abs(y) <= TABLE_WIDTH_M / 2 and z >= 0
    ground = 0.0 if over_table else -TABLE_HEIGHT_M
    height = max(0.0, z - ground)
    above = ABOVE_TABLE_M if over_table else ABOVE_FLOOR_M
    strength = int(np.searchsorted(STEPS_M, height, side="right"))
    return Shadow(x, y, ground + above, OWN_RADII * radius_m + WIDER * height, strength)


class ShadowActor:
    """The shadow in one browser's scene: a picture for each darkness, of which one is shown."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._discs = [
            scene.add_image(
                f"{name}-{number}",
                shadow_picture(darkness),
                2.0,
                2.0,
                format="png",
                cast_shadow=False,
                receive_shadow=False,
                visible=False,
            )
            for number, darkness in enumerate(DARKNESS)
        ]

    def show(self, shadow: Shadow | None) -> None:
        """Lie there; None hides it."""
        for number, disc in enumerate(self._discs):
            if shadow is not None and shadow.strength == number:  # its size comes before it is seen
                disc.scale = round(shadow.radius_m, 3)
                disc.position = (shadow.x_m, shadow.y_m, shadow.z_m)
            disc.visible = shadow is not None and shadow.strength == number


POINTS: Final = 72
"""The trail always has this many points, so that its handle is reused."""
THICKNESS_PX: Final = 5.0
SAME_COLOUR: Final = 6
"""Colours that differ by so many of 255 levels are not sent again."""


class TrailActor:
    """The trail in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        flat = np.zeros((POINTS - 1, 2, 3), np.float32)
        colours = np.zeros(flat.shape, np.uint8)
        self._colours = np.zeros((POINTS, 3), np.uint8)
        self._line = scene.add_line_segments(
            name, flat, colours, thickness=THICKNESS_PX, thickness_units="screen", visible=False
        )

    def show(self, ps_world_m: Array, speeds_mps: Array) -> None:
        """(N, 3) where the ball was, oldest first, and (N,) how fast; fewer than two points hide it."""
        self._line.visible = len(ps_world_m) > 1
        if len(ps_world_m) > 1:
            points, speeds = resampled(ps_world_m, speeds_mps, POINTS)
            self._line.points = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
            colours = speed_line_colours(speeds)
            if np.abs(colours.astype(np.int16) - self._colours).max() > SAME_COLOUR:
                self._colours = colours
                self._line.colors = np.stack([colours[:-1], colours[1:]], axis=1)


def resampled(ps_world_m: Array, speeds_mps: Array, points: int) -> tuple[Array, Array]:
    """(points, 3) and (points,) of a path (N, 3), N >= 2, with speeds (N,): rows of the path, both ends among them."""
    # The nearest row, in whole numbers: half of the divisor is added before dividing.
    rows = (np.arange(points) * (len(ps_world_m) - 1) + (points - 1) // 2) // (points - 1)
    return ps_world_m[rows], speeds_mps[rows]


SLOWEST_MPS: Final = 2.0
FASTEST_MPS: Final = 9.0
"""Serves have 3 to 9 m/s. What is slower or faster has the colour of the end."""
STOPS: Final = np.array([(171, 36, 148), (214, 82, 107), (243, 138, 66), (253, 195, 50), (240, 249, 120)], np.float64)
"""(5, 3) at even steps of speed."""

_LAST: Final = 255
_TABLE: Final = np.round(
    np.stack([np.interp(np.linspace(0, len(STOPS) - 1, _LAST + 1), np.arange(len(STOPS)), c) for c in STOPS.T], axis=1)
).astype(np.uint8)
_LINEAR: Final = np.round(
    255 * np.where(_TABLE <= 0.04045 * 255, _TABLE / 255 / 12.92, ((_TABLE / 255 + 0.055) / 1.055) ** 2.4)
).astype(np.uint8)


def _steps(speeds_mps: ArrayLike) -> NDArray[np.intp]:
    speeds = np.asarray(speeds_mps, np.float64)
    share = (np.where(np.isnan(speeds), SLOWEST_MPS, speeds) - SLOWEST_MPS) / (FASTEST_MPS - SLOWEST_MPS)
    return np.round(_LAST * np.clip(share, 0, 1)).astype(np.intp)


def speed_line_colours(speeds_mps: ArrayLike) -> NDArray[np.uint8]:
    """Speed colours of the points of a line: the browser reads them as linear light, not as sRGB."""
    return _LINEAR[_steps(speeds_mps)]


def speed_colours(speeds_mps: ArrayLike) -> NDArray[np.uint8]:
    """(N, 3) RGB of speeds (N,); an unknown one (NaN) has the colour of the slowest."""
    return _TABLE[_steps(speeds_mps)]


def speed_legend_html() -> str:
    """A bar with its ends."""
    colours = ",".join(f"rgb({r:.0f},{g:.0f},{b:.0f})" for r, g, b in STOPS)
    bar = f"<div style='flex:1;height:8px;border-radius:4px;background:linear-gradient(90deg,{colours})'></div>"
    return (
        f"<div style='display:flex;align-items:center;gap:8px;font-size:12px;color:{theme.MUTED};padding:4px 12px'>"
        f"<span>{SLOWEST_MPS:g}</span>{bar}<span>{FASTEST_MPS:g} m/s</span></div>"
    )


BALL_RGB: Final = BALL_RING_RGB
CORE_RGB: Final = BALL_CORE_RGB
RIM_RGB: Final = BALL_RIM_RGB
TRUTH_RGB: Final = (255, 255, 255)
RAY_RGB: Final = (150, 156, 168)
RAY_PX: Final = 1.2
HULL: Final = 1.6
"""Without an eye that is known, the ball is in an orange hull of so many of its radii, of which the back is seen."""


class BallActors:
    """Everything that stands where the ball is, in one browser's scene.

    A ball of 40 mm is some pixels in a view of the whole table. So where the browser's eye is known, it is a picture
    that faces the eye and is never smaller than a share of the view; else a sphere with an outline.
    """

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._ball = scene.add_icosphere(f"{root}/ball", BALL_RADIUS_M, CORE_RGB, visible=False, cast_shadow=False)
        self._hull = scene.add_icosphere(
            f"{root}/hull", HULL * BALL_RADIUS_M, BALL_RGB, side="back", visible=False, cast_shadow=False
        )
        self._sprite = _Sprite(scene, f"{root}/ball-sprite", ball_picture())
        self._truth_sprite = _Sprite(scene, f"{root}/truth-sprite", ring_picture(TRUTH_RGB))
        self._truth = scene.add_icosphere(
            f"{root}/truth",
            1.12 * BALL_RADIUS_M,
            TRUTH_RGB,
            wireframe=True,
            visible=False,
            subdivisions=2,
            cast_shadow=False,
        )
        self._shadow = ShadowActor(scene, f"{root}/shadow")
        self._rays = scene.add_line_segments(
            f"{root}/rays",
            np.zeros((1, 2, 3), np.float32),
            RAY_RGB,
            thickness=RAY_PX,
            thickness_units="screen",
            visible=False,
        )

    def show(self, ball: Array | None, truth: Array | None, eye: ViewCamera | None) -> None:
        """The ball (3,) as it was measured and the true one, seen from an eye; None hides them.

        The measured ball covers the true one where the two agree.
        """
        for handle, p in ((self._ball, ball), (self._hull, ball), (self._truth, truth)):
            _stand(handle, p if eye is None else None)
        radius_m = BALL_RADIUS_M if eye is None or ball is None else drawn_radius_m(eye, ball, BALL_RADIUS_M)
        shadow = None if ball is None else shadow_of(ball, radius_m)
        self._shadow.show(None if shadow is None or _behind_floor(shadow, eye) else shadow)
        if ball is None or eye is None:
            self._sprite.hide()
        else:
            self._sprite.show(ball, eye, radius_m, lift_before_floor_m(eye, ball, LIFT_M))
        covered = ball is not None and truth is not None and float(np.abs(truth - ball).max()) < 0.3 * radius_m
        if truth is None or eye is None or covered:
            self._truth_sprite.hide()
        else:
            lift_m = lift_before_floor_m(eye, truth, 0.9 * LIFT_M)
            self._truth_sprite.show(truth, eye, drawn_radius_m(eye, truth, BALL_RADIUS_M), lift_m)

    def show_rays(self, rays_world_m: Sequence[tuple[Array, Array]]) -> None:
        """From each camera that sees the ball to where it is seen; none hide them."""
        self._rays.visible = bool(rays_world_m)
        if rays_world_m:
            self._rays.points = np.array(rays_world_m, np.float32)


class _Sprite:
    """A picture that faces the eye. What did not change is not sent: each value costs the server 70 us.

    Unscaled it is as large as the ball itself: a browser may draw it for a frame before it has its scale.
    """

    def __init__(self, scene: viser.SceneApi, name: str, picture: NDArray[np.uint8]) -> None:
        size = 2 * GLOW_TO * BALL_RADIUS_M
        self._image = scene.add_image(
            name, picture, size, size, format="png", visible=False, cast_shadow=False, receive_shadow=False
        )
        self._wxyz: Array | None = None
        self._scale = 1.0

    def hide(self) -> None:
        self._image.visible = False

    def show(self, p_world_m: Array, eye: ViewCamera, radius_m: float, lift_m: float) -> None:
        """Stand before a point (3,), as large as `radius_m` is there."""
        pose = sprite_pose(eye, p_world_m, radius_m, lift_m)
        self._image.position = pose.p_world_m
        if self._wxyz is None or (pose.wxyz != self._wxyz).any():
            self._image.wxyz = self._wxyz = pose.wxyz
        scale = pose.scale / BALL_RADIUS_M
        if not 0.97 < scale / self._scale < 1.03:
            self._image.scale = self._scale = scale
        self._image.visible = True


def _behind_floor(shadow: Shadow, eye: ViewCamera | None) -> bool:
    """Lies on the floor beyond its middle, where it would be drawn with dark corners: see `lift_before_floor_m`."""
    p = np.array([shadow.x_m, shadow.y_m, shadow.z_m])
    return eye is not None and shadow.z_m < 0 and eye.depth_m(p) > eye.depth_m(FLOOR_MIDDLE)


def _stand(ball: viser.IcosphereHandle, p_world_m: Array | None) -> None:
    ball.visible = p_world_m is not None
    if p_world_m is not None:
        ball.position = p_world_m
