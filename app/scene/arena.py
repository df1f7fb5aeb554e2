"""The arena: ground, table with lines and legs, net and posts, lights. World frame, metres."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser

from app.scene.painted import FLOOR_SIZE_M, floor_picture, net_picture
from core.geometry import quaternion_from_matrix
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
