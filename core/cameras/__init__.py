"""Camera models: intrinsics with distortion, poses in the world, projection, outlines of balls, calibration files."""

from core.cameras.calibration_file import load_calibration, save_calibration
from core.cameras.camera import Camera
from core.cameras.outline import BallCircles, ball_circles, ball_outline
from core.cameras.presets import stereo_preset

__all__ = [
    "BallCircles",
    "Camera",
    "ball_circles",
    "ball_outline",
    "load_calibration",
    "save_calibration",
    "stereo_preset",
]
