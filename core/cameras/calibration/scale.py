"""How long a metre is: pictures alone do not say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.bundle import Rig
from core.cameras.calibration.free_fall import REAL_DRAG_PER_M, measure_gravity
from core.cameras.calibration.table_corners import Clicks, pose_from_clicks
from core.cameras.calibration.triangulation import point_information, points_of
from core.errors import CalibrationError

Array = NDArray[np.float64]
Kind = Literal["baseline", "wand", "gravity", "table"]

KINDS: Final = ("baseline", "wand", "gravity", "table")
WAND_SIGMA: Final = 1e-4
"""Relative, of a wand's or a board's size."""
LONGEST_M: Final = 100.0


@dataclass(frozen=True, slots=True)
class Scale:
    """What fixes the scale."""

    kind: Kind
    length_m: float = 0.0
    """Between the first two cameras' optical centres, or between a wand's markers 0 and 1."""
    drag_per_m: float = REAL_DRAG_PER_M
    """Drag of the flights that gravity is read from; 0 where there is no air."""

    def __post_init__(self) -> None:
        if self.kind in ("baseline", "wand") and not 1e-3 <= self.length_m <= LONGEST_M:
            raise CalibrationError(f"impossible {self.kind}", expected="0.001 to 100 m", got=f"{self.length_m:g} m")

    @property
    def body_m(self) -> Array:
        """Places (K, 3) of the markers on what was swept: 0 and 1 of a wand of known length, else a single point."""
        return np.array([[0.0, 0.0, 0.0], [self.length_m, 0.0, 0.0]]) if self.kind == "wand" else np.zeros((1, 3))


@dataclass(frozen=True, slots=True, eq=False)
class ScaleFound:
    """The scale of a rig whose first two cameras are 1 apart, or which is in metres already."""

    kind: Kind
    metres_per_unit: float
    sigma_relative: float
    up: Array | None = None
    """(3,) the vertical in the first camera's frame, where gravity says it."""
    sigma_up_rad: float = 0.0
    origin: str = ""
    """What it rests on, in words."""


def measure_scale(
    scale: Scale, t_us: Array, rig: Rig, xys: Array, sigma_px: float, clicks: Mapping[int, Clicks]
) -> ScaleFound:
    """The scale of a rig of baseline 1 from what was seen of single points.

    Args:
        scale: what fixes it; a wand fixes the rig's unit before, by its markers.
        t_us: (N,) common instants.
        rig: its first two cameras are 1 apart.
        xys: (N, C, 2) pinhole coordinates, nan where nothing fits.
        sigma_px: standard deviation of a sighting along one picture axis.
        clicks: the table's corners by a camera's number.

    Raises:
        CalibrationError: if what should fix it does not.
    """
    if scale.kind == "wand":
        expected = "a baseline, gravity, the table's corners, or the places of the wand's markers"
        raise CalibrationError("no scale", expected=expected, got="a single point")
    if scale.kind == "baseline":
        return ScaleFound("baseline", scale.length_m, 0.0, origin="the given baseline")
    if scale.kind == "table":
        return _from_table(rig, clicks)
    ps = points_of(rig.poses, xys, rig.focals_px)
    information = point_information(rig.poses, ps, xys, rig.focals_px, sigma_px)
    gravity = measure_gravity(t_us, ps, information, drag_per_m=scale.drag_per_m)
    origin = f"gravity over {gravity.arcs} arcs, {gravity.points} points"
    return ScaleFound(
        "gravity", gravity.metres_per_unit, gravity.sigma_relative, gravity.up, gravity.sigma_up_rad, origin
    )


def body_scale(body_m: Array, times: int) -> ScaleFound:
    """The scale of a rig in metres, by a body (K, 3) of known size that was seen so many times."""
    kind = "the wand" if np.linalg.matrix_rank(body_m, tol=1e-9) < 2 else "the board"
    return ScaleFound("wand", 1.0, WAND_SIGMA, origin=f"{kind} at {times} times")


def _from_table(rig: Rig, clicks: Mapping[int, Clicks]) -> ScaleFound:
    """From the distance of the first two cameras whose clicks place them; the adjustment with the clicks refines it."""
    (a, first), (b, second) = list(clicks.items())[:2]
    there = [pose_from_clicks(rig.cameras[k], found, f"camera {k + 1}") for k, found in ((a, first), (b, second))]
    distance_m = float(np.linalg.norm(there[0][:3, 3] - there[1][:3, 3]))
    units = float(np.linalg.norm(rig.cameras[a].position_world_m - rig.cameras[b].position_world_m))
    return ScaleFound("table", distance_m / units, np.inf, origin="the table's corners")
