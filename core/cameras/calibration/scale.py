"""How long a metre is: pictures alone do not say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.bundle import Adjusted, Sightings, point_information, points_of
from core.cameras.calibration.free_fall import REAL_DRAG_PER_M, measure_gravity
from core.cameras.calibration.table_corners import Clicks, pose_from_clicks
from core.cameras.camera import Camera
from core.errors import CalibrationError

Array = NDArray[np.float64]
Kind = Literal["baseline", "wand", "gravity", "table"]

KINDS: Final = ("baseline", "wand", "gravity", "table")
WAND_SIGHTINGS: Final = 20
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


@dataclass(frozen=True, slots=True, eq=False)
class ScaleFound:
    """The scale of a rig whose first two cameras are 1 apart."""

    kind: Kind
    metres_per_unit: float
    sigma_relative: float
    up: Array | None = None
    """(3,) the vertical in the first camera's frame, where gravity says it."""
    sigma_up_rad: float = 0.0
    origin: str = ""
    """What it rests on, in words."""


def measure_scale(
    scale: Scale,
    sightings: Sightings,
    marker: NDArray[np.int64],
    adjusted: Adjusted,
    poses: Mapping[int, tuple[Camera, Clicks]],
    at_marker: Callable[[Array, NDArray[np.int64]], Sightings],
) -> ScaleFound:
    """The scale of an adjusted rig of baseline 1; `poses` has the lenses and clicks of cameras by their number.

    `at_marker` gives the sightings of other markers at other times.

    Raises:
        CalibrationError: if what should fix it does not.
    """
    if scale.kind == "baseline":
        return ScaleFound("baseline", scale.length_m, 0.0, origin="the given baseline")
    if scale.kind == "table":
        return _from_table(adjusted, poses)
    rig = adjusted.rig
    if scale.kind == "wand":
        t_us = sightings.t_us[(marker == 0) & adjusted.used]
        ends = [at_marker(t_us, np.full(len(t_us), which)) for which in (0, 1)]
        zero, one = (points_of(rig, end.of(rig), end.focals_px) for end in ends)
        return _from_wand(scale.length_m, np.linalg.norm(one - zero, axis=1))
    xys = sightings.of(rig)
    ps = points_of(rig, xys, sightings.focals_px)
    ps[~adjusted.used] = np.nan
    information = point_information(rig, ps, xys, sightings.focals_px, adjusted.sigma_px)
    gravity = measure_gravity(sightings.t_us, ps, information, drag_per_m=scale.drag_per_m)
    origin = f"gravity over {gravity.arcs} arcs, {gravity.points} points"
    return ScaleFound(
        "gravity", gravity.metres_per_unit, gravity.sigma_relative, gravity.up, gravity.sigma_up_rad, origin
    )


def _from_wand(length_m: float, lengths: Array) -> ScaleFound:
    """From the distances of markers 0 and 1 at the same times, nan where one of them was not seen."""
    lengths = lengths[np.isfinite(lengths)]
    if len(lengths) < WAND_SIGHTINGS:
        expected = f"markers 0 and 1 at {WAND_SIGHTINGS} common times"
        raise CalibrationError("too little of the wand", expected=expected, got=len(lengths))
    median = float(np.median(lengths))
    spread = 1.4826 * float(np.median(np.abs(lengths - median)))
    sigma = spread / median / np.sqrt(len(lengths))
    return ScaleFound("wand", length_m / median, float(sigma), origin=f"the wand at {len(lengths)} times")


def _from_table(adjusted: Adjusted, poses: Mapping[int, tuple[Camera, Clicks]]) -> ScaleFound:
    """From the distance of the first two cameras whose clicks place them; the adjustment with the clicks refines it."""
    (a, first), (b, second) = list(poses.items())[:2]
    there = [pose_from_clicks(camera, clicks, f"camera {k + 1}") for k, (camera, clicks) in ((a, first), (b, second))]
    distance_m = float(np.linalg.norm(there[0][:3, 3] - there[1][:3, 3]))
    units = float(np.linalg.norm(adjusted.rig.ps[a] - adjusted.rig.ps[b]))
    return ScaleFound("table", distance_m / units, np.inf, origin="the table's corners")
