"""The arena: ground, table with lines and legs, net and posts, lights; the cameras as frusta; and rackets, solid for
the real one, see-through for its target. World frame, metres.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import viser

from app.scene.painted import FLOOR_SIZE_M, floor_picture, net_picture
from core.cameras import Camera
from core.geometry import quaternion_from_matrix
from core.history.rally_picture import Pose
from core.table import (
    CENTRE_LINE_WIDTH_M,
    LINE_WIDTH_M,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

TABLE_RGB: Final = (40, 112, 205)
APRON_RGB: Final = (24, 72, 140)
LINE_RGB: Final = (250, 250, 250)
STEEL_RGB: Final = (206, 212, 222)
"""Colour of legs and posts, which stand out from the ground."""
TOP_THICKNESS_M: Final = 0.025
APRON_M: Final = (0.06, 0.05)
"""Height of the frame below the top, and how far it stands back."""
LEG_M: Final = 0.055
LEGS_M: Final = (1.1, 0.62)
"""Distance of the legs from the middle along x and y."""
BAR_ABOVE_FLOOR_M: Final = 0.12
ABOVE_M: Final = 0.0006
"""Lines float this far above the top, or the two would flicker."""
ACROSS_WXYZ: Final = quaternion_from_matrix(np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
"""Stands a picture up across the table: its columns run along +y, its rows along -z."""


def add_arena(scene: viser.SceneApi, root: str) -> None:
    """Add everything that does not move, below the node `root`."""
    _add_lights(scene, root)
    scene.add_image(
        f"{root}/floor",
        floor_picture(),
        *FLOOR_SIZE_M,
        format="png",
        cast_shadow=False,
        receive_shadow=False,
        position=(0, 0, -TABLE_HEIGHT_M),
    )
    _add_box(scene, f"{root}/table/top", TABLE_RGB, (TABLE_LENGTH_M, TABLE_WIDTH_M, TOP_THICKNESS_M), (0, 0, 0))
    _add_lines(scene, f"{root}/table/lines")
    _add_frame(scene, f"{root}/table/frame")
    _add_net(scene, f"{root}/net")


def _add_lights(scene: viser.SceneApi, root: str) -> None:
    scene.add_light_directional(f"{root}/lights/key", color=(255, 244, 228), intensity=2.4, position=(-2.0, -3.0, 5.0))
    scene.add_light_directional(f"{root}/lights/fill", color=(200, 216, 255), intensity=1.0, position=(3.0, 3.0, 2.0))
    scene.add_light_hemisphere(
        f"{root}/lights/sky", sky_color=(255, 255, 255), ground_color=(140, 148, 165), intensity=1.6
    )


def _add_box(
    scene: viser.SceneApi,
    name: str,
    rgb: tuple[int, int, int],
    size_m: tuple[float, float, float],
    top_middle_m: tuple[float, float, float],
) -> None:
    """A box by the middle of its upper side."""
    x, y, z = top_middle_m
    scene.add_box(name, rgb, size_m, position=(x, y, z - size_m[2] / 2), cast_shadow=False, receive_shadow=False)


def _add_lines(scene: viser.SceneApi, name: str) -> None:
    half_x, half_y = (TABLE_LENGTH_M - LINE_WIDTH_M) / 2, (TABLE_WIDTH_M - LINE_WIDTH_M) / 2
    stripes = {
        "end-robot": ((LINE_WIDTH_M, TABLE_WIDTH_M), (-half_x, 0)),
        "end-opponent": ((LINE_WIDTH_M, TABLE_WIDTH_M), (half_x, 0)),
        "side-left": ((TABLE_LENGTH_M, LINE_WIDTH_M), (0, half_y)),
        "side-right": ((TABLE_LENGTH_M, LINE_WIDTH_M), (0, -half_y)),
        "centre": ((TABLE_LENGTH_M, CENTRE_LINE_WIDTH_M), (0, 0)),
    }
    for stripe, (size, (x, y)) in stripes.items():
        _add_box(scene, f"{name}/{stripe}", LINE_RGB, (*size, ABOVE_M), (x, y, ABOVE_M))


def _add_frame(scene: viser.SceneApi, name: str) -> None:
    """What carries the top: a frame below it, legs, and a bar between the two legs of each end."""
    height, back = APRON_M
    frame = (TABLE_LENGTH_M - 2 * back, TABLE_WIDTH_M - 2 * back, height)
    _add_box(scene, f"{name}/apron", APRON_RGB, frame, (0, 0, -TOP_THICKNESS_M))
    top, (leg_x, leg_y) = -TOP_THICKNESS_M - height, LEGS_M
    for end in (-1, 1):
        for side in (-1, 1):
            size = (LEG_M, LEG_M, TABLE_HEIGHT_M + top)
            _add_box(scene, f"{name}/leg{end}{side}", STEEL_RGB, size, (end * leg_x, side * leg_y, top))
        size = (0.6 * LEG_M, 2 * leg_y, 0.6 * LEG_M)
        _add_box(scene, f"{name}/bar{end}", STEEL_RGB, size, (end * leg_x, 0, BAR_ABOVE_FLOOR_M - TABLE_HEIGHT_M))


def _add_net(scene: viser.SceneApi, name: str) -> None:
    half_width = TABLE_WIDTH_M / 2 + NET_OVERHANG_M
    _add_box(scene, f"{name}/tape", LINE_RGB, (0.010, 2 * half_width, 0.015), (0, 0, NET_HEIGHT_M))
    for side in (-1, 1):
        size = (0.022, 0.022, NET_HEIGHT_M + TOP_THICKNESS_M)
        _add_box(scene, f"{name}/post{side}", STEEL_RGB, size, (0, side * half_width, NET_HEIGHT_M))
    scene.add_image(
        f"{name}/mesh",
        net_picture(2 * half_width),
        2 * half_width,
        NET_HEIGHT_M,
        format="png",
        cast_shadow=False,
        receive_shadow=False,
        wxyz=ACROSS_WXYZ,
        position=(0, 0, NET_HEIGHT_M / 2),
    )


BLADE_RADIUS_M: Final = 0.08
"""Radius of the simulated racket's blade, m."""
RUBBER_M: Final = 0.006
FRONT_RGB: Final = (235, 32, 40)
BACK_RGB: Final = (40, 42, 48)
HANDLE_RGB: Final = (176, 122, 66)
HANDLE_M: Final = (0.022, 0.028, 0.11)
TARGET_RGB: Final = (0, 205, 255)
_TO_X: Final = quaternion_from_matrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
"""Turns a cylinder, whose axis is z, to the face's normal, +x."""


class RacketActor:
    """One racket in one browser's scene. The middle of its face is the origin, the normal +x, the handle hangs down."""

    def __init__(self, scene: viser.SceneApi, name: str, *, ghost: bool = False) -> None:
        self._frame = scene.add_frame(name, show_axes=False, visible=False)
        self._pose: Pose | None = None
        opacity = 0.45 if ghost else None
        for part, colour, x in (("front", FRONT_RGB, -0.5), ("back", BACK_RGB, -1.5)):
            scene.add_cylinder(
                f"{name}/{part}",
                BLADE_RADIUS_M,
                RUBBER_M,
                color=TARGET_RGB if ghost else colour,
                opacity=opacity,
                wxyz=_TO_X,
                position=(x * RUBBER_M, 0.0, 0.0),
                cast_shadow=False,
            )
        scene.add_box(
            f"{name}/handle",
            TARGET_RGB if ghost else HANDLE_RGB,
            HANDLE_M,
            opacity=opacity,
            position=(-RUBBER_M, 0.0, -BLADE_RADIUS_M - 0.9 * HANDLE_M[2] / 2),
            cast_shadow=False,
        )

    def show(self, pose: Pose | None) -> None:
        """Stand there; None hides it."""
        self._frame.visible = pose is not None
        if pose is None:
            return
        if self._pose is None or pose.p_world_m is not self._pose.p_world_m:  # neighbouring moments share what stands
            self._frame.position = pose.p_world_m
        if self._pose is None or pose.wxyz is not self._pose.wxyz:
            self._frame.wxyz = pose.wxyz
        self._pose = pose


FRUSTUM_RGB: Final = (150, 160, 178)
FRUSTUM_SCALE: Final = 0.10


class RigActors:
    """One frustum a camera, without a picture: they hide nothing of what is behind them."""

    def __init__(self, scene: viser.SceneApi, root: str, cameras: dict[str, Camera]) -> None:
        self._frame = scene.add_frame(root, show_axes=False)
        for number, camera in enumerate(cameras.values()):
            scene.add_camera_frustum(
                f"{root}/{number}",
                fov=vertical_fov_rad(camera),
                aspect=camera.sensor.width_px / camera.sensor.height_px,
                scale=FRUSTUM_SCALE,
                color=FRUSTUM_RGB,
                thickness=0.002,
                cast_shadow=False,  # a player that loops draws viser's own lamps, with shadows, for a moment
                wxyz=quaternion_from_matrix(camera.T_world_camera[:3, :3]),
                position=camera.T_world_camera[:3, 3],
            )

    def set_visible(self, visible: bool) -> None:
        """Show or hide all cameras of the rig."""
        self._frame.visible = visible

    def remove(self) -> None:
        """Take them out of the scene."""
        self._frame.remove()


def vertical_fov_rad(camera: Camera) -> float:
    """Angle from the top edge of the picture to its bottom edge."""
    return 2 * math.atan(camera.sensor.height_px / 2 / float(camera.K[1, 1]))
