"""3D errors against calibration errors, and what the calibration of a rig achieves on simulated sweeps.

Rows: a camera placement, an error of the calibration (rms over the volume above the table, in each camera's picture)
and the noise of the detector. Errors are those of all points of all draws together.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration.calibration_error import Part, SpaceErrors, perturb, seen_volume, space_errors
from benchmarks.calibration.swept_ball import BallSwing, click_corners, seen_by
from benchmarks.machine import describe_machine
from benchmarks.partial_rows import report_rows_to
from core.cameras import Camera, stereo_preset
from core.cameras.calibration.point_track import PointTrack
from core.cameras.calibration.rig import calibrate_rig
from core.cameras.calibration.rig_result import RigCalibration
from core.cameras.calibration.scale import Scale
from core.cameras.presets import PLACEMENTS
from core.detection import make_detector
from core.detection.config import auto_config
from core.events import Events
from core.geometry import invert_transform
from core.metrics import run_detector
from core.recordings import RecordingWriter, open_recording
from core.simulation.event_cameras.stereo import StereoConfig, simulate_stereo
from core.simulation.flights.ball_path import BallPath
from core.simulation.flights.flight_series import draw_serve_series
from core.simulation.flights.serve import LaunchConfig

Array = NDArray[np.float64]
Row = dict[str, object]
Figures = dict[str, float]
Progress = Callable[[float], None]

LEVELS_PX: Final = (0.0, 0.1, 0.2, 0.5)
NOISE_PX: Final = 0.4
"""Standard deviation of a detection along each picture axis."""
DRAWS: Final = 100
POINTS: Final = 400
SEEDS: Final = (0, 1, 2)
AHEAD_US: Final = 1700
CLICK_PX: Final = 1.0
SWING_S: Final = 6.0
SERVE_SPEEDS_MPS: Final = (4.0, 5.0, 6.0, 5.0, 7.0, 4.0, 6.0, 5.0)


def run(progress: Progress) -> dict[str, object]:
    """Rows per placement, calibration error and noise; which part of the calibration matters; and the rigs."""
    rows: list[Row] = []
    for placement in PLACEMENTS:
        for level_px in LEVELS_PX:
            found = [error_row(placement, level_px, noise_px, "both") for noise_px in (0.0, NOISE_PX)]
            rows += found
            report_rows_to(progress, found, 0.1 * len(rows) / (len(PLACEMENTS) * len(LEVELS_PX) * 2))
    parts: list[Part] = ["pose", "lens"]
    by_part = [error_row(placement, 0.2, 0.0, part) for placement in PLACEMENTS for part in parts]
    rigs: list[Row] = []
    cases = [(placement, swept, events) for events in (False, True) for swept in SWEPT for placement in PLACEMENTS]
    for placement, swept, events in cases:
        rigs.append(rig_row(placement, swept, events))
        progress(0.1 + 0.9 * len(rigs) / len(cases))
    remarks = {"draws": str(DRAWS), "points": str(POINTS), "seeds_of_a_rig": str(len(SEEDS))}
    return {
        "rows": rows,
        "by_part": by_part,
        "rigs": rigs,
        "machine": describe_machine("numpy", "opencv-python-headless", **remarks),
    }


def error_row(placement: str, level_px: float, noise_px: float, part: Part, *, draws: int = DRAWS) -> Row:
    """Errors of positions for one size of calibration error."""
    rng = np.random.default_rng(0)
    cameras = stereo_preset(placement)
    ps = seen_volume(cameras, POINTS, rng)
    found = []
    for _ in range(draws):
        believed = {name: perturb(camera, ps, level_px, part, rng) for name, camera in cameras.items()}
        found.append(space_errors(cameras, believed, ps, noise_px, rng))
    every = SpaceErrors(
        np.concatenate([one.depth_m for one in found]), np.concatenate([one.lateral_m for one in found])
    )
    names = {"placement": placement, "error_px": level_px, "part": part, "noise_px": noise_px}
    return {**names, **_millimetres(every), "seen": round(len(ps) / POINTS, 2)}


def _millimetres(errors: SpaceErrors) -> Figures:
    row: Figures = {}
    for name, values in (("3d", errors.whole_m), ("depth", errors.depth_m), ("lateral", errors.lateral_m)):
        good = values[np.isfinite(values)]
        row[f"{name}_median_mm"] = round(1e3 * float(np.median(good)), 2)
        row[f"{name}_p95_mm"] = round(1e3 * float(np.percentile(good, 95)), 2)
    return row


def _swing(seed: int) -> BallPath:
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    return BallSwing(SWING_S, phases_rad=(float(phases[0]), float(phases[1]), float(phases[2])))


def _serves(seed: int) -> BallPath:
    configs = [LaunchConfig(speed_mps=speed, yaw_spread_deg=6.0) for speed in SERVE_SPEEDS_MPS]
    return draw_serve_series(configs, np.random.default_rng(seed))


SWEPT: Final[Mapping[str, tuple[Callable[[int], BallPath], Scale]]] = {
    "swing": (_swing, Scale("table")),
    "serves": (_serves, Scale("gravity", drag_per_m=0.0)),
}
"""How the ball moves, and what gives the scale; the table's corners place the cameras in both."""


def rig_row(placement: str, swept: str, events: bool, *, seeds: tuple[int, ...] = SEEDS) -> Row:
    """What `calibrate stereo` finds, over some sweeps: medians and worst of its errors, with clicked corners."""
    cameras = stereo_preset(placement)
    path_of, scale = SWEPT[swept]
    found: list[Figures] = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        tracks = _detected(cameras, path_of(seed), seed) if events else _sighted(cameras, path_of(seed), rng)
        lenses = {name: replace(camera, T_world_camera=np.eye(4)) for name, camera in cameras.items()}
        rig = calibrate_rig(tracks, lenses, scale, clicks=click_corners(cameras, rng, CLICK_PX))
        found.append(rig_errors(rig, cameras, rng))
    names: Row = {"placement": placement, "swept": swept, "pixels": "detector" if events else f"truth + {NOISE_PX} px"}
    medians = {key: round(float(np.median([row[key] for row in found])), 3) for key in found[0]}
    return names | medians | {"clock_worst_us": round(max(abs(row["clock_us"]) for row in found), 1)}


def rig_errors(rig: RigCalibration, true: Mapping[str, Camera], rng: np.random.Generator) -> Figures:
    """How far a calibrated rig of two is from the true one."""
    second = list(true)[1]
    got, wanted = (_relative(cameras) for cameras in (rig.cameras, true))
    ps = seen_volume(true, POINTS, rng)
    moved_px = np.concatenate([rig.cameras[name].project(ps) - camera.project(ps) for name, camera in true.items()])
    errors = space_errors(true, rig.cameras, ps, 0.0, rng)
    cosine = (float(np.trace(got[:3, :3].T @ wanted[:3, :3])) - 1) / 2
    return {
        "sighting_px": rig.sigma_px,
        "clock_us": rig.fits[second].offset_us - AHEAD_US,
        "sigma_clock_us": rig.fits[second].sigma_offset_us,
        "baseline_mm": 1e3 * abs(rig.baseline_m - float(np.linalg.norm(wanted[:3, 3]))),
        "sigma_baseline_mm": 1e3 * rig.sigma_baseline_m,
        "turned_deg": float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))),
        "reprojection_px": float(np.sqrt(np.square(moved_px).sum(axis=1).mean())),
        **_millimetres(errors),
    }


def _relative(cameras: Mapping[str, Camera]) -> Array:
    first, second = list(cameras.values())[:2]
    return invert_transform(first.T_world_camera) @ second.T_world_camera


def _sighted(cameras: Mapping[str, Camera], path: BallPath, rng: np.random.Generator) -> dict[str, PointTrack]:
    return {
        name: seen_by(camera, path, rng, noise_px=NOISE_PX, clock_ahead_us=AHEAD_US * (number > 0), stray_share=0.01)
        for number, (name, camera) in enumerate(cameras.items())
    }


def _detected(cameras: Mapping[str, Camera], path: BallPath, seed: int) -> dict[str, PointTrack]:
    """What the detector says of simulated events, the clocks of all but the first camera ahead."""
    ahead_us = {name: AHEAD_US * (number > 0) for number, name in enumerate(cameras)}
    tracks = {}
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as folder:
        file = Path(folder) / "sweep.h5"
        with RecordingWriter(file, {name: camera.sensor for name, camera in cameras.items()}) as writer:
            for chunk in simulate_stereo(StereoConfig(), cameras, path, seed=seed):
                for name, e in chunk.events.items():
                    late = Events.from_columns(e.t_us + ahead_us[name], e.x_px, e.y_px, e.on, e.sensor)
                    writer.append(name, late)
        with open_recording(file) as recording:
            for name, stream in recording.cameras.items():
                answers = run_detector(stream, make_detector("auto", stream.sensor), auto_config().window.window_us)
                uvs_px = np.column_stack([answers.u_px, answers.v_px])
                tracks[name] = PointTrack.of(answers.t_us[answers.detected], uvs_px[answers.detected])
    return tracks
