"""A rig of cameras from a point that was swept before them: poses, clock offsets, scale and place in the world."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.bundle import Adjusted, Rig, Sightings, adjust, points_of
from core.cameras.calibration.placement import Placed, place_by_clicks, place_upright
from core.cameras.calibration.point_track import (
    PointTrack,
    clean_track,
    common_instants,
    motion_directions,
    sample_values,
)
from core.cameras.calibration.rig_result import CameraFit, RigCalibration
from core.cameras.calibration.rig_start import SEARCH_INSTANTS, guess_rig, sightings_of
from core.cameras.calibration.scale import Scale, ScaleFound, measure_scale
from core.cameras.calibration.table_corners import Clicks
from core.cameras.camera import Camera
from core.cameras.outline import ball_circles
from core.config import check_settings, setting
from core.errors import CalibrationError
from core.geometry import make_transform

Array = NDArray[np.float64]

ROUGH_PX: Final = 1.0
"""Width of the robust loss that improves the guess."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigConfig:
    """How a rig is calibrated."""

    max_offset_ms: float = setting(50.0, 0.0, 2000.0)
    """The clocks are searched for offsets up to so much; 0: they are the same clock and no offset is fitted."""
    offset_step_ms: float = setting(1.0, 0.1, 20.0)
    """Step of that search. A ball moves some 3 px in 1 ms (5 m/s, 1.7 m away, f = 1000 px)."""
    instants: int = setting(2000, 50, 20_000)
    """Common sightings that the adjustment uses, at most; evenly spread."""
    click_sigma_px: float = setting(1.0, 0.05, 20.0)
    """Standard deviation of a clicked corner along each picture axis (choice)."""

    def __post_init__(self) -> None:
        check_settings(self)


def calibrate_rig(
    tracks: Mapping[str, PointTrack],
    lenses: Mapping[str, Camera],
    scale: Scale,
    *,
    clicks: Mapping[str, Clicks] | None = None,
    ball: bool = True,
    config: RigConfig | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> RigCalibration:
    """Poses, clocks and scale of the cameras of `tracks`, whose `lenses` are known (their poses are not looked at).

    With `ball` the pixels are centres of a ball's outline, which lie a little farther out than its centre's image, and
    a detector may have put them ahead of the ball, all alike: that lead is fitted too.

    Raises:
        CalibrationError: if cameras, sightings, scale or corners do not allow it.
    """
    config = config or RigConfig()
    names = tuple(tracks)
    check_rig(names, lenses, scale, clicks or {})
    cameras = [lenses[name] for name in names]
    seen = [clean_track(tracks[name]) for name in names]
    steps = int(config.max_offset_ms / config.offset_step_ms)
    offsets_us = np.arange(-steps, steps + 1, dtype=np.float64) * (1e3 * config.offset_step_ms)
    rig = guess_rig(seen, cameras, offsets_us, lambda share: progress(0.6 * share))
    solved = _solve(seen, cameras, names, rig, scale, clicks or {}, config, ball=ball, rough_px=ROUGH_PX)
    progress(0.8)
    if ball:
        seen = _centres_of_balls(seen, solved)
        solved = _solve(seen, cameras, names, solved.relative, scale, clicks or {}, config, ball=True)
    progress(1.0)
    return _report(seen, names, solved)


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    relative: Rig
    """In the first camera's frame, baseline 1."""
    sightings: Sightings
    adjusted: Adjusted
    scale: ScaleFound
    placed: Placed
    cameras: list[Camera]
    marker: NDArray[np.int64]


def check_rig(names: tuple[str, ...], lenses: Mapping[str, Camera], scale: Scale, clicks: Mapping[str, Clicks]) -> None:
    """Raises CalibrationError where names, lenses, scale and clicks do not go together."""
    if len(names) < 2:
        got = ", ".join(names) or "none"
        raise CalibrationError("a rig has two cameras or more", expected="tracks of two cameras", got=got)
    for name in names:
        if name not in lenses:
            remedy = "calibrate its lens first: `rallyscope calibrate intrinsics`"
            raise CalibrationError("no lens", where=f"camera {name}", remedy=remedy)
    unknown = [name for name in clicks if name not in names]
    if unknown:
        raise CalibrationError("corners of an unknown camera", expected=", ".join(names), got=", ".join(unknown))
    if scale.kind == "table" and len(clicks) < 2:
        raise CalibrationError("no scale", expected="the table's corners in two cameras", got=f"{len(clicks)} cameras")


def _solve(
    tracks: list[PointTrack],
    cameras: list[Camera],
    names: tuple[str, ...],
    start: Rig,
    scale: Scale,
    clicks: Mapping[str, Clicks],
    config: RigConfig,
    *,
    ball: bool,
    rough_px: float | None = None,
) -> _Solved:
    t_us, marker = common_instants(tracks[0], SEARCH_INSTANTS)
    sightings = sightings_of(tracks, cameras, t_us, marker)
    common = np.flatnonzero(np.isfinite(sightings.of(start)[..., 0]).sum(axis=1) >= 2)
    chosen = common[np.linspace(0, len(common) - 1, min(len(common), config.instants)).astype(int)]
    marker = marker[chosen]
    sightings = sightings_of(tracks, cameras, t_us[chosen], marker)
    free = np.ones(7 * len(tracks) + 1, np.bool_)
    free[:7] = False
    free[6:-1:7] &= config.max_offset_ms > 0
    free[-1] = ball
    adjusted = adjust(sightings, start, free, _unit_baseline, rough_px=rough_px)
    relative = adjusted.rig
    poses = {names.index(name): (cameras[names.index(name)], found) for name, found in clicks.items()}

    def at_marker(t_us: Array, marker: NDArray[np.int64]) -> Sightings:
        return sightings_of(tracks, cameras, t_us, marker)

    found = measure_scale(scale, sightings, marker, adjusted, poses, at_marker)
    if poses:
        free[:6] = True
        placed = place_by_clicks(sightings, adjusted, free, found, poses, config.click_sigma_px)
    else:
        placed = place_upright(adjusted, found)
    solved = [
        replace(camera, T_world_camera=make_transform(R, p))
        for camera, R, p in zip(cameras, placed.adjusted.rig.Rs, placed.adjusted.rig.ps, strict=True)
    ]
    return _Solved(relative, sightings, adjusted, found, placed, solved, marker)


def _unit_baseline(rig: Rig) -> Array:
    return np.array([1e4 * (float(np.linalg.norm(rig.ps[1] - rig.ps[0])) - 1.0)])


def _centres_of_balls(tracks: list[PointTrack], solved: _Solved) -> list[PointTrack]:
    """The tracks with each outline's centre moved to where the image of the ball's centre is."""
    rig = solved.placed.adjusted.rig
    ps = points_of(rig, solved.sightings.of(rig), solved.sightings.focals_px)
    corrected = []
    for track, camera, offset_us in zip(tracks, solved.cameras, rig.offsets_us.tolist(), strict=True):
        t_us, shift = outline_shifts(camera, ps, solved.sightings.t_us + offset_us, solved.placed.adjusted.used)
        shifts = [np.interp(track.t_us, t_us, column) for column in shift.T] if len(t_us) else [0.0, 0.0]
        corrected.append(replace(track, uvs_px=track.uvs_px - np.column_stack(shifts)))
    return corrected


def outline_shifts(camera: Camera, ps: Array, t_us: Array, used: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Times (M,) and by how much a ball's outline is off the image of its centre then (M, 2), px.

    The balls are at `ps` (N, 3) in the world at `t_us` (N,); those not used or not in the picture are left out.
    """
    circles = ball_circles(camera, ps)
    shift = np.column_stack([circles.u_px, circles.v_px]) - camera.project(ps)
    good = np.isfinite(shift[:, 0]) & used
    return t_us[good], shift[good]


def _report(seen: list[PointTrack], names: tuple[str, ...], solved: _Solved) -> RigCalibration:
    adjusted = solved.placed.adjusted
    rig, sightings = adjusted.rig, solved.sightings
    ps = points_of(rig, sightings.of(rig), sightings.focals_px)
    variances = np.diag(adjusted.covariance)[:-1].reshape(-1, 7)
    fits = {}
    for k, name in enumerate(names):
        centres = seen[k].uvs_px - rig.lead_px * motion_directions(seen[k])
        uvs = sample_values(seen[k], centres, solved.marker, sightings.t_us + rig.offsets_us[k])
        fits[name] = CameraFit(
            solved.cameras[k],
            float(rig.offsets_us[k]),
            1e3 * float(np.sqrt(variances[k, 6])),
            float(np.sqrt(variances[k, 3:6].sum())),
            float(np.sqrt(variances[k, :3].sum())),
            uvs,
            uvs - solved.cameras[k].project(ps),
        )
    baseline = float(np.linalg.norm(rig.ps[1] - rig.ps[0]))
    return RigCalibration(
        fits,
        sightings.t_us,
        ps,
        adjusted.used,
        adjusted.sigma_px,
        rig.lead_px,
        float(np.sqrt(adjusted.covariance[-1, -1])),
        solved.scale,
        baseline,
        solved.placed.sigma_baseline_m,
        solved.placed.frame,
        solved.placed.click_rms_px,
        _notes(solved.placed, names),
    )


def _notes(placed: Placed, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"the corner {name} of {names[k]} is {off:.1f} px off" for k, name, off in placed.stray_clicks)
