"""A calibration from clicked corners of the table: all cameras placed, and both files written under a new name."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.cameras.calibration.table_corners import Clicks
from core.cameras.calibration.table_pose import TablePose, clicks_of, find_table_pose
from core.cameras.calibration_file import save_calibration
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.files import replace_file

MAX_NAMES: Final = 1000


@dataclass(frozen=True, slots=True)
class TableFiles:
    """What was written."""

    calibration: Path
    corners: Path
    """For `calibrate stereo --table-corners`."""


def place_at_table(lenses: Mapping[str, Camera | None], clicks: Mapping[str, Clicks]) -> dict[str, TablePose]:
    """Each camera's pose, in the order of `lenses`.

    Raises:
        CalibrationError: if a lens is not known, or the clicks of a camera fix no pose.
    """
    found = {}
    for name, lens in lenses.items():
        if lens is None:
            remedy = "calibrate it (`rallyscope calibrate intrinsics`) and give the file with --calibration"
            raise CalibrationError(f"the lens of {name} is not known", remedy=remedy)
        found[name] = find_table_pose(name, lens, clicks.get(name) or clicks_of({}))
    return found


def write_table_calibration(
    folder: Path, stem: str, poses: Mapping[str, TablePose], clicks: Mapping[str, Clicks]
) -> TableFiles:
    """Write the calibration and the clicks as STEM.toml and STEM.csv; a number is added where the name is taken.

    Raises:
        CalibrationError: if they cannot be written.
    """
    calibration = _new_file(folder, stem)
    save_calibration(calibration, {name: pose.camera for name, pose in poses.items()})
    corners, text = calibration.with_suffix(".csv"), io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("camera", "corner", "u_px", "v_px"))
    for camera, clicked in clicks.items():
        for corner, (u_px, v_px) in zip(clicked.names, clicked.uvs_px.tolist(), strict=True):
            writer.writerow((camera, corner, f"{u_px:.2f}", f"{v_px:.2f}"))
    try:
        replace_file(corners, text.getvalue().encode(), durable=True)
    except OSError as error:
        raise CalibrationError("cannot write the corners", got=error.strerror, where=corners) from error
    return TableFiles(calibration, corners)


def _new_file(folder: Path, stem: str) -> Path:
    """An empty file of a name that was free, of which the other is free too."""
    for number in range(1, MAX_NAMES):
        path = folder / (f"{stem}.toml" if number == 1 else f"{stem}-{number}.toml")
        if path.with_suffix(".csv").exists():
            continue
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path.touch(exist_ok=False)
        except FileExistsError:
            continue
        except OSError as error:
            raise CalibrationError("cannot write the calibration", got=error.strerror, where=path) from error
        return path
    raise CalibrationError("no free name for the calibration", where=folder / stem)
