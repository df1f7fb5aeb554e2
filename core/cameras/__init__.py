"""Camera models: intrinsics with distortion, poses, projection, ball outlines, triangulation, calibration files."""

from core.cameras.calibration_file import load_calibration, save_calibration
from core.cameras.camera import Camera
from core.cameras.outline import BallCircles, ball_circles, ball_outline
from core.cameras.presets import stereo_preset
from core.cameras.stereo import StereoRig, TriangulatedPoint, TriangulationConfig

__all__ = [
    "BallCircles",
    "Camera",
    "StereoRig",
    "TriangulatedPoint",
    "TriangulationConfig",
    "ball_circles",
    "ball_outline",
    "load_calibration",
    "save_calibration",
    "stereo_preset",
]
