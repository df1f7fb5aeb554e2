"""3D errors of a rig with one faulty camera: blind in half of its picture, or turned since it was calibrated.

The serves of a rig are simulated once, one after the other, and followed by the chain that `track` runs. In the rows
`half NAME` the events of that camera's left or right half are left out; in the rows `turned NAME` the chain believes a
pose that moves that camera's picture by half a pixel, and the row has what the alarm says of it. In the rows `named
NAME` the chain believes that pose too, and weighs the camera from the start as it does once the alarm has named it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from core.cameras import Camera
from core.chain import RallyChain
from core.chain.calibration_drift import CalibrationDrift, DriftReport
from core.chain.follow import true_positions
from core.detection.window import windows_side_by_side
from core.events import Events, Window
from core.geometry import make_transform
from core.recordings import Recording, open_recording
from core.simulation import LaunchConfig, StereoConfig, simulate_recording

Array = NDArray[np.float64]
Row = dict[str, object]

TURNED_PX: Final = 0.5
"""How far a wrong pose moves a camera's picture at its centre."""
FIRST_SEED: Final = 930_000
SERVES_OF_SPEED: Final = 3
"""The alarm needs 200 points 10 ms apart of each pair of cameras."""
WINDOW_US: Final = 1000
HALVES: Final = ("left", "right")


def measure_faults(cameras: Mapping[str, Camera], speeds_mps: Sequence[float], seed: int = FIRST_SEED) -> Iterator[Row]:
    """Rows `all`, `half NAME`, `turned NAME` and `named NAME` of one recording of a serve of each speed."""
    serves = [replace(LaunchConfig(), speed_mps=speed_mps) for speed_mps in speeds_mps]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "serves.h5"
        simulate_recording(path, StereoConfig(), dict(cameras), serves, seed=seed)
        with open_recording(path) as recording:
            yield _row("all", *_followed(recording, cameras))
            for name in cameras:
                for half in HALVES:
                    yield _row(f"half {name}", *_followed(recording, cameras, blind=(name, half))) | {"half": half}
            rng = np.random.default_rng(seed)
            for name in cameras:
                believed = turned(cameras, name, TURNED_PX, rng)
                errors_mm, report = _followed(recording, believed)
                yield _row(f"turned {name}", errors_mm, report) | {"named": report.camera}
                yield _row(f"named {name}", *_followed(recording, believed, named=name))


def turned(cameras: Mapping[str, Camera], name: str, off_px: float, rng: np.random.Generator) -> dict[str, Camera]:
    """The cameras, one of which is turned so that the middle of its picture moves so far, in any direction."""
    camera = cameras[name]
    T, axis = camera.T_world_camera, rng.normal(size=2)
    turn = Rotation.from_rotvec([*(off_px / camera.K[0, 0] * axis / np.linalg.norm(axis)), 0.0]).as_matrix()
    return {**cameras, name: replace(camera, T_world_camera=make_transform(T[:3, :3] @ turn, T[:3, 3]))}


def without_half(window: Window, half: str) -> Window:
    """The window without the events of one half of the picture."""
    events, middle_px = window.events, window.events.sensor.width_px // 2
    kept = events.x_px >= middle_px if half == "left" else events.x_px < middle_px
    left = Events.from_columns(events.t_us[kept], events.x_px[kept], events.y_px[kept], events.on[kept], events.sensor)
    return replace(window, events=left)


def _followed(
    recording: Recording,
    believed: Mapping[str, Camera],
    blind: tuple[str, str] | None = None,
    named: str | None = None,
) -> tuple[Array, DriftReport]:
    """Errors (N,) of the points in mm, and what is said of the calibration at the end."""
    assert recording.ball is not None
    chain, drift = RallyChain(believed), CalibrationDrift(believed)
    t_us: list[int] = []
    ps: list[Array] = []
    for windows in windows_side_by_side(recording.cameras, 0, recording.duration_us, WINDOW_US):
        if blind is not None and blind[0] in windows:
            windows = {**windows, blind[0]: without_half(windows[blind[0]], blind[1])}
        state = chain.step(windows)
        report = drift.add(state)
        chain.distrust(*((named, TURNED_PX) if named is not None else report.distrusted))
        if state.point is not None:
            t_us.append(state.point.t_us)
            ps.append(state.point.p_world_m)
    errors_m = np.linalg.norm(np.array(ps).reshape(-1, 3) - true_positions(recording.ball, t_us), axis=1)
    return 1e3 * errors_m[np.isfinite(errors_m)], drift.report


def _row(cameras: str, errors_mm: Array, report: DriftReport) -> Row:
    p50, p95 = np.percentile(errors_mm, [50, 95]) if len(errors_mm) else (np.nan, np.nan)
    return {
        "scene": "ball",
        "cameras": cameras,
        "points": len(errors_mm),
        "median_mm": round(float(p50), 3),
        "p95_mm": round(float(p95), 3),
        "max_mm": round(float(errors_mm.max()), 3) if len(errors_mm) else None,
        "drift_alarm": report.alarm,
    }
