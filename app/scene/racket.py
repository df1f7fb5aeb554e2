"""A racket: blade with a red and a black rubber, and a handle. Solid for the real one, see-through for its target."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser

from core.geometry import quaternion_from_matrix
from core.history.rally_picture import Pose

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
