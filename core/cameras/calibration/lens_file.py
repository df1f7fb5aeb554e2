"""A lens as a file: OpenCV's FileStorage YAML for names that end in .yaml or .yml, our own TOML for all others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2

from core.cameras.calibration_file import save_calibration
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.files import replace_file

YAML_SUFFIXES = (".yaml", ".yml")


def save_lens(path: Path, name: str, camera: Camera, *, notes: Mapping[str, float | str] | None = None) -> None:
    """Write one camera, replacing the file in one step. OpenCV's form has no names, but room for the notes.

    Raises:
        CalibrationError: if the file cannot be written.
    """
    if path.suffix.lower() not in YAML_SUFFIXES:
        save_calibration(path, {name: camera})
        return
    storage = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", camera.sensor.width_px)
    storage.write("image_height", camera.sensor.height_px)
    storage.write("camera_matrix", camera.K)
    storage.write("distortion_coefficients", camera.distortion[None])
    if camera.model == "fisheye":
        storage.write("distortion_model", "equidistant")
        storage.write("fisheye_model", 1)
    for key, value in (notes or {}).items():
        storage.write(key, value)
    try:
        replace_file(path, storage.releaseAndGetString().encode(), durable=True)
    except OSError as error:
        raise CalibrationError("cannot write the calibration", got=error.strerror, where=path) from error
