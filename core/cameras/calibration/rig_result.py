"""What the calibration of a rig says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.bundle import POSITION, SIZE
from core.cameras.calibration.scale import ScaleFound
from core.cameras.camera import Camera

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class RigCamera:
    """One camera of the rig."""

    camera: Camera
    offset_us: float
    """Its clock minus the first camera's, in the middle of the sweep: its times minus this are on the first one's."""
    drift_ppm: float
    sigmas: dict[str, float]
    """Standard deviation of each of UNKNOWNS that was free: rad, metres, ms, ppm; see there for the lens."""
    uvs_px: Array
    """(G, K, 2) what it saw at the common instants, the lead taken off; nan where nothing."""
    residuals_px: Array
    """(G, K, 2) seen minus projected, also of what was left out."""
    used: Mask
    """(G, K)."""

    @property
    def errors_px(self) -> Array:
        """(N,) sizes of the residuals of used sightings."""
        sizes = np.linalg.norm(self.residuals_px, axis=2)[self.used]
        return sizes[np.isfinite(sizes)]

    @property
    def left_out(self) -> int:
        """Number of sightings that did not fit."""
        return int((np.isfinite(self.residuals_px[..., 0]) & ~self.used).sum())

    @property
    def sigma_offset_us(self) -> float:
        """0 where no offset was fitted."""
        return 1e3 * self.sigmas.get("offset_ms", 0.0)

    @property
    def sigma_position_m(self) -> float:
        """Root of the summed variances; 0 for a camera that defines the frame."""
        return self._root(("x", "y", "z"))

    @property
    def sigma_rotation_rad(self) -> float:
        """Root of the summed variances; 0 for a camera that defines the frame."""
        return self._root(("rx", "ry", "rz"))

    def _root(self, unknowns: Sequence[str]) -> float:
        return float(np.sqrt(sum(self.sigmas.get(key, 0.0) ** 2 for key in unknowns)))


@dataclass(frozen=True, slots=True, eq=False)
class RigCalibration:
    """What the calibration of a rig gives."""

    reports: dict[str, RigCamera]
    t_us: Array
    """(G,) common instants on the first camera's clock."""
    points_m: Array
    """(G, K, 3) the body's points in the world."""
    sigma_px: float
    """Noise of one sighting along one picture axis."""
    lead_px: float
    """How far the detections run ahead of the ball; 0 for a wand, where none is fitted."""
    sigma_lead_px: float
    covariance: Array
    """(13 C + 1, 13 C + 1) of UNKNOWNS by camera, then the lead."""
    scale: ScaleFound
    frame: str
    """What the world is, in words."""
    click_rms_px: float | None
    lengths_m: dict[str, Array]
    """By two markers such as 0-1: their distance at each instant, each marker triangulated on its own."""
    shared: NDArray[np.int64]
    """(C, C) sightings that each two cameras have in common."""
    notes: tuple[str, ...]

    @property
    def cameras(self) -> dict[str, Camera]:
        """By name, placed in the world."""
        return {name: report.camera for name, report in self.reports.items()}

    @property
    def used(self) -> Mask:
        """(G,) instants of which a sighting was used."""
        return np.any([report.used.any(axis=1) for report in self.reports.values()], axis=0)

    @property
    def sigma_scale(self) -> float:
        """Relative standard deviation of all lengths by what fixes the scale; 0 where only the adjustment knows it."""
        return self.scale.sigma_relative if np.isfinite(self.scale.sigma_relative) else 0.0

    @property
    def baseline_m(self) -> float:
        """Distance of the first two cameras."""
        return float(np.linalg.norm(self._along))

    @property
    def sigma_baseline_m(self) -> float:
        """Standard deviation of `baseline_m`."""
        slope = np.zeros(len(self.covariance))
        slope[POSITION] = -self._along / self.baseline_m
        slope[SIZE + POSITION.start : SIZE + POSITION.stop] = self._along / self.baseline_m
        return float(np.sqrt(max(slope @ self.covariance @ slope, 0.0)))

    @property
    def _along(self) -> Array:
        first, second = list(self.cameras.values())[:2]
        return second.position_world_m - first.position_world_m
