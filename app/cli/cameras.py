"""Which cameras a verb simulates with: a named placement, or a calibration file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Annotated

from app.cli.terminal import say
from core.cameras import Camera
from core.cameras.calibration_file import read_calibration_file
from core.cameras.presets import CORNERS, PLACEMENTS, SENSOR_720, camera_preset
from core.errors import CommandError
from core.events import SensorSize


def named_cameras(where: str, sensor: SensorSize | None) -> dict[str, Camera]:
    """The cameras of a placement, or of a calibration file, which says its own sensor.

    Raises:
        CommandError: if it is neither, or a sensor is given with a file.
    """
    if where in PLACEMENTS or where == CORNERS:
        return camera_preset(where, sensor or SENSOR_720)
    if not Path(where).exists():
        expected = f"{', '.join(PLACEMENTS)}, {CORNERS} or a calibration file"
        raise CommandError("no such cameras", expected=expected, got=repr(where), where="--cameras")
    if sensor is not None:
        raise CommandError("--sensor goes with a placement; a calibration file has its own", where="--sensor")
    return noted_calibration(Path(where))


def noted_calibration(path: Path) -> dict[str, Camera]:
    """The cameras of a calibration file; what had to be assumed about them is said on standard error.

    Raises:
        CalibrationError: if it is none.
    """
    found = read_calibration_file(path)
    for note in found.notes:
        say(f"{path.name}: {note}", error=True)
    return found.cameras


def sensor_size(text: str) -> SensorSize:
    """`1280x720` as argparse's type."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 4096 and 16 <= int(height) <= 4096):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT from 16 to 4096, such as 1280x720, got {text!r}")
    return SensorSize(int(width), int(height))


Sensor = Annotated[SensorSize, sensor_size]
