"""Where a rig stands in the world: by the table's corners, by the vertical, or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.body_tracks import BodyTracks
from core.cameras.calibration.bundle import POSITION, SIZE, Adjusted, Rig, adjust_rig
from core.cameras.calibration.rig_chain import scaled_rig
from core.cameras.calibration.scale import WAND_SIGMA, ScaleFound
from core.cameras.calibration.table_corners import CLICKS_AT_LEAST, Clicks, pose_from_clicks
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.geometry import invert_transform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WORST_CLICKS_PX: Final = 30.0
"""Rms of clicks that may be careless, but are of a table."""
STRAY_SIGMAS: Final = 4.0
"""A clicked corner that is farther off is named."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A rig in metres, in the world."""

    adjusted: Adjusted
    frame: str
    """What the world is, in words."""
    click_rms_px: float | None = None
    notes: tuple[str, ...] = ()
    """Clicks that fit badly."""


def place_upright(adjusted: Adjusted, scale: ScaleFound) -> Placed:
    """The first camera at the origin; +z up and +x where it looks if gravity is known, else its own axes."""
    R_world_first, frame = _upright_frame(scale)
    rig = scaled_rig(adjusted.rig, scale.metres_per_unit, R_world_first)
    stretch, by_scale = np.eye(len(adjusted.covariance)), np.zeros(len(adjusted.covariance))
    for c, camera in enumerate(rig.cameras):
        rows = slice(c * SIZE + POSITION.start, c * SIZE + POSITION.stop)
        stretch[rows, rows] = scale.metres_per_unit * R_world_first
        by_scale[rows] = camera.position_world_m
    sigma = scale.sigma_relative if np.isfinite(scale.sigma_relative) else 0.0
    covariance = stretch @ adjusted.covariance @ stretch.T + sigma**2 * np.outer(by_scale, by_scale)
    return Placed(replace(adjusted, rig=rig, covariance=covariance), frame)


def _upright_frame(scale: ScaleFound) -> tuple[Array, str]:
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
    tracks: BodyTracks,
    adjusted: Adjusted,
    free: Mask,
    scale: ScaleFound,
    clicks: Mapping[int, Clicks],
    click_sigma_px: float,
) -> Placed:
    """All cameras adjusted once more in the world, to the sightings and the clicked corners together.

    Args:
        tracks: the sightings.
        adjusted: the rig before, in a frame of its own.
        free: (13 C + 1,) what may change beside the first camera's pose.
        scale: metres per unit of that rig, kept as well as it is known.
        clicks: the corners by a camera's number.
        click_sigma_px: standard deviation of a click along each picture axis.

    Raises:
        CalibrationError: if no camera has four clicks, or they are of no table.
    """
    anchor = max(clicks, key=lambda k: len(clicks[k].names))
    if len(clicks[anchor].names) < CLICKS_AT_LEAST:
        expected, got = f"{CLICKS_AT_LEAST} or more in a camera", len(clicks[anchor].names)
        raise CalibrationError("too few corners of the table", expected=expected, got=got)
    metric = scaled_rig(adjusted.rig, scale.metres_per_unit)
    T_world_anchor = pose_from_clicks(metric.cameras[anchor], clicks[anchor], tracks.names[anchor])
    T_world_frame = T_world_anchor @ invert_transform(metric.cameras[anchor].T_world_camera)
    cameras = tuple(replace(one, T_world_camera=T_world_frame @ one.T_world_camera) for one in metric.cameras)
    start = replace(metric, cameras=cameras)
    # A body of known size is in the sightings already; the corners are the scale where nothing else is.
    known = len(tracks.body_m) == 1 and np.isfinite(scale.sigma_relative)
    sigma_m = max(scale.sigma_relative, WAND_SIGMA) * start.baseline if known else 1.0

    def extra(rig: Rig) -> Array:
        errors = [_click_errors(rig.cameras[k], found).ravel() / click_sigma_px for k, found in clicks.items()]
        return np.concatenate([*errors, [(rig.baseline - start.baseline) / sigma_m] if known else []])

    free = free.copy()
    free[:6] = True
    placed = adjust_rig(tracks, start, adjusted.t_us, free, extra)
    off = {k: np.linalg.norm(_click_errors(placed.rig.cameras[k], found), axis=1) for k, found in clicks.items()}
    rms_px = float(np.sqrt(np.mean(np.concatenate(list(off.values())) ** 2)))
    if rms_px > WORST_CLICKS_PX:
        raise CalibrationError(
            "the clicked corners are not those of a table",
            expected=f"rms up to {WORST_CLICKS_PX:g} px",
            got=f"{rms_px:.0f} px",
            remedy="check the names of the corners and the lenses",
        )
    notes = tuple(
        f"the corner {corner} of {tracks.names[k]} is {error:.1f} px off"
        for k, found in clicks.items()
        for corner, error in zip(found.names, off[k].tolist(), strict=True)
        if error > STRAY_SIGMAS * click_sigma_px
    )
    return Placed(placed, "the table's, by its corners", rms_px, notes)


def _click_errors(camera: Camera, clicks: Clicks) -> Array:
    """(K, 2) clicked minus projected corners; far off where a corner is not before the camera."""
    errors = clicks.uvs_px - camera.project(clicks.ps_world_m)
    errors[np.isnan(errors)] = 1e4
    return np.asarray(errors, np.float64)
