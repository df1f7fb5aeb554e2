"""Camera models: intrinsics with distortion, poses in the world, projection, calibration files."""

from core.cameras.camera import Camera

__all__ = ["Camera"]
