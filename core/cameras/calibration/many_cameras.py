"""Calibration of n cameras from a body that was moved before them: poses, clocks with drift, scale, place in the world.

For two cameras and a ball `core.cameras.calibration.rig` does the same with fewer unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.body_bundle import (
    POSITION,
    SIZE,
    UNKNOWNS,
    Extra,
    ManyAdjusted,
    ManyRig,
    adjust_many,
    fit_body,
)
from core.cameras.calibration.body_tracks import BodyTracks, moved_pixels
from core.cameras.calibration.bundle import Adjusted, Rig, Sightings, points_of
from core.cameras.calibration.placement import STRAY_SIGMAS, check_clicks, click_errors, upright_frame
from core.cameras.calibration.rig import ROUGH_PX, RigConfig, check_rig, outline_shifts
from core.cameras.calibration.rig_chain import guess_many, scaled_rig, shared_points
from core.cameras.calibration.scale import Scale, ScaleFound, measure_scale
from core.cameras.calibration.table_corners import CLICKS_AT_LEAST, Clicks, pose_from_clicks
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.geometry import invert_transform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

POOR_SIGMA_M: Final = 0.02
POOR_SIGMA_RAD: Final = 0.01
"""A camera whose pose is known no better than to one of these is named."""
MOVING_SHARE: Final = 0.5
STILL_NOTE: Final = "the clocks are taken as equal: pictures too far apart to see the motion between them"
FIRM: Final = 1e4
"""Weight of a length that is taken as known."""
WAND_SIGMA: Final = 1e-4
"""Relative, of a wand's or a board's size."""


@dataclass(frozen=True, slots=True, eq=False)
class RigCamera:
    """One camera of the rig."""

    camera: Camera
    offset_us: float
    """Its clock minus the first camera's, in the middle of the sweep."""
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


@dataclass(frozen=True, slots=True, eq=False)
class ManyCalibration:
    """What the calibration of n cameras gives."""

    reports: dict[str, RigCamera]
    t_us: Array
    """(G,) common instants on the first camera's clock."""
    points_m: Array
    """(G, K, 3) the body's points in the world."""
    sigma_px: float
    lead_px: float
    sigma_lead_px: float
    covariance: Array
    """(13 C + 1, 13 C + 1) of UNKNOWNS by camera, then the lead."""
    scale: ScaleFound
    sigma_scale: float
    """Relative standard deviation of all lengths."""
    frame: str
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


def calibrate_many(
    tracks: BodyTracks,
    lenses: Mapping[str, Camera],
    scale: Scale | None = None,
    *,
    clicks: Mapping[str, Clicks] | None = None,
    ball: bool = False,
    refine_lenses: bool = False,
    config: RigConfig | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> ManyCalibration:
    """Poses, clocks and scale of cameras named as in `lenses`, in the order of the tracks.

    A body with a size (a wand, a board) is the scale; of a ball `scale` says it. With `ball` the pixels are centres of
    a ball's outline, and a common lead of the detector along the motion is fitted.

    Raises:
        CalibrationError: if sightings, scale or corners do not allow it; a camera that shares too little is named.
    """
    config, names, clicks = config or RigConfig(), tuple(lenses), clicks or {}
    own_size = len(tracks.body_m) > 1
    if not own_size and scale is None:
        raise CalibrationError("no scale", expected="a baseline, gravity, the table's corners or a wand")
    check_rig(names, lenses, scale or Scale("wand", 1.0), clicks)
    steps = int(config.max_offset_ms / config.offset_step_ms)
    offsets_us = np.arange(-steps, steps + 1, dtype=np.float64) * (1e3 * config.offset_step_ms)
    rig = guess_many(tracks, names, list(lenses.values()), offsets_us, lambda share: progress(0.4 * share))
    t_us = choose_instants(tracks, rig, config.instants)
    clocks = config.max_offset_ms > 0 and _moves(tracks, rig, t_us)
    free = _free(len(names), clocks=clocks, lenses=refine_lenses, lead=ball)
    unit: Extra = _nothing if own_size else _unit_baseline
    adjusted = adjust_many(tracks, rig, t_us, free, unit, rough_px=ROUGH_PX)
    progress(0.7)
    poses = {names.index(name): found for name, found in clicks.items()}
    measured = _measure(tracks, adjusted, scale, poses)
    if ball:
        tracks = _centres_of_balls(tracks, adjusted, measured.metres_per_unit)
        adjusted = adjust_many(tracks, adjusted.rig, t_us, free, unit)
        measured = _measure(tracks, adjusted, scale, poses)
    progress(0.85)
    notes: tuple[str, ...] = () if clocks or config.max_offset_ms == 0 else (STILL_NOTE,)
    click_rms_px = None
    if poses:
        adjusted, click_rms_px, strays = _at_table(
            tracks, adjusted, free, measured, poses, config.click_sigma_px, names
        )
        notes, frame = (*notes, *strays), "the table's, by its corners"
    else:
        R_world_first, frame = upright_frame(measured)
        rig = scaled_rig(adjusted.rig, measured.metres_per_unit, R_world_first)
        adjusted = replace(adjusted, rig=rig, covariance=_in_world(adjusted, measured, R_world_first))
    progress(1.0)
    return _report(tracks, names, adjusted, measured, frame, click_rms_px, notes, ball=ball)


def _moves(tracks: BodyTracks, rig: ManyRig, t_us: Array) -> bool:
    """Whether most sightings follow each other closely enough to know how the body moves in the pictures."""
    samples = tracks.sample(t_us, rig.offsets_us, rig.drifts_ppm)
    return bool(samples.speeds[np.isfinite(samples.uvs_px[..., 0])].any(axis=1).mean() > MOVING_SHARE)


def choose_instants(tracks: BodyTracks, rig: ManyRig, at_most: int) -> Array:
    """Common times (G,) that two cameras or more see, each pair's evenly spread over the sweep."""
    t_us = tracks.instants(rig.offsets_us, rig.drifts_ppm)
    uvs = tracks.sample(t_us, rig.offsets_us, rig.drifts_ppm).uvs_px
    seen = np.asarray(np.isfinite(uvs[..., 0]).any(axis=1))
    count = seen.shape[1]
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


def _nothing(rig: ManyRig) -> Array:
    return np.zeros(0)


def _unit_baseline(rig: ManyRig) -> Array:
    along = rig.cameras[1].position_world_m - rig.cameras[0].position_world_m
    return np.array([FIRM * (float(np.linalg.norm(along)) - 1.0)])


def _measure(
    tracks: BodyTracks, adjusted: ManyAdjusted, scale: Scale | None, poses: Mapping[int, Clicks]
) -> ScaleFound:
    """Metres per unit of the adjusted rig: 1 for a body with a size."""
    if len(tracks.body_m) > 1 or scale is None:
        kind = "the wand" if np.linalg.matrix_rank(tracks.body_m, tol=1e-9) < 2 else "the board"
        times = int(adjusted.used.any(axis=(1, 2)).sum())
        return ScaleFound("wand", 1.0, WAND_SIGMA, origin=f"{kind} at {times} times")
    rig, used = adjusted.rig, np.asarray(adjusted.used.any(axis=(1, 2)))
    seen = tracks.sample(adjusted.t_us, rig.offsets_us, rig.drifts_ppm)
    uvs = np.where(adjusted.used[..., None], seen.uvs_px - rig.lead_px * seen.directions, np.nan)[:, 0]
    xys = np.stack([camera.undistort(uvs[:, c]) for c, camera in enumerate(rig.cameras)], axis=1)
    sightings = Sightings(adjusted.t_us, lambda offsets, lead: xys, rig.focals_px)
    plain = Adjusted(rig.plain, np.zeros((1, 1)), adjusted.sigma_px, used)
    clicked = {k: (rig.cameras[k], found) for k, found in poses.items()}
    return measure_scale(scale, sightings, np.zeros(len(uvs), np.int64), plain, clicked, lambda t, m: sightings)


def _centres_of_balls(tracks: BodyTracks, adjusted: ManyAdjusted, metres_per_unit: float) -> BodyTracks:
    """The tracks with each outline's centre moved to where the image of the ball's centre is."""
    rig = adjusted.rig
    samples = tracks.sample(adjusted.t_us, rig.offsets_us, rig.drifts_ppm)
    fit = fit_body(samples, rig, adjusted.used)
    rig, ps = scaled_rig(adjusted.rig, metres_per_unit), metres_per_unit * fit.points[:, 0]
    shifts = []
    for c, camera in enumerate(rig.cameras):
        t_us, shift = outline_shifts(camera, ps, adjusted.t_us + rig.offsets_us[c], adjusted.used[:, 0, c])
        shifts.append((t_us, -shift))
    return moved_pixels(tracks, shifts)


def _at_table(
    tracks: BodyTracks,
    adjusted: ManyAdjusted,
    free: Mask,
    scale: ScaleFound,
    poses: Mapping[int, Clicks],
    click_sigma_px: float,
    names: tuple[str, ...],
) -> tuple[ManyAdjusted, float, tuple[str, ...]]:
    """All cameras adjusted once more, to the sightings and the clicked corners together; the clicks' rms; strays."""
    anchor = max(poses, key=lambda k: len(poses[k].names))
    if len(poses[anchor].names) < CLICKS_AT_LEAST:
        expected, got = f"{CLICKS_AT_LEAST} or more in a camera", len(poses[anchor].names)
        raise CalibrationError("too few corners of the table", expected=expected, got=got)
    metric = scaled_rig(adjusted.rig, scale.metres_per_unit)
    T_world_anchor = pose_from_clicks(metric.cameras[anchor], poses[anchor], names[anchor])
    T_world_frame = T_world_anchor @ invert_transform(metric.cameras[anchor].T_world_camera)
    cameras = tuple(replace(one, T_world_camera=T_world_frame @ one.T_world_camera) for one in metric.cameras)
    length_m = float(np.linalg.norm(cameras[1].position_world_m - cameras[0].position_world_m))
    known = len(tracks.body_m) == 1 and np.isfinite(scale.sigma_relative)
    sigma_m = max(scale.sigma_relative, WAND_SIGMA) * length_m if known else 1.0

    def extra(rig: ManyRig) -> Array:
        errors = [click_errors(rig.cameras[k], found).ravel() / click_sigma_px for k, found in poses.items()]
        along = rig.cameras[1].position_world_m - rig.cameras[0].position_world_m
        return np.concatenate([*errors, [(float(np.linalg.norm(along)) - length_m) / sigma_m] if known else []])

    free = free.copy()
    free[:6] = True
    placed = adjust_many(tracks, replace(metric, cameras=cameras), adjusted.t_us, free, extra)
    off = {k: np.linalg.norm(click_errors(placed.rig.cameras[k], found), axis=1) for k, found in poses.items()}
    rms_px = float(np.sqrt(np.mean(np.concatenate(list(off.values())) ** 2)))
    check_clicks(rms_px)
    strays = tuple(
        f"the corner {corner} of {names[k]} is {error:.1f} px off"
        for k, found in poses.items()
        for corner, error in zip(found.names, off[k].tolist(), strict=True)
        if error > STRAY_SIGMAS * click_sigma_px
    )
    return placed, rms_px, strays


def _in_world(adjusted: ManyAdjusted, scale: ScaleFound, R_world_first: Array) -> Array:
    """The covariance in metres and in the world's axes, the scale's own uncertainty added."""
    count = len(adjusted.rig.cameras)
    stretch, by_scale = np.eye(len(adjusted.covariance)), np.zeros(len(adjusted.covariance))
    for c in range(count):
        rows = slice(c * SIZE + POSITION.start, c * SIZE + POSITION.stop)
        stretch[rows, rows] = scale.metres_per_unit * R_world_first
        by_scale[rows] = scale.metres_per_unit * R_world_first @ adjusted.rig.cameras[c].position_world_m
    sigma = scale.sigma_relative if np.isfinite(scale.sigma_relative) else 0.0
    return stretch @ adjusted.covariance @ stretch.T + sigma**2 * np.outer(by_scale, by_scale)


def marker_lengths(tracks: BodyTracks, adjusted: ManyAdjusted) -> dict[str, Array]:
    """Distances (N,) of a wand's neighbouring markers and of its ends, m, each marker triangulated on its own."""
    count = len(tracks.body_m)
    if count < 2 or np.linalg.matrix_rank(tracks.body_m - tracks.body_m[0], tol=1e-9) > 1:
        return {}
    rig = adjusted.rig
    uvs = tracks.sample(adjusted.t_us, rig.offsets_us, rig.drifts_ppm).uvs_px
    uvs = np.where(adjusted.used[..., None], uvs, np.nan).reshape(-1, len(rig.cameras), 2)
    xys = np.stack([camera.undistort(uvs[:, c]) for c, camera in enumerate(rig.cameras)], axis=1)
    there = points_of(Rig(rig.plain.Rs, rig.plain.ps, rig.offsets_us), xys, rig.focals_px).reshape(-1, count, 3)
    pairs = sorted({*((k, k + 1) for k in range(count - 1)), (0, count - 1)})
    lengths = {f"{a}-{b}": np.linalg.norm(there[:, b] - there[:, a], axis=1) for a, b in pairs}
    return {name: values[np.isfinite(values)] for name, values in lengths.items()}


def _report(
    tracks: BodyTracks,
    names: tuple[str, ...],
    adjusted: ManyAdjusted,
    scale: ScaleFound,
    frame: str,
    click_rms_px: float | None,
    notes: tuple[str, ...],
    *,
    ball: bool,
) -> ManyCalibration:
    rig = adjusted.rig
    fit = fit_body(tracks.sample(adjusted.t_us, rig.offsets_us, rig.drifts_ppm), rig, adjusted.used)
    sigmas = np.sqrt(np.maximum(np.diag(adjusted.covariance), 0.0))
    reports, poor = {}, []
    for c, name in enumerate(names):
        uvs = fit.samples.uvs_px[:, :, c] - rig.lead_px * fit.samples.directions[:, :, c]
        projected = rig.cameras[c].project(fit.points.reshape(-1, 3)).reshape(uvs.shape)
        own = dict(zip(UNKNOWNS, sigmas[c * SIZE : (c + 1) * SIZE].tolist(), strict=True))
        offset, drift = float(rig.offsets_us[c]), float(rig.drifts_ppm[c])
        known = {key: value for key, value in own.items() if value > 0}
        reports[name] = RigCamera(rig.cameras[c], offset, drift, known, uvs, uvs - projected, adjusted.used[:, :, c])
        place, turn = (
            np.hypot(np.hypot(own["x"], own["y"]), own["z"]),
            np.hypot(np.hypot(own["rx"], own["ry"]), own["rz"]),
        )
        if place > POOR_SIGMA_M or turn > POOR_SIGMA_RAD:
            poor.append(
                f"{name} is known to {1e3 * place:.0f} mm, {np.degrees(turn):.2f} degrees only: sweep more there"
            )
    return ManyCalibration(
        reports,
        adjusted.t_us,
        fit.points,
        adjusted.sigma_px,
        rig.lead_px,
        float(sigmas[-1]) if ball else 0.0,
        adjusted.covariance,
        scale,
        scale.sigma_relative if np.isfinite(scale.sigma_relative) else 0.0,
        frame,
        click_rms_px,
        marker_lengths(tracks, adjusted),
        shared_points(tracks),
        (*notes, *poor),
    )
