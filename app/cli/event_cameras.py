"""The source `camera:SERIAL[,SERIAL...]` of the command line: which cameras, and how they are opened."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final

from app.cli.arguments import flag
from app.cli.cameras import noted_calibration
from core.cameras import Camera
from core.errors import CommandError

if TYPE_CHECKING:
    from core.devices.neuromorphic import DriverCamera
    from core.live.camera_source import CameraSource
    from core.physics.config import PhysicsConfig

CAMERA: Final = "camera:"
FORM: Final = "camera:SERIAL or camera:SERIAL,SERIAL,..., for example camera:00050421,00050423"
PAIR: Final = ("left", "right")
READY_S: Final = 1.0
"""A camera that follows another's clock has to listen before that begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraArguments:
    """Flags of verbs that open event cameras."""

    TITLE: ClassVar = "event cameras (--source camera:...)"
    calibration: Path | None = flag("calibration of the cameras, in the order of the serials", "FILE")
    biases: Path | None = flag("biases to start with, as saved in Watch", "FILE.toml")
    sync_cable: bool = flag("a sync cable runs from the first camera to the others: all use its clock (EVK4)")


@dataclass(frozen=True, slots=True)
class CameraOrder:
    """Cameras by serial number, with their names in the session, and how they are opened."""

    serials: dict[str, str]
    """Serial number of each camera, by its name."""
    calibration: dict[str, Camera]
    biases: dict[str, dict[str, int]]
    """Biases by camera model."""
    cable: bool


def read_camera_order(source: str | None, arguments: CameraArguments) -> CameraOrder | None:
    """What is asked for; None for a source of another kind.

    Raises:
        CommandError: if no cameras are named, or one twice, or another source is given such flags.
        ConfigError: if the biases cannot be used.
        CalibrationError: if the calibration cannot be read.
        RecordingError: if it names a camera as no recording may.
        DeviceError: if no cameras are named, and there is no driver to list them.
    """
    if source is None or not source.startswith(CAMERA):
        if arguments.calibration is not None or arguments.biases is not None or arguments.sync_cable:
            what = "--calibration, --biases and --sync-cable are of event cameras"
            raise CommandError(what, expected="--source camera:SERIAL[,SERIAL...]", got=source or "another source")
        return None
    words = [word.strip() for word in source.removeprefix(CAMERA).split(",")]
    serials = [word for word in words if word]
    if not serials:
        raise CommandError("no camera is named", expected=FORM, got=_listed(), where="--source")
    if len(serials) < len(words) or len(set(serials)) < len(serials):
        raise CommandError("not one or more different cameras", expected=FORM, got=repr(source), where="--source")
    if arguments.sync_cable and len(serials) < 2:
        raise CommandError("a sync cable joins two cameras", expected=FORM, got=repr(source), where="--sync-cable")
    calibration = {} if arguments.calibration is None else noted_calibration(arguments.calibration)
    if calibration and len(calibration) != len(serials):
        got = f"{len(serials)} cameras, and {len(calibration)} in the file"
        raise CommandError("the calibration is of other cameras", got=got, where=arguments.calibration)
    from core.recordings.layout import check_camera_name

    for name in calibration:
        check_camera_name(name)
    names = list(calibration) or list(_names(serials))
    from core.devices.models import read_biases

    biases = {} if arguments.biases is None else read_biases(arguments.biases)
    return CameraOrder(dict(zip(names, serials, strict=True)), calibration, biases, arguments.sync_cable)


def _names(serials: list[str]) -> Sequence[str]:
    """What cameras without a calibration are called: three or more by their serial numbers."""
    if len(serials) <= 2:
        return PAIR if len(serials) == 2 else ("camera",)
    names = [re.sub(r"[^A-Za-z0-9_-]", "-", serial) for serial in serials]
    if len(set(names)) == len(names):
        return names
    return [f"{name}-{number}" for number, name in enumerate(names, 1)]  # they differ in what no name may hold


def open_cameras(order: CameraOrder, *, raw: bool = False) -> dict[str, DriverCamera]:
    """The open cameras by name. With a sync cable the first is opened last: the others wait for its clock.

    Raises:
        DeviceError: if there is no driver, or a camera cannot be opened; then none stays open.
        CommandError: if the calibration is of another sensor.
        ConfigError: if biases are out of the bounds of a camera.
    """
    from core.devices.neuromorphic import open_camera

    found: dict[str, DriverCamera] = {}
    names = list(order.serials)
    with ExitStack() as opened:
        for name in reversed(names) if order.cable else names:
            role = "own" if not order.cable else "leads" if name == names[0] else "follows"
            found[name] = open_camera(order.serials[name], role=role, biases=order.biases, raw=raw)
            opened.callback(found[name].close)
            known = order.calibration.get(name)
            if known is not None and known.sensor != found[name].model.sensor:
                got = f"{known.sensor} in the file, {found[name].model.sensor} of the camera"
                raise CommandError(f"the calibration of {name} is of another sensor", got=got, where="--calibration")
            if role == "follows":
                time.sleep(READY_S)
        opened.pop_all()
    return {name: found[name] for name in names}


def open_camera_source(order: CameraOrder, *, physics: PhysicsConfig | None = None) -> CameraSource:
    """The live source, which owns the cameras. `physics`: of the rally, if known.

    Raises:
        DeviceError: as `open_cameras`.
    """
    from core.live.camera_source import CameraSource

    return CameraSource(open_cameras(order), calibration=order.calibration, cable=order.cable, physics=physics)


def _listed() -> str:
    from core.devices.neuromorphic import describe_cameras, list_cameras

    return describe_cameras(list_cameras())
