"""Calibration of two cameras or more from a ball, a wand or a board that was moved before them.

It gives poses, clocks with drift, the scale, and the place in the world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.body_tracks import BodyTracks, moved_pixels
from core.cameras.calibration.bundle import SIZE, UNKNOWNS, Adjusted, Extra, Rig, adjust_rig, fit_body
from core.cameras.calibration.placement import Placed, place_by_clicks, place_upright
from core.cameras.calibration.rig_chain import guess_rig, scaled_rig, shared_points
from core.cameras.calibration.rig_result import RigCalibration, RigCamera
from core.cameras.calibration.scale import Scale, ScaleFound, body_scale, measure_scale
from core.cameras.calibration.table_corners import Clicks
from core.cameras.calibration.triangulation import points_of
from core.cameras.camera import Camera
from core.cameras.outline import ball_circles
from core.config import check_settings, setting
from core.errors import CalibrationError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUGH_PX: Final = 1.0
"""Width of the robust loss that improves the guess."""
POOR_SIGMA_M: Final = 0.02
POOR_SIGMA_RAD: Final = 0.01
"""A camera whose pose is known no better than to one of these is named."""
MOVING_SHARE: Final = 0.5
STILL_NOTE: Final = "the clocks are taken as equal: pictures too far apart to see the motion between them"
FIRM: Final = 1e4
"""Weight of a length that is taken as known."""


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
    tracks: BodyTracks,
    lenses: Mapping[str, Camera],
    scale: Scale | None = None,
    *,
    clicks: Mapping[str, Clicks] | None = None,
    ball: bool = False,
    refine_lenses: bool = False,
    config: RigConfig | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> RigCalibration:
    """Poses, clocks and scale of the cameras of `tracks`; the first one's clock is the common one.

    Args:
        tracks: what each camera saw, and the body; one with a size (a wand, a board) is the scale.
        lenses: by the cameras' names; their poses are not looked at.
        scale: of a single point, such as a ball.
        clicks: the table's corners in some of the pictures; they place the rig in the world.
        ball: the pixels are centres of a ball's outline, which lie a little farther out than the image of its centre,
            and a detector may have put them ahead of the ball, all alike: that lead is fitted too.
        refine_lenses: fit focal lengths, principal points, k1 and k2 too.
        config: how it is done.
        progress: called with shares of the work done.

    Raises:
        CalibrationError: if sightings, scale or corners do not allow it; a camera that shares too little is named.
    """
    config, clicks = config or RigConfig(), clicks or {}
    _check(tracks, lenses, scale, clicks)
    steps = int(config.max_offset_ms / config.offset_step_ms)
    offsets_us = np.arange(-steps, steps + 1, dtype=np.float64) * (1e3 * config.offset_step_ms)
    cameras = [lenses[name] for name in tracks.names]
    rig = guess_rig(tracks, cameras, offsets_us, lambda share: progress(0.5 * share))
    t_us = choose_instants(tracks, rig, config.instants)
    # What stands still tells nothing about the clocks.
    clocks = config.max_offset_ms > 0 and _moves(tracks, rig, t_us)
    t_us = tracks.spread_instants(t_us) if clocks else t_us
    free = _free(len(cameras), clocks=clocks, lenses=refine_lenses, lead=ball)
    unit: Extra = _unit_baseline if len(tracks.body_m) == 1 else _nothing
    adjusted = adjust_rig(tracks, rig, t_us, free, unit, rough_px=ROUGH_PX)
    progress(0.7)
    corners = {tracks.names.index(name): found for name, found in clicks.items()}
    found = _measure(tracks, adjusted, scale, corners)
    if ball:
        # How far an outline's centre is off depends on the ball's distance in radii, so on the scale: known only now.
        tracks = _centres_of_balls(tracks, adjusted, found.metres_per_unit)
        adjusted = adjust_rig(tracks, adjusted.rig, t_us, free, unit)
        found = _measure(tracks, adjusted, scale, corners)
    progress(0.85)
    if corners:
        placed = place_by_clicks(tracks, adjusted, free, found, corners, config.click_sigma_px)
    else:
        placed = place_upright(adjusted, found)
    progress(1.0)
    notes: tuple[str, ...] = () if clocks or config.max_offset_ms == 0 else (STILL_NOTE,)
    return _report(tracks, placed, found, notes, ball=ball)


def _check(tracks: BodyTracks, lenses: Mapping[str, Camera], scale: Scale | None, clicks: Mapping[str, Clicks]) -> None:
    """Raises CalibrationError where tracks, lenses, scale and clicks do not go together."""
    names = tracks.names
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
    if scale is None and len(tracks.body_m) == 1:
        raise CalibrationError("no scale", expected="a baseline, gravity, the table's corners or a wand")
    if scale is not None and scale.kind == "table" and len(clicks) < 2:
        raise CalibrationError("no scale", expected="the table's corners in two cameras", got=f"{len(clicks)} cameras")


def _moves(tracks: BodyTracks, rig: Rig, t_us: Array) -> bool:
    """Whether most sightings follow each other closely enough to know how the body moves in the pictures."""
    samples = tracks.sample(t_us, rig.offsets_us, rig.drifts_ppm)
    return bool(samples.speeds[np.isfinite(samples.uvs_px[..., 0])].any(axis=1).mean() > MOVING_SHARE)


def choose_instants(tracks: BodyTracks, rig: Rig, at_most: int) -> Array:
    """Common times (G,) that two cameras or more see, each pair's evenly spread over the sweep."""
    t_us = tracks.instants(rig.offsets_us, rig.drifts_ppm)
    uvs = tracks.sample(t_us, rig.offsets_us, rig.drifts_ppm).uvs_px
    count = len(rig.cameras)
    seen = np.asarray(np.isfinite(uvs[..., 0]).reshape(len(t_us), -1, count).any(axis=1))
    pairs = [np.flatnonzero(seen[:, a] & seen[:, b]) for a in range(count) for b in range(a)]
    pairs = [rows for rows in pairs if len(rows)]
    chosen: set[int] = set()
    for rows in sorted(pairs, key=len):
        wanted = max(at_most // max(len(pairs), 1), 1)
        chosen.update(rows[np.linspace(0, len(rows) - 1, min(len(rows), wanted)).astype(int)].tolist())
    rest = np.setdiff1d(np.flatnonzero(seen.sum(axis=1) >= 2), sorted(chosen))
    missing = min(max(at_most - len(chosen), 0), len(rest))
    chosen.update(rest[np.linspace(0, len(rest) - 1, missing).astype(int)].tolist() if missing else [])
    return t_us[sorted(chosen)]


def _free(count: int, *, clocks: bool, lenses: bool, lead: bool) -> Mask:
    free = np.ones((count, SIZE), np.bool_)
    free[0, :8] = False  # the first camera is the frame, and its clock is the common one
    free[:, 6:8] &= clocks
    free[:, 8:] &= lenses
    return np.append(free.ravel(), lead)


def _nothing(rig: Rig) -> Array:
    return np.zeros(0)


def _unit_baseline(rig: Rig) -> Array:
    return np.array([FIRM * (rig.baseline - 1.0)])


def _measure(tracks: BodyTracks, adjusted: Adjusted, scale: Scale | None, corners: Mapping[int, Clicks]) -> ScaleFound:
    """Metres per unit of the adjusted rig: 1 for a body with a size."""
    if len(tracks.body_m) > 1 or scale is None:
        return body_scale(tracks.body_m, int(adjusted.used.any(axis=(1, 2)).sum()))
    rig = adjusted.rig
    seen = tracks.sample(adjusted.t_us, rig.offsets_us, rig.drifts_ppm)
    uvs = np.where(adjusted.used[..., None], seen.uvs_px - rig.lead_px * seen.directions, np.nan)[:, 0]
    xys = np.stack([camera.undistort(uvs[:, c]) for c, camera in enumerate(rig.cameras)], axis=1)
    return measure_scale(scale, seen.t_us, rig, xys, adjusted.sigma_px, corners)


def _centres_of_balls(tracks: BodyTracks, adjusted: Adjusted, metres_per_unit: float) -> BodyTracks:
    """The tracks with each outline's centre moved to where the image of the ball's centre is."""
    fit = fit_body(
        tracks.sample(adjusted.t_us, adjusted.rig.offsets_us, adjusted.rig.drifts_ppm), adjusted.rig, adjusted.used
    )
    rig, ps = scaled_rig(adjusted.rig, metres_per_unit), metres_per_unit * fit.points[:, 0]
    shifts = []
    for c, camera in enumerate(rig.cameras):
        circles = ball_circles(camera, ps)
        shift = np.column_stack([circles.u_px, circles.v_px]) - camera.project(ps)
        good = np.isfinite(shift[:, 0]) & adjusted.used[:, 0, c]
        shifts.append(((fit.samples.t_us + rig.offsets_us[c])[good], -shift[good]))
    return moved_pixels(tracks, shifts)


def marker_lengths(tracks: BodyTracks, adjusted: Adjusted) -> dict[str, Array]:
    """Distances (N,) of a wand's neighbouring markers and of its ends, m, each marker triangulated on its own."""
    count = len(tracks.body_m)
    if count < 2 or np.linalg.matrix_rank(tracks.body_m - tracks.body_m[0], tol=1e-9) > 1:
        return {}
    rig = adjusted.rig
    uvs = tracks.sample(adjusted.t_us, rig.offsets_us, rig.drifts_ppm).uvs_px
    uvs = np.where(adjusted.used[..., None], uvs, np.nan).reshape(-1, len(rig.cameras), 2)
    xys = np.stack([camera.undistort(uvs[:, c]) for c, camera in enumerate(rig.cameras)], axis=1)
    there = points_of(rig.poses, xys, rig.focals_px).reshape(-1, count, 3)
    pairs = sorted({*((k, k + 1) for k in range(count - 1)), (0, count - 1)})
    lengths = {f"{a}-{b}": np.linalg.norm(there[:, b] - there[:, a], axis=1) for a, b in pairs}
    return {name: values[np.isfinite(values)] for name, values in lengths.items()}


def _report(
    tracks: BodyTracks, placed: Placed, scale: ScaleFound, notes: tuple[str, ...], *, ball: bool
) -> RigCalibration:
    adjusted = placed.adjusted
    rig = adjusted.rig
    # Where nothing fits, the point is that of all sightings: its residuals show by how much they do not.
    shown = adjusted.used | ~adjusted.used.any(axis=(1, 2), keepdims=True)
    fit = fit_body(tracks.sample(adjusted.t_us, rig.offsets_us, rig.drifts_ppm), rig, shown)
    sigmas = np.sqrt(np.maximum(np.diag(adjusted.covariance), 0.0))
    reports, poor = {}, []
    for c, name in enumerate(tracks.names):
        uvs = fit.samples.uvs_px[:, :, c] - rig.lead_px * fit.samples.directions[:, :, c]
        projected = rig.cameras[c].project(fit.points.reshape(-1, 3)).reshape(uvs.shape)
        own = dict(zip(UNKNOWNS, sigmas[c * SIZE : (c + 1) * SIZE].tolist(), strict=True))
        offset, drift = float(rig.offsets_us[c]), float(rig.drifts_ppm[c])
        known = {key: value for key, value in own.items() if value > 0}
        one = RigCamera(rig.cameras[c], offset, drift, known, uvs, uvs - projected, adjusted.used[:, :, c])
        reports[name] = one
        place_m, turn_rad = one.sigma_position_m, one.sigma_rotation_rad
        if place_m > POOR_SIGMA_M or turn_rad > POOR_SIGMA_RAD:
            known_to = f"{1e3 * place_m:.0f} mm, {np.degrees(turn_rad):.2f} degrees"
            poor.append(f"{name} is known to {known_to} only: sweep more there")
    return RigCalibration(
        reports=reports,
        t_us=fit.samples.t_us,
        points_m=fit.points,
        sigma_px=adjusted.sigma_px,
        lead_px=rig.lead_px,
        sigma_lead_px=float(sigmas[-1]) if ball else 0.0,
        covariance=adjusted.covariance,
        scale=scale,
        frame=placed.frame,
        click_rms_px=placed.click_rms_px,
        lengths_m=marker_lengths(tracks, adjusted),
        shared=shared_points(tracks),
        notes=(*notes, *placed.notes, *poor),
    )
