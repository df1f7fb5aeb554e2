"""What the calibration of a rig says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.scale import ScaleFound
from core.cameras.camera import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class CameraFit:
    """One camera of the rig."""

    camera: Camera
    offset_us: float
    """Its clock minus the first camera's: its times minus this are on the first one's clock."""
    sigma_offset_us: float
    sigma_position_m: float
    """Root of the summed variances; 0 for a camera that defines the frame."""
    sigma_rotation_rad: float
    uvs_px: Array
    """(N, 2) what it saw at the common instants, the lead taken off; nan where nothing."""
    residuals_px: Array
    """(N, 2) seen minus projected."""


@dataclass(frozen=True, slots=True, eq=False)
class RigCalibration:
    """What the calibration of a rig gives."""

    fits: dict[str, CameraFit]
    t_us: Array
    """(N,) the common instants, on the first camera's clock."""
    ps_world_m: Array
    """(N, 3)."""
    used: NDArray[np.bool_]
    """(N,) instants that were not left out."""
    sigma_px: float
    """Noise of one sighting along one picture axis."""
    lead_px: float
    """How far the detections run ahead of the ball; 0 for a wand, where none is fitted."""
    sigma_lead_px: float
    scale: ScaleFound
    baseline_m: float
    """Between the first two cameras."""
    sigma_baseline_m: float
    frame: str
    """What the world is, in words."""
    click_rms_px: float | None
    notes: tuple[str, ...]

    @property
    def cameras(self) -> dict[str, Camera]:
        """By name, placed in the world."""
        return {name: fit.camera for name, fit in self.fits.items()}
