"""The arena: floor, table with lines and legs, net and posts, lights. World frame, metres."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser

from core.table import (
    CENTRE_LINE_WIDTH_M,
    LINE_WIDTH_M,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

FLOOR_RGB: Final = (46, 50, 60)
TABLE_RGB: Final = (18, 62, 120)
EDGE_RGB: Final = (12, 40, 80)
LINE_RGB: Final = (240, 240, 240)
NET_RGB: Final = (170, 175, 185)
DARK_RGB: Final = (24, 25, 28)
TOP_THICKNESS_M: Final = 0.025
ABOVE_M: Final = 0.0006
"""Lines float this far above the top, or the two would flicker."""
NET_MESH_M: Final = 0.04


def add_arena(scene: viser.SceneApi, root: str) -> None:
    """Add everything that does not move, below the node `root`."""
    _add_lights(scene, root)
    floor_z = -TABLE_HEIGHT_M
    scene.add_box(f"{root}/floor", FLOOR_RGB, (9.0, 6.0, 0.02), position=(0, 0, floor_z - 0.01), cast_shadow=False)
    top = (TABLE_LENGTH_M, TABLE_WIDTH_M, TOP_THICKNESS_M)
    scene.add_box(f"{root}/table/top", TABLE_RGB, top, position=(0, 0, -TOP_THICKNESS_M / 2))
    _add_lines(scene, f"{root}/table/lines")
    _add_legs(scene, f"{root}/table/legs")
    _add_net(scene, f"{root}/net")


def _add_lights(scene: viser.SceneApi, root: str) -> None:
    scene.add_light_directional(f"{root}/lights/key", color=(255, 236, 210), intensity=2.6, position=(-2.0, -3.0, 5.0))
    scene.add_light_directional(f"{root}/lights/fill", color=(190, 210, 255), intensity=0.7, position=(3.0, 3.0, 2.0))
    scene.add_light_hemisphere(
        f"{root}/lights/sky", sky_color=(255, 255, 255), ground_color=(70, 75, 90), intensity=1.1
    )


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
        scene.add_box(f"{name}/{stripe}", LINE_RGB, (*size, ABOVE_M), position=(x, y, ABOVE_M / 2), cast_shadow=False)


def _add_legs(scene: viser.SceneApi, name: str) -> None:
    length = TABLE_HEIGHT_M - TOP_THICKNESS_M
    for number, (x, y) in enumerate([(-1.1, -0.6), (-1.1, 0.6), (1.1, -0.6), (1.1, 0.6)]):
        position = (x, y, -TOP_THICKNESS_M - length / 2)
        scene.add_box(f"{name}/{number}", DARK_RGB, (0.05, 0.05, length), position=position)


def _add_net(scene: viser.SceneApi, name: str) -> None:
    half_width = TABLE_WIDTH_M / 2 + NET_OVERHANG_M
    scene.add_box(f"{name}/tape", LINE_RGB, (0.008, 2 * half_width, 0.012), position=(0, 0, NET_HEIGHT_M - 0.006))
    for side in (-1, 1):
        position = (0, side * half_width, NET_HEIGHT_M / 2)
        scene.add_box(f"{name}/post{side}", DARK_RGB, (0.02, 0.02, NET_HEIGHT_M), position=position)
    scene.add_line_segments(f"{name}/mesh", _net_strings(half_width), NET_RGB, thickness=0.0015)


def _net_strings(half_width: float) -> np.ndarray:
    """(N, 2, 3) ends of the strings."""
    ys = np.arange(-half_width, half_width, NET_MESH_M / 2)
    zs = np.arange(NET_MESH_M / 2, NET_HEIGHT_M, NET_MESH_M / 2)
    upright = [((0, y, 0), (0, y, NET_HEIGHT_M)) for y in ys]
    level = [((0, -half_width, z), (0, half_width, z)) for z in zs]
    return np.array(upright + level, np.float32)
