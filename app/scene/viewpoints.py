"""From where the 3D scene is looked at."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.rig import vertical_fov_rad
from app.views.viewpoint import Viewpoint
from core.cameras import Camera

Array = NDArray[np.float64]
View = Literal["Broadcast", "Side", "Top", "Robot", "Follow ball"]


VIEWPOINTS: Final[dict[str, Viewpoint]] = {
    "Broadcast": Viewpoint((2.75, -4.9, 2.4), (-0.1, 0.0, 0.0)),
    "Side": Viewpoint((-0.1, -6.0, 0.7), (-0.1, 0.0, 0.15)),
    "Top": Viewpoint((0.0, -0.01, 6.2), (0.0, 0.0, 0.0)),
    "Robot": Viewpoint((-3.6, -0.5, 1.1), (0.4, 0.0, 0.1)),
    "Follow ball": Viewpoint((1.9, -2.6, 1.3), (0.0, 0.0, 0.2)),
}


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
