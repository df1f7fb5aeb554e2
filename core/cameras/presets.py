"""Cameras to simulate with: stereo pairs round the robot's half of the table, and four at the corners."""

from __future__ import annotations

from typing import Final

import numpy as np

from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import look_at

SENSOR_720: Final = SensorSize(1280, 720)
"""The sensor of the paper's real set-up."""
SENSOR_1280: Final = SensorSize(1280, 1280)
"""The sensor of the paper's simulation."""
FOCAL_PX: Final = 1000.0
"""A 5 mm lens on 4.86 um pixels: 65 degrees across 1280 pixels; a ball 1 to 3.3 m away has r = 20 to 6 px."""
DISTORTION: Final = (-0.06, 0.01, 0.0003, -0.0002, 0.0)
"""A mild lens (24 px at the corners of 1280x720), so that nothing works by forgetting to undistort."""

PLACEMENTS: Final[dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]]] = {
    "side": ((-1.15, 1.75, 1.15), (-0.45, 0.0, 0.12)),
    "ceiling": ((-0.75, 0.75, 2.0), (-0.55, 0.0, 0.1)),
    "behind": ((-2.4, 0.9, 1.3), (-0.3, 0.0, 0.15)),
}
"""Position of the left camera (+y) and the point it looks at, metres; the right camera is its mirror image."""
CORNERS: Final = "corners"
"""A rig of four: a pair behind the robot's corners of the table, and one behind the opponent's."""
PRESETS: Final = (*PLACEMENTS, CORNERS)
"""Names of all presets."""
_CORNER_PAIRS: Final = {"near": (-1.9, 1.7, 1.4), "far": (1.5, 1.8, 1.5)}
"""Position of the left camera of each pair; all look at the robot's half."""
_CORNERS_LOOK_AT: Final = (-0.3, 0.0, 0.1)


def stereo_preset(placement: str = "side", sensor: SensorSize = SENSOR_720) -> dict[str, Camera]:
    """The cameras `left` and `right` of a placement.

    Raises:
        CalibrationError: if there is no such placement.
    """
    if placement not in PLACEMENTS:
        raise CalibrationError(f"no camera preset {placement!r}", expected=f"one of {', '.join(PLACEMENTS)} or a file")
    return _pair(*PLACEMENTS[placement], sensor)


def camera_preset(name: str, sensor: SensorSize = SENSOR_720) -> dict[str, Camera]:
    """The cameras of a placement, or the four of `corners`: `near_left`, `near_right`, `far_left`, `far_right`.

    Raises:
        CalibrationError: if there is no such preset.
    """
    if name != CORNERS:
        return stereo_preset(name, sensor)
    return {
        f"{end}_{side}": camera
        for end, position in _CORNER_PAIRS.items()
        for side, camera in _pair(position, _CORNERS_LOOK_AT, sensor).items()
    }


def _pair(
    position: tuple[float, float, float], target: tuple[float, float, float], sensor: SensorSize
) -> dict[str, Camera]:
    (x, y, z), (target_x, target_y, target_z) = position, target
    K = np.array([[FOCAL_PX, 0, (sensor.width_px - 1) / 2], [0, FOCAL_PX, (sensor.height_px - 1) / 2], [0, 0, 1]])
    return {
        name: Camera(sensor, K, np.array(DISTORTION), look_at((x, side * y, z), (target_x, side * target_y, target_z)))
        for name, side in (("left", 1.0), ("right", -1.0))
    }
