"""Where cameras stand, from named points of the table that a person clicked in their pictures; lenses are known.

All cameras are placed, and both calibration files written under a new name.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.table_corners import CLICKS_AT_LEAST, CORNERS, Clicks, pose_from_clicks
from core.cameras.calibration_file import save_calibration
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.files import claimed, numbered, replace_file
from core.geometry import make_transform

Array = NDArray[np.float64]

WORST_RMS_PX: Final = 8.0
"""Clicks that are farther off are not of these corners."""
CLICK_SIGMA_PX: Final = 1.0
"""Least error that a person is believed to make along each picture axis."""
LARGEST_SIGMA_M: Final = 0.1
"""A place that is known no better is refused."""
NARROWEST_M: Final = 0.1
"""Points of the table that lie closer to one line are on it."""
STEP: Final = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class TablePose:
    """One camera in the table's frame."""

    camera: Camera
    names: tuple[str, ...]
    errors_px: Array
    """(K,) distances of the clicks from where the corners then are."""
    sigma_m: float
    """Standard deviation of the camera's place (root of the sum over the axes)."""

    @property
    def rms_px(self) -> float:
        """Root mean square of the distances."""
        return float(np.sqrt(np.mean(np.square(self.errors_px))))


def find_table_pose(name: str, lens: Camera, clicks: Clicks) -> TablePose:
    """The pose of a camera whose lens is known; that of `lens` is not used.

    Raises:
        CalibrationError: if the clicks are too few, on one line, of other corners than they are named, or so that they
            leave the camera's place open.
    """
    missing = CLICKS_AT_LEAST - len(clicks.names)
    if missing > 0:
        got = f"{len(clicks.names)} in {name}"
        raise CalibrationError("too few corners of the table", expected=f"{CLICKS_AT_LEAST} or more", got=got)
    ps = clicks.ps_world_m
    # The second singular value is the spread across the line on which they nearly lie.
    if np.linalg.svd(ps - ps.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(ps)) < NARROWEST_M:
        remedy = "click corners of both sides of the table"
        raise CalibrationError(f"the corners clicked in {name} lie on one line", got=list(clicks.names), remedy=remedy)
    placed = replace(lens, T_world_camera=pose_from_clicks(lens, clicks, name))
    errors = np.linalg.norm(clicks.uvs_px - placed.project(ps), axis=1)
    errors[np.isnan(errors)] = np.inf
    rms_px = float(np.sqrt(np.mean(np.square(errors))))
    if not rms_px <= WORST_RMS_PX:
        got = f"{rms_px:.0f} px, most at {clicks.names[int(np.argmax(errors))]}" if np.isfinite(rms_px) else "no pose"
        raise CalibrationError(
            f"the corners clicked in {name} contradict each other",
            expected=f"rms up to {WORST_RMS_PX:g} px",
            got=got,
            remedy="check their names: left and right are as the robot sees them",
        )
    # Over the root of 2: along one picture axis. Four clicks can fit better than anybody clicks.
    sigma_m = _sigma_m(placed, ps, max(rms_px / np.sqrt(2), CLICK_SIGMA_PX))
    if not sigma_m <= LARGEST_SIGMA_M:
        got = f"+-{100 * sigma_m:.0f} cm"
        remedy = "click corners that are farther apart"
        raise CalibrationError(f"the corners leave open where {name} stands", got=got, remedy=remedy)
    return TablePose(placed, clicks.names, errors, sigma_m)


def _sigma_m(camera: Camera, ps: Array, click_sigma_px: float) -> float:
    """Standard deviation of the camera's position, m, from the Jacobian of the pixels in its six unknowns."""
    from scipy.spatial.transform import Rotation  # loaded late, because the app's page waits for this module

    T = camera.T_world_camera
    slopes = np.empty((2 * len(ps), 6))
    here = camera.project(ps)
    for unknown in range(6):
        step = np.zeros(6)
        step[unknown] = STEP
        moved = make_transform(T[:3, :3] @ Rotation.from_rotvec(step[:3]).as_matrix(), T[:3, 3] + step[3:])
        slopes[:, unknown] = (replace(camera, T_world_camera=moved).project(ps) - here).ravel() / STEP
    try:
        covariance = click_sigma_px**2 * np.linalg.inv(slopes.T @ slopes)
    except np.linalg.LinAlgError:
        return float("inf")
    return float(np.sqrt(np.trace(covariance[3:, 3:])))


def clicks_of(marks: Mapping[str, tuple[float, float]]) -> Clicks:
    """Named clicks; those that are no points of the table are left out."""
    known = {name: at for name, at in marks.items() if name in CORNERS}
    return Clicks(tuple(known), np.array(list(known.values()), np.float64).reshape(-1, 2))


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
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("camera", "corner", "u_px", "v_px"))
    for camera, clicked in clicks.items():
        for corner, (u_px, v_px) in zip(clicked.names, clicked.uvs_px.tolist(), strict=True):
            writer.writerow((camera, corner, f"{u_px:.2f}", f"{v_px:.2f}"))
    names = (folder / f"{name}.toml" for name in numbered(stem))
    try:
        with claimed(path for path in names if not path.with_suffix(".csv").exists()) as calibration:
            save_calibration(calibration, {name: pose.camera for name, pose in poses.items()})
            corners = calibration.with_suffix(".csv")
            replace_file(corners, text.getvalue().encode(), durable=True)
    except OSError as error:
        raise CalibrationError("cannot write the calibration", got=error.strerror, where=folder / stem) from error
    return TableFiles(calibration, corners)
