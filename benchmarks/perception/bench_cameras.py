"""3D errors with all cameras of a rig, with each one taken away, and with one that sees something else.

Each serve is simulated once and followed by the chain that `track` runs, with all cameras and with all but one. In the
rows `wrong NAME` that camera's pixels are replaced, after detection, by those of a point that moves elsewhere.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine
from benchmarks.partial_rows import report_rows_to
from core.cameras import Camera, StereoRig, load_calibration
from core.cameras.presets import CORNERS, camera_preset
from core.chain import ChainConfig
from core.chain.follow import Track, follow_recording, true_positions
from core.recordings import BallTruth, open_recording
from core.simulation import LaunchConfig, StereoConfig, simulate_recording
from core.simulation.scenes.scene import scene_named

Array = NDArray[np.float64]
Row = dict[str, object]

SCENES: Final = ("ball", "person", "rally")
SPEEDS_MPS: Final = (5.0, 7.0, 9.0)
SERVES: Final = 2
FIRST_SEED: Final = 30_000
WINDOW_US: Final = 1000
WRONG_POINTS: Final = 2000
SIGMA_PX: Final = 0.2
"""Of the pixels in the rows `wrong`: the refined detector's are about as good."""
ASTRAY_PX: Final = (3.0, 300.0)
"""So far is the wrong camera's pixel from the ball, log-uniform."""


def run(progress: Callable[[float], None], *, rig: Path | None = None, count: int = SERVES) -> dict[str, object]:
    """Rows per scene and set of cameras, and the machine."""
    cameras = camera_preset(CORNERS) if rig is None else load_calibration(rig)
    rows: list[Row] = []
    total = len(SCENES) * len(SPEEDS_MPS) * count
    done = 0
    for scene in SCENES:
        errors: dict[str, list[Array]] = {}
        windows: dict[str, int] = {}
        for speed_mps in SPEEDS_MPS:
            for number in range(count):
                seed = FIRST_SEED + 1000 * SCENES.index(scene) + 100 * int(speed_mps) + number
                for name, track, truth in _tracks(cameras, scene, speed_mps, seed):
                    errors.setdefault(name, []).append(_errors_mm(track, truth))
                    windows[name] = windows.get(name, 0) + track.windows
                done += 1
                progress(done / total)
        made = [_row(scene, name, np.concatenate(parts), windows[name]) for name, parts in errors.items()]
        report_rows_to(progress, made, done / total)
        rows += made
    wrong = [measure_wrong(cameras, name) for name in cameras]
    report_rows_to(progress, wrong, 1.0)
    return {"rows": rows + wrong, "machine": describe_machine("numba", "numpy", clock="no times are measured")}


def measure_wrong(cameras: dict[str, Camera], wrong: str, points: int = WRONG_POINTS, seed: int = FIRST_SEED) -> Row:
    """How far points move when one camera takes something else for the ball."""
    rng = np.random.default_rng(seed)
    rig = StereoRig(cameras)
    ps = rng.uniform((-1.3, -0.7, 0.02), (0.3, 0.7, 0.5), (points, 3))
    moved: list[float] = []
    left_out = 0
    for p in ps:
        uvs = np.array([camera.project(p[None])[0] for camera in cameras.values()])
        uvs += rng.normal(0, SIGMA_PX, uvs.shape)
        covariances = np.broadcast_to(SIGMA_PX**2 * np.eye(2), (len(cameras), 2, 2))
        right = rig.triangulate_one(uvs, covariances)
        place = rig.names.index(wrong)
        angle, away_px = rng.uniform(0, 2 * np.pi), np.exp(rng.uniform(*np.log(ASTRAY_PX)))
        uvs[place] += away_px * np.array([np.cos(angle), np.sin(angle)])
        found = rig.triangulate_one(uvs, covariances)
        if right is not None and found is not None:
            moved.append(1e3 * float(np.linalg.norm(found.p_world_m - right.p_world_m)))
            left_out += wrong not in found.cameras
    return _row("points alone", f"wrong {wrong}", np.array(moved), points) | {"left_out": left_out / points}


def _tracks(
    cameras: dict[str, Camera], scene: str, speed_mps: float, seed: int
) -> Iterator[tuple[str, Track, BallTruth]]:
    config = StereoConfig(scene=scene_named(scene))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "serve.h5"
        simulate_recording(path, config, cameras, [replace(LaunchConfig(), speed_mps=speed_mps)], seed=seed)
        with open_recording(path) as recording:
            assert recording.ball is not None
            for without in (None, *cameras):
                only = [name for name in cameras if name != without]
                name = "all" if without is None else f"without {without}"
                yield name, follow_recording(recording, ChainConfig(), WINDOW_US, only=only), recording.ball


def _errors_mm(track: Track, truth: BallTruth) -> Array:
    errors = np.linalg.norm(track.ps_world_m - true_positions(truth, track.t_us), axis=1)
    return 1e3 * errors[np.isfinite(errors)]


def _row(scene: str, cameras: str, errors_mm: Array, windows: int) -> Row:
    return {
        "scene": scene,
        "cameras": cameras,
        "points": len(errors_mm),
        "windows": windows,
        "median_mm": round(float(np.median(errors_mm)), 3) if len(errors_mm) else None,
        "p95_mm": round(float(np.percentile(errors_mm, 95)), 3) if len(errors_mm) else None,
        "max_mm": round(float(errors_mm.max()), 3) if len(errors_mm) else None,
    }
