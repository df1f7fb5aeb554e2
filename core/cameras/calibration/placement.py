"""Where a rig stands in the world: by the table's corners, by the vertical, or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.bundle import Adjusted, Rig, Sightings, adjust
from core.cameras.calibration.scale import ScaleFound
from core.cameras.calibration.table_corners import CLICKS_AT_LEAST, Clicks, pose_from_clicks
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.geometry import make_transform

Array = NDArray[np.float64]

WORST_CLICKS_PX = 30.0
"""Rms of clicks that may be careless, but are of a table."""
STRAY_SIGMAS = 4.0
"""A clicked corner that is farther off is named."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A rig in metres, in the world."""

    adjusted: Adjusted
    sigma_baseline_m: float
    frame: str
    """What the world is, in words."""
    click_rms_px: float | None = None
    stray_clicks: tuple[tuple[int, str, float], ...] = ()
    """Camera, corner and distance in pixels of clicks that fit badly."""


def place_upright(adjusted: Adjusted, scale: ScaleFound) -> Placed:
    """The first camera at the origin; +z up and +x where it looks if gravity is known, else its own axes."""
    R_world_first, frame = upright_frame(scale)
    s = scale.metres_per_unit
    rig = adjusted.rig
    placed = Rig(R_world_first @ rig.Rs, s * rig.ps @ R_world_first.T, rig.offsets_us, rig.lead_px)
    stretch = np.eye(len(adjusted.covariance))
    stretch[:-1, :-1] = np.kron(np.eye(len(rig.ps)), _metres(R_world_first, s))
    covariance = stretch @ adjusted.covariance @ stretch.T
    return Placed(replace(adjusted, rig=placed, covariance=covariance), s * scale.sigma_relative, frame)


def upright_frame(scale: ScaleFound) -> tuple[Array, str]:
    """`R_world_first` (3, 3) of the first camera at the origin, and what the world then is, in words."""
    if scale.up is None:
        return np.eye(3), "the first camera's own axes"
    ahead = np.array([0.0, 0.0, 1.0]) - scale.up[2] * scale.up
    if np.linalg.norm(ahead) < 1e-3:  # it looks straight down: the top of its picture is ahead
        ahead = np.array([0.0, -1.0, 0.0])
    ahead /= np.linalg.norm(ahead)
    frame = "the first camera's place, z up by gravity, x where it looks"
    return np.stack([ahead, np.cross(scale.up, ahead), scale.up]), frame


def place_by_clicks(
    sightings: Sightings,
    adjusted: Adjusted,
    free: NDArray[np.bool_],
    scale: ScaleFound,
    poses: Mapping[int, tuple[Camera, Clicks]],
    click_sigma_px: float,
) -> Placed:
    """All cameras adjusted once more in the world, to the sightings and the clicked corners together.

    Raises:
        CalibrationError: if no camera has four clicks, or they are of no table.
    """
    anchor = max(poses, key=lambda k: len(poses[k][1].names))
    camera, clicks = poses[anchor]
    if len(clicks.names) < CLICKS_AT_LEAST:
        expected = f"{CLICKS_AT_LEAST} or more in a camera"
        raise CalibrationError("too few corners of the table", expected=expected, got=len(clicks.names))
    T_world_anchor = pose_from_clicks(camera, clicks, f"camera {anchor + 1}")
    rig, s = adjusted.rig, scale.metres_per_unit
    R_world_frame = T_world_anchor[:3, :3] @ rig.Rs[anchor].T
    ps = T_world_anchor[:3, 3] + s * (rig.ps - rig.ps[anchor]) @ R_world_frame.T
    start = Rig(R_world_frame @ rig.Rs, ps, rig.offsets_us, rig.lead_px)
    length_m = s

    def extra(moved: Rig) -> Array:
        errors = [_click_errors(moved, k, *poses[k]).ravel() / click_sigma_px for k in poses]
        known = np.isfinite(scale.sigma_relative)
        sigma_m = max(scale.sigma_relative, 1e-4) * length_m if known else 1.0
        baseline = [(float(np.linalg.norm(moved.ps[1] - moved.ps[0])) - length_m) / sigma_m] if known else []
        return np.concatenate([*errors, baseline])

    placed = adjust(sightings, start, free, extra)
    every = np.concatenate([_click_errors(placed.rig, k, *poses[k]) for k in poses])
    rms_px = float(np.sqrt((every**2).sum(axis=1).mean()))
    check_clicks(rms_px)
    along = placed.rig.ps[1] - placed.rig.ps[0]
    along = along / np.linalg.norm(along)
    slope = np.zeros(placed.covariance.shape[0])
    slope[3:6], slope[10:13] = -along, along
    sigma_m = float(np.sqrt(max(slope @ placed.covariance @ slope, 0.0)))
    stray = tuple(
        (k, name, float(off))
        for k, (_, clicked) in poses.items()
        for name, off in zip(
            clicked.names, np.linalg.norm(_click_errors(placed.rig, k, *poses[k]), axis=1), strict=True
        )
        if off > STRAY_SIGMAS * click_sigma_px
    )
    return Placed(placed, sigma_m, "the table's, by its corners", rms_px, stray)


def check_clicks(rms_px: float) -> None:
    """Raises CalibrationError where clicks are too far off to be of a table's corners."""
    if rms_px > WORST_CLICKS_PX:
        raise CalibrationError(
            "the clicked corners are not those of a table",
            expected=f"rms up to {WORST_CLICKS_PX:g} px",
            got=f"{rms_px:.0f} px",
            remedy="check the names of the corners and the lenses",
        )


def _click_errors(rig: Rig, k: int, camera: Camera, clicks: Clicks) -> Array:
    return click_errors(replace(camera, T_world_camera=make_transform(rig.Rs[k], rig.ps[k])), clicks)


def click_errors(camera: Camera, clicks: Clicks) -> Array:
    """(K, 2) clicked minus projected corners; far off where a corner is not before the camera."""
    errors = clicks.uvs_px - camera.project(clicks.ps_world_m)
    errors[np.isnan(errors)] = 1e4
    return np.asarray(errors, np.float64)


def _metres(R_world_first: Array, metres_per_unit: float) -> Array:
    """(7, 7): a camera's rotation is about its own axes and its clock is what it was; its position is turned."""
    stretch = np.eye(7)
    stretch[3:6, 3:6] = metres_per_unit * R_world_first
    return stretch
