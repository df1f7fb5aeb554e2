"""The cameras as frusta, with their pictures in them where there is no panel for these."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import viser

from app.views.image_view import set_frustum_png
from core.cameras import Camera
from core.geometry import quaternion_from_matrix

FRUSTUM_RGB: Final = (150, 160, 178)
FRUSTUM_SCALE: Final = 0.10
PICTURE_SCALE: Final = 0.20


class RigActors:
    """One frustum a camera. Without pictures they hide nothing of what is behind them."""

    def __init__(self, scene: viser.SceneApi, root: str, cameras: dict[str, Camera], *, pictures: bool = False) -> None:
        blank = np.zeros((2, 2, 3), np.uint8) if pictures else None
        self._frame = scene.add_frame(root, show_axes=False)
        self._frusta = {
            name: scene.add_camera_frustum(
                f"{root}/{number}",
                fov=vertical_fov_rad(camera),
                aspect=camera.sensor.width_px / camera.sensor.height_px,
                scale=PICTURE_SCALE if pictures else FRUSTUM_SCALE,
                color=FRUSTUM_RGB,
                thickness=0.002,
                image=blank,
                format="png",
                wxyz=quaternion_from_matrix(camera.T_world_camera[:3, :3]),
                position=camera.T_world_camera[:3, 3],
            )
            for number, (name, camera) in enumerate(cameras.items())
        }

    def set_visible(self, visible: bool) -> None:
        """Show or hide all cameras of the rig."""
        self._frame.visible = visible

    def remove(self) -> None:
        """Take them out of the scene."""
        self._frame.remove()

    def show(self, pngs: dict[str, bytes]) -> None:
        """New pictures in the frusta."""
        for name, png in pngs.items():
            if name in self._frusta:
                set_frustum_png(self._frusta[name], png)


def vertical_fov_rad(camera: Camera) -> float:
    """Angle from the top edge of the picture to its bottom edge."""
    return 2 * math.atan(camera.sensor.height_px / 2 / float(camera.K[1, 1]))
