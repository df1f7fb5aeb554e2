"""What `calibrate rig` achieves: a public wand before four real cameras, and simulated sweeps of 3, 4 and 6 cameras.

The wand is https://github.com/cogsys-tuebingen/ewand (Apache-2.0), looked for in ../shared/data/multiview. Half of its
blocks of 4 s calibrate, the other half is scored. Where aniposelib (and jax) is installed it is the referee: its bundle
adjustment starts from our rig with errors of 10 mm and 0.3 degrees, and gets the points by our clocks, having none.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from benchmarks.machine import describe_machine, report_rows_to
from core.cameras import Camera, load_calibration, stereo_preset
from core.cameras.calibration.body_tracks import BodyTracks, body_tracks
from core.cameras.calibration.bundle import Rig, fit_body
from core.cameras.calibration.point_track import PointTrack
from core.cameras.calibration.rig import RigConfig, calibrate_rig
from core.cameras.calibration.rig_result import RigCalibration
from core.cameras.calibration.scale import Scale
from core.cameras.calibration.table_corners import CORNERS, Clicks
from core.geometry import invert_transform, look_at, make_transform
from core.simulation.flights import BallPath, BallStates, VisibleRange
from core.simulation.truth import pixel_truth

Array = NDArray[np.float64]

STRAY_PX: Final = 60.0
"""Spread of detections that are none of the ball."""


@dataclass(frozen=True, slots=True)
class BallSwing:
    """A Lissajous figure through most of the volume over the robot's half, up to 5 m/s, in all directions."""

    end_s: float
    middle_m: tuple[float, float, float] = (-0.6, 0.0, 0.36)
    reach_m: tuple[float, float, float] = (0.6, 0.45, 0.28)
    turns_hz: tuple[float, float, float] = (0.83, 1.13, 1.57)
    phases_rad: tuple[float, float, float] = (0.0, 0.4, 1.1)

    @property
    def discontinuities_s(self) -> Array:
        """It is there from the start to the end."""
        return np.array([0.0, self.end_s])

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        rate = 2 * np.pi * np.array(self.turns_hz)
        angle = t[:, None] * rate + np.array(self.phases_rad)
        p = np.array(self.middle_m) + np.array(self.reach_m) * np.sin(angle)
        v = np.array(self.reach_m) * rate * np.cos(angle)
        present = (t >= 0) & (t < self.end_s)
        p[~present], v[~present] = np.nan, np.nan
        return BallStates(t, p, v, np.zeros_like(p), present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """Nothing ever hides the swept ball."""
        count = len(np.atleast_1d(np.asarray(t_s)))
        return VisibleRange(np.zeros((count, 3)), np.full(count, -np.inf))


def seen_by(
    camera: Camera,
    path: BallPath,
    rng: np.random.Generator,
    *,
    noise_px: float,
    clock_ahead_us: int = 0,
    stray_share: float = 0.0,
    lead_px: float = 0.0,
    every_us: int = 2000,
) -> PointTrack:
    """What a detector with independent errors would say: outline centres with noise, some of them astray.

    `lead_px` puts all of them ahead of the ball along its motion.
    """
    t_us = np.arange(every_us, int(path.end_s * 1e6), every_us, dtype=np.int64)
    truth = pixel_truth(camera, path, t_us - clock_ahead_us)
    later = pixel_truth(camera, path, t_us - clock_ahead_us + 100)
    motion = np.column_stack([later.u_px - truth.u_px, later.v_px - truth.v_px])
    ahead = lead_px * motion / np.linalg.norm(motion, axis=1, keepdims=True) if lead_px else 0.0
    uvs = np.column_stack([truth.u_px, truth.v_px]) + ahead + rng.normal(0, noise_px, (len(t_us), 2))
    stray = rng.uniform(size=len(t_us)) < stray_share
    uvs[stray] += rng.normal(0, STRAY_PX, (int(stray.sum()), 2))
    return PointTrack.of(t_us, uvs)


def click_corners(cameras: Mapping[str, Camera], rng: np.random.Generator, sigma_px: float) -> dict[str, Clicks]:
    """Every named point of the table that is in a picture, clicked with an error."""
    clicks = {}
    for name, camera in cameras.items():
        uvs = camera.project(np.array(list(CORNERS.values())))
        size = (camera.sensor.width_px, camera.sensor.height_px)
        with np.errstate(invalid="ignore"):
            inside = (uvs > 0).all(axis=1) & (uvs < size).all(axis=1)
        names = tuple(corner for corner, there in zip(CORNERS, np.asarray(inside).tolist(), strict=True) if there)
        clicks[name] = Clicks(names, uvs[inside] + rng.normal(0, sigma_px, (len(names), 2)))
    return clicks


Row = dict[str, object]

MULTIVIEW: Final = Path(__file__).parents[3] / "shared" / "data" / "multiview"
WAND_M: Final = (0.0, 0.1305, 0.3915)
"""Places of its three markers, by the calibration that its authors give with it."""
BLOCK_US: Final = 4_000_000
PLACES: Final = (
    (-1.15, 1.75, 1.15),
    (-1.15, -1.75, 1.15),
    (1.2, 1.7, 1.3),
    (1.2, -1.7, 1.3),
    (-2.4, 0.1, 1.6),
    (2.4, -0.1, 1.6),
)
"""Cameras round the table, metres; the first 3, 4 or 6 of them, looking at its middle."""
RIGS: Final = (3, 4, 6)
SEEDS: Final = 5
NOISE_PX: Final = 0.2
STRAY_SHARE: Final = 0.01
CLOCK_US: Final = 700
"""Each camera's clock is ahead of the one before by so much."""
DRIFT_PPM: Final = 20.0
"""And faster than the one before by so much."""
SWEEP_S: Final = 8.0
INSTANTS: Final = 1500
TURN_DEG, SHIFT_M = 0.3, 0.01
"""Errors from which the referee starts."""


def run(progress: Callable[[float], None], *, count: int = SEEDS) -> dict[str, object]:
    """Rows of the real wand (if its files are there), then of simulated rigs over so many seeds."""
    rows: list[Row] = []
    real = multiview_rows(MULTIVIEW) if MULTIVIEW.is_dir() else []
    report_rows_to(progress, real, 0.2)
    for number, cameras in enumerate(RIGS):
        for swept in ("ball", "wand"):
            rows.append(simulated_row(cameras, swept, range(count)))
            report_rows_to(progress, rows[-1:], 0.2 + 0.8 * (number + 1) / len(RIGS))
    remarks = {"wand": "found" if real else f"no files in {MULTIVIEW.name}", "seeds": f"0 to {count - 1}"}
    remarks |= {"noise_px": str(NOISE_PX), "strays": str(STRAY_SHARE), "instants": str(INSTANTS)}
    return {"rows": rows, "multiview": real, "machine": describe_machine("numpy", "scipy", **remarks)}


def read_multiview(folder: Path) -> tuple[dict[str, PointTrack], dict[str, Camera]]:
    """The public wand: tracks of three markers by camera, and the lenses."""
    tracks, lenses = {}, {}
    for path in sorted(folder.glob("frame_*.csv")):
        table = np.loadtxt(path, delimiter=";")
        table = table[table[:, 1] >= 0]  # -1: not seen
        t_us = np.tile((table[:, 0] / 1000).round(), 3)
        uvs = np.concatenate([table[:, 1 + 2 * k : 3 + 2 * k] for k in range(3)])
        tracks[path.stem] = PointTrack.of(t_us, uvs, np.repeat([0, 1, 2], len(table)))
        lens = next(iter(load_calibration(path.with_suffix(".yaml")).values()))
        lenses[path.stem] = replace(lens, T_world_camera=np.eye(4))
    return tracks, lenses


def multiview_rows(folder: Path) -> list[Row]:
    """One clock; clocks fitted; lenses refined too; and the referee: errors on the half that was not used, px."""
    tracks, lenses = read_multiview(folder)
    used, held = (
        body_tracks({name: _blocks(track, half) for name, track in tracks.items()}, np.outer(WAND_M, [1.0, 0.0, 0.0]))
        for half in (0, 1)
    )
    cases = {"one clock": (0.0, False), "clocks fitted": (20.0, False), "clocks and lenses": (20.0, True)}
    rows: list[Row] = []
    for name, (max_offset_ms, refine) in cases.items():
        found = calibrate_rig(used, lenses, refine_lenses=refine, config=RigConfig(max_offset_ms=max_offset_ms))
        rows.append({"case": name, **held_out(held, _rig_of(found)), **_clocks(found)})
        if name == "clocks fitted":
            judged = referee(used, found)
            rows += (
                []
                if judged is None
                else [{"case": "aniposelib, by our clocks", **held_out(held, judged), **_clocks(found)}]
            )
    return rows


def held_out(tracks: BodyTracks, rig: Rig) -> Row:
    """Medians of reprojection errors, and of the error in a camera that took no part in the triangulation; lengths."""
    t_us = tracks.instants(rig.offsets_us, rig.drifts_ppm)
    samples = tracks.sample(t_us, rig.offsets_us, rig.drifts_ppm)
    every = np.isfinite(samples.uvs_px[..., 0])
    errors, others, places = [], [], []
    for k in range(len(tracks.body_m)):  # each marker on its own: the wand's straightness may not help
        one = replace(samples, body_m=np.zeros((1, 3)), **{
            name: getattr(samples, name)[:, k : k + 1]
            for name in ("uvs_px", "speeds", "growths", "directions", "sigmas")
        })  # fmt: skip
        fit = fit_body(one, rig, every[:, k : k + 1])
        errors.append(np.linalg.norm(fit.errors_px, axis=3)[:, 0])
        places.append(fit.points[:, 0])
        for c, camera in enumerate(rig.cameras):
            without = every[:, k : k + 1].copy()
            without[:, :, c] = False
            unseen = fit_body(one, rig, without)
            others.append(np.linalg.norm(one.uvs_px[:, 0, c] - camera.project(unseen.points[:, 0]), axis=1))
    whole, ends = np.stack(errors), np.linalg.norm(places[-1] - places[0], axis=1)
    ends = ends[np.isfinite(ends)]
    by_camera = np.nanmedian(whole, axis=(0, 1)).round(2)
    return {
        "median_px": round(float(np.nanmedian(whole)), 3),
        "by_camera_px": "/".join(f"{value:.2f}" for value in by_camera),
        "unseen_median_px": round(float(np.nanmedian(np.concatenate(others))), 3),
        "length_mm": round(1e3 * float(np.median(ends)), 2),
        "length_spread_percent": round(100 * float(np.std(ends) / max(np.mean(ends), 1e-9)), 2),
        "instants": len(ends),
    }


def simulated_row(
    count: int, swept: str, seeds: Sequence[int], *, sweep_s: float = SWEEP_S, instants: int = INSTANTS
) -> Row:
    """Errors of poses (in the first camera's frame) and clocks over some sweeps: medians and the worst."""
    found = [simulated_errors(count, swept, seed, sweep_s=sweep_s, instants=instants) for seed in seeds]
    every = np.concatenate([errors for errors, _ in found])
    judged = [other for _, other in found if other is not None]
    row: Row = {"cameras": count, "swept": swept}
    for column, name in enumerate(("place_mm", "turned_deg", "clock_us", "drift_ppm", "place_in_sigmas")):
        row[name] = round(float(np.median(every[:, column])), 4)
        row[f"{name}_worst"] = round(float(every[:, column].max()), 4)
    row["referee_mm_worst"] = round(float(np.concatenate(judged)[:, 0].max()), 3) if judged else None
    return row


def simulated_errors(
    count: int, swept: str, seed: int, *, sweep_s: float = SWEEP_S, instants: int = INSTANTS
) -> tuple[Array, Array | None]:
    """(C - 1, 5) errors of all cameras but the first: mm, degrees, us, ppm, place over its sigma; and the referee's."""
    cameras = ring(count)
    rng = np.random.default_rng(seed)
    phases = tuple(rng.uniform(0, 2 * np.pi, 3).tolist())
    path = BallSwing(sweep_s, middle_m=(0.0, 0.0, 0.4), reach_m=(0.9, 0.6, 0.3), phases_rad=phases)
    tracks, scale = _sweep(cameras, path, swept, rng)
    lenses = {name: replace(camera, T_world_camera=np.eye(4)) for name, camera in cameras.items()}
    config = RigConfig(max_offset_ms=5.0, instants=instants)
    found = calibrate_rig(tracks, lenses, scale, ball=swept == "ball", config=config)
    poses = pose_errors(list(found.cameras.values()), list(cameras.values()))
    rows = []
    for number, report in list(enumerate(found.reports.values()))[1:]:
        sigma_mm = 1e3 * np.sqrt(sum(report.sigmas[axis] ** 2 for axis in "xyz"))
        clock, drift = report.offset_us - _offset_us(number, tracks), report.drift_ppm - DRIFT_PPM * number
        rows.append([*poses[number - 1], abs(clock), abs(drift), poses[number - 1, 0] / sigma_mm])
    judged = referee(tracks, found)
    return np.array(rows), None if judged is None else pose_errors(judged.cameras, list(cameras.values()))


def _offset_us(number: int, tracks: BodyTracks) -> float:
    """A camera's true offset at the time from which drifts are counted."""
    return CLOCK_US * number + 1e-6 * DRIFT_PPM * number * tracks.middle_us


def ring(count: int) -> dict[str, Camera]:
    """The first cameras round the table."""
    lens = stereo_preset("side")["left"]
    return {f"cam{k}": replace(lens, T_world_camera=look_at(PLACES[k], (0.0, 0.0, 0.2))) for k in range(count)}


def _sweep(
    cameras: Mapping[str, Camera], path: BallPath, swept: str, rng: np.random.Generator
) -> tuple[BodyTracks, Scale | None]:
    """A swung ball as outlines at 500 Hz, or a turning wand of 0.4 m with two markers; the clocks run apart."""
    tracks = {}
    for number, (name, camera) in enumerate(cameras.items()):
        if swept == "ball":
            track = seen_by(camera, path, rng, noise_px=NOISE_PX, stray_share=STRAY_SHARE)
        else:
            t_us = np.arange(2000, int(path.end_s * 1e6), 2000)
            turn, middle = t_us * 3e-6, path.at(t_us * 1e-6).p_world_m
            half = np.column_stack([np.cos(turn), np.sin(turn) * 0.8, np.sin(turn) * 0.6])
            half *= 0.2 / np.linalg.norm(half, axis=1, keepdims=True)
            uvs = np.concatenate([camera.project(middle + half), camera.project(middle - half)])
            uvs += rng.normal(0, NOISE_PX, uvs.shape)
            uvs[rng.uniform(size=len(uvs)) < STRAY_SHARE] += rng.normal(0, 60.0, 2)
            size = np.array([camera.sensor.width_px, camera.sensor.height_px])
            uvs[~((uvs > 0) & (uvs < size)).all(axis=1)] = np.nan
            track = PointTrack.of(np.tile(t_us, 2), uvs, np.repeat([0, 1], len(t_us)))
        late = track.t_us * (1 + 1e-6 * DRIFT_PPM * number) + CLOCK_US * number
        tracks[name] = replace(track, t_us=late.round().astype(np.int64))
    centres = [camera.position_world_m for camera in cameras.values()]
    scale = Scale("baseline", float(np.linalg.norm(centres[1] - centres[0])))
    body_m = np.zeros((1, 3)) if swept == "ball" else np.array([[0.0, 0, 0], [0.4, 0, 0]])
    return body_tracks(tracks, body_m), scale if swept == "ball" else None


def pose_errors(found: Sequence[Camera], true: Sequence[Camera]) -> Array:
    """(C - 1, 2) how far each camera but the first is off in the first one's frame, mm and degrees."""
    rows = []
    for got, wanted in zip(found[1:], true[1:], strict=True):
        T = invert_transform(found[0].T_world_camera) @ got.T_world_camera
        T_true = invert_transform(true[0].T_world_camera) @ wanted.T_world_camera
        turned = Rotation.from_matrix(T[:3, :3].T @ T_true[:3, :3]).magnitude()
        rows.append([1e3 * float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])), float(np.degrees(turned))])
    return np.array(rows)


def referee(tracks: BodyTracks, found: RigCalibration) -> Rig | None:
    """The rig of aniposelib's bundle adjustment over the same points, its baseline made ours; None if not installed."""
    try:
        anipose = importlib.import_module("aniposelib.cameras")
    except ImportError:
        return None
    rig, rng = _rig_of(found), np.random.default_rng(0)
    used = np.stack([report.used for report in found.reports.values()], axis=2)
    uvs = np.stack([report.uvs_px for report in found.reports.values()], axis=2)
    points = np.where(used[..., None], uvs, np.nan).reshape(-1, len(rig.cameras), 2)
    points = points[np.isfinite(points[..., 0]).sum(axis=1) >= 2]
    cameras = [_for_anipose(anipose.Camera, camera, rng, k) for k, camera in enumerate(rig.cameras)]
    group: Any = anipose.CameraGroup(cameras)
    group.bundle_adjust(points.transpose(1, 0, 2), ftol=1e-10, max_nfev=200, only_extrinsics=True, verbose=False)
    Ts = [_from_anipose(camera) for camera in group.cameras]
    Ts = [invert_transform(Ts[0]) @ T for T in Ts]
    ours = rig.cameras[1].position_world_m - rig.cameras[0].position_world_m
    factor = float(np.linalg.norm(ours) / np.linalg.norm(Ts[1][:3, 3]))
    placed = [make_transform(T[:3, :3], factor * T[:3, 3]) for T in Ts]
    cameras = [replace(camera, T_world_camera=T) for camera, T in zip(rig.cameras, placed, strict=True)]
    return replace(rig, cameras=tuple(cameras))


def _for_anipose(kind: Any, camera: Camera, rng: np.random.Generator, number: int) -> Any:
    """A camera of anipose, with an error of its pose to start from; rvec and tvec are those of `T_camera_world`."""
    T = camera.T_world_camera
    if number:
        turn = Rotation.from_rotvec(np.radians(TURN_DEG) * rng.normal(size=3) / np.sqrt(3)).as_matrix()
        T = make_transform(T[:3, :3] @ turn, T[:3, 3] + SHIFT_M * rng.normal(size=3) / np.sqrt(3))
    T_camera_world = invert_transform(T)
    rvec = Rotation.from_matrix(T_camera_world[:3, :3]).as_rotvec()
    size = (camera.sensor.width_px, camera.sensor.height_px)
    return kind(camera.K.copy(), camera.distortion.copy(), size, rvec, T_camera_world[:3, 3].copy(), name=str(number))


def _from_anipose(camera: Any) -> Array:
    R = Rotation.from_rotvec(np.ravel(camera.get_rotation())).as_matrix()
    return invert_transform(make_transform(R, np.ravel(camera.get_translation())))


def _rig_of(found: RigCalibration) -> Rig:
    reports = found.reports.values()
    offsets = np.array([report.offset_us for report in reports])
    return Rig(tuple(found.cameras.values()), offsets, np.array([report.drift_ppm for report in reports]))


def _blocks(track: PointTrack, half: int) -> PointTrack:
    keep = (track.t_us // BLOCK_US) % 2 == half
    return PointTrack.of(track.t_us[keep], track.uvs_px[keep], track.marker[keep])


def _clocks(found: RigCalibration) -> Row:
    return {"clock_ms": "/".join(f"{1e-3 * report.offset_us:.2f}" for report in found.reports.values())}
