"""3D errors with all cameras of a rig, with each one taken away, with one that sees something else, and with one alone.

Each serve is simulated once and followed by the chain that `track` runs, with all cameras and with all but one. In the
rows `wrong NAME` that camera's pixels are replaced, after detection, by those of a point that moves elsewhere. In the
rows `only NAME` all cameras but that one go blind for 100 ms, 80 ms after the ball came into view; the row `only one`
has all of them together, and which direction the stated covariance is right in. The rows `half NAME`, `turned NAME` and
`named NAME` are those of `camera_faults`.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, report_rows_to
from benchmarks.perception.camera_faults import FIRST_SEED as FAULTS_SEED
from benchmarks.perception.camera_faults import SERVES_OF_SPEED, measure_faults
from core.cameras import Camera, StereoRig, load_calibration
from core.cameras.presets import CORNERS, camera_preset
from core.chain import ChainConfig, RallyChain
from core.chain.follow import Track, follow_recording, true_positions
from core.detection.window import windows_side_by_side
from core.errors import CommandError
from core.events import Events, Window
from core.live.live_player import LivePlayerConfig
from core.recordings import BallTruth, Recording, open_recording
from core.simulation import LaunchConfig, StereoConfig, simulate_recording
from core.simulation.scenes.scene import scene_named

Array = NDArray[np.float64]
Row = dict[str, object]

SCENES: Final = ("ball", "person", "rally")
SPEEDS_MPS: Final = (5.0, 7.0, 9.0)
SERVES: Final = 2
FIRST_SEED: Final = 30_000
PARTS: Final = {"scenes": FIRST_SEED, "wrong": FIRST_SEED, "alone": 920_000, "faults": FAULTS_SEED, "pace": FIRST_SEED}
"""What `--only` chooses from, with the first seed of each."""
WINDOW_US: Final = 1000
WRONG_POINTS: Final = 2000
SIGMA_PX: Final = 0.2
"""Of the pixels in the rows `wrong`: the refined detector's are about as good."""
ASTRAY_PX: Final = (3.0, 300.0)
"""So far is the wrong camera's pixel from the ball, log-uniform."""
SEEN_US: Final = 80_000
ALONE_US: Final = 100_000
"""All cameras see the ball for so long, then one alone."""
ALONE_STEP_MS: Final = 25
NOISE_HZ: Final = 5.0
"""Per pixel, in the row `pace`."""
WARM_UP: Final = 20
"""First windows that do not count in it."""


def run(
    progress: Callable[[float], None],
    *,
    rig: Path | None = None,
    count: int | None = None,
    only: str | None = None,
    seed: int | None = None,
) -> dict[str, object]:
    """Rows per scene and set of cameras, the paces, and the machine; of one of `PARTS` with `only`.

    Raises:
        CommandError: if there is no such part, or a seed without one: each has its own.
    """
    if only is not None and only not in PARTS:
        raise CommandError("no such part of `bench cameras`", expected=", ".join(PARTS), got=only)
    if seed is not None and only is None:
        raise CommandError("each part has its own seeds", expected="--only PART with --seed", got=str(seed))
    cameras = camera_preset(CORNERS) if rig is None else load_calibration(rig)
    # The alarm needs so many serves that `count` is theirs only where nothing else is measured.
    of_faults = SERVES_OF_SPEED if count is None or only is None else count
    count = SERVES if count is None else count
    first = {name: default if seed is None else seed for name, default in PARTS.items()}
    rows: list[Row] = []
    if only in (None, "scenes"):
        rows += _scene_rows(progress, cameras, count, first["scenes"])
    more: list[Row] = []
    if only in (None, "wrong"):
        more += [measure_wrong(cameras, name, seed=first["wrong"]) for name in cameras]
    if only in (None, "alone"):
        more += measure_alone(cameras, [first["alone"] + number for number in range(len(SPEEDS_MPS) * count)])
    if only in (None, "faults"):
        more += measure_faults(cameras, SPEEDS_MPS * of_faults, first["faults"])
    report_rows_to(progress, more, 1.0)
    report: dict[str, object] = {"rows": rows + more}
    if only in (None, "pace"):
        report["pace"] = measure_pace(cameras, seed=first["pace"])
        report["live_pace"] = measure_pace(cameras, seed=first["pace"], window_us=LivePlayerConfig().window_us)
    return report | {"machine": describe_machine("numba", "numpy", clock="only the pace: CPU time of this process")}


def _scene_rows(
    progress: Callable[[float], None], cameras: dict[str, Camera], count: int, first_seed: int
) -> list[Row]:
    """Rows with all cameras, and with all but one, of each scene."""
    rows: list[Row] = []
    total = len(SCENES) * len(SPEEDS_MPS) * count
    done = 0
    for scene in SCENES:
        errors: dict[str, list[Array]] = {}
        windows: dict[str, int] = {}
        for speed_mps in SPEEDS_MPS:
            for number in range(count):
                seed = first_seed + 1000 * SCENES.index(scene) + 100 * int(speed_mps) + number
                for name, track, truth in _tracks(cameras, scene, speed_mps, seed):
                    errors.setdefault(name, []).append(_errors_mm(track, truth))
                    windows[name] = windows.get(name, 0) + track.windows
                done += 1
                progress(done / total)
        made = [_row(scene, name, np.concatenate(parts), windows[name]) for name, parts in errors.items()]
        report_rows_to(progress, made, done / total)
        rows += made
    return rows


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


class LonePoint(NamedTuple):
    """A point of one camera that carries a flight on."""

    after_ms: int
    """Since the others went blind, the start of its quarter."""
    error_m: Array
    """(3,)."""
    covariance_m2: Array
    """(3, 3), as stated."""
    axes: Array
    """(3, 3): along the true flight, up across it, and to its side, a row each."""


def measure_alone(cameras: dict[str, Camera], seeds: Sequence[int]) -> list[Row]:
    """Errors of the points of one camera that carries a flight on, and their normalised squared error (1 is ideal)."""
    found: dict[str, list[LonePoint]] = {name: [] for name in cameras}
    for seed in seeds:
        serve = replace(LaunchConfig(), speed_mps=SPEEDS_MPS[seed % len(SPEEDS_MPS)])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "serve.h5"
            simulate_recording(path, StereoConfig(), cameras, [serve], seed=seed)
            with open_recording(path) as recording:
                for name in cameras:
                    found[name] += _alone(recording, cameras, name)
    rows: list[Row] = []
    for name, points in sorted(found.items()):
        for after_ms in range(0, ALONE_US // 1000, ALONE_STEP_MS):
            these = [point for point in points if point.after_ms == after_ms]
            if these:
                rows.append(_row_alone(name, these) | {"after_ms": after_ms})
    everything = [point for points in found.values() for point in points]
    return [*rows, _row_alone("one", everything) | _by_direction(everything)] if everything else rows


def _row_alone(name: str, points: Sequence[LonePoint]) -> Row:
    errors_mm = 1e3 * np.linalg.norm([point.error_m for point in points], axis=1)
    squared = [point.error_m @ np.linalg.solve(point.covariance_m2, point.error_m) / 3 for point in points]
    return _row("ball", f"only {name}", errors_mm, len(points)) | {"nes": round(float(np.mean(squared)), 2)}


def _by_direction(points: Sequence[LonePoint]) -> Row:
    """Root mean square error and stated sigma in mm along the flight, up and to the side."""
    errors_m2 = np.mean([np.square(point.axes @ point.error_m) for point in points], axis=0)
    stated_m2 = np.mean([np.diag(point.axes @ point.covariance_m2 @ point.axes.T) for point in points], axis=0)
    row: Row = {}
    for axis, name in enumerate(("along", "up", "aside")):
        row[f"{name}_mm"] = round(1e3 * float(np.sqrt(errors_m2[axis])), 3)
        row[f"{name}_stated_mm"] = round(1e3 * float(np.sqrt(stated_m2[axis])), 3)
    return row


def _alone(recording: Recording, cameras: dict[str, Camera], name: str) -> Iterator[LonePoint]:
    """The points of the camera after the others went blind."""
    assert recording.ball is not None
    chain, blind_us = RallyChain(cameras), None
    for windows in windows_side_by_side(recording.cameras, 0, recording.duration_us, WINDOW_US):
        start_us = next(iter(windows.values())).start_us
        if blind_us is not None and start_us >= blind_us + ALONE_US:
            return
        if blind_us is not None and start_us >= blind_us:
            windows = {
                one: window
                if one == name
                else Window(Events.empty(cameras[one].sensor), window.start_us, window.end_us)
                for one, window in windows.items()
            }
        point = chain.step(windows).point
        if point is None:
            continue
        if blind_us is None:
            blind_us = point.t_us + SEEN_US
        elif start_us >= blind_us and len(point.uvs_px) == 1:
            before, true, after = true_positions(recording.ball, point.t_us + np.array([-1000, 0, 1000]))
            axes = _flight_axes(after - before)
            if np.isfinite(axes).all() and np.isfinite(true).all():
                age_ms = min(max(point.t_us - blind_us, 0), ALONE_US - 1) // 1000
                after_ms = age_ms - age_ms % ALONE_STEP_MS
                yield LonePoint(after_ms, point.p_world_m - true, point.covariance_m2, axes)


def _flight_axes(along: Array) -> Array:
    """(3, 3) unit rows: along a movement (3,), up across it, to its side."""
    along = along / np.linalg.norm(along)
    aside = np.cross(along, (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside)
    return np.array([along, np.cross(aside, along), aside])


def measure_pace(
    cameras: dict[str, Camera], noise_hz: float = NOISE_HZ, seed: int = FIRST_SEED, window_us: int = WINDOW_US
) -> Row:
    """CPU time of the chain for a millisecond of all cameras: a serve, and so many random events per pixel and second.

    Of the whole process, which uses one core. The serve is followed twice, and the second time counts: the first
    compiles what a prediction needs. `p10` is what it takes while nobody else uses core and caches.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "serve.h5"
        simulate_recording(path, StereoConfig(), cameras, [LaunchConfig()], seed=seed)
        with open_recording(path) as recording:
            _step_times_ms(recording, cameras, noise_hz, seed, window_us)
            steps_ms, events = _step_times_ms(recording, cameras, noise_hz, seed, window_us)
    p10, p50, p95 = np.percentile(steps_ms[WARM_UP:], [10, 50, 95])
    return {
        "cameras": len(cameras),
        "noise_hz": noise_hz,
        "window_us": window_us,
        "events_per_window": round(events / len(steps_ms)),
        "cpu_ms_per_ms": round(float(np.mean(steps_ms[WARM_UP:])), 3),
        "p10": round(float(p10), 3),
        "p50": round(float(p50), 3),
        "p95": round(float(p95), 3),
    }


def _step_times_ms(
    recording: Recording, cameras: dict[str, Camera], noise_hz: float, seed: int, window_us: int
) -> tuple[list[float], int]:
    """CPU time of each window by its length, and how many events there were."""
    rng, chain, events = np.random.default_rng(seed), RallyChain(cameras), 0
    steps_ms: list[float] = []
    for windows in windows_side_by_side(recording.cameras, 0, recording.duration_us, window_us):
        noisy = {name: _with_noise(window, noise_hz, rng) for name, window in windows.items()}
        events += sum(len(window.events) for window in noisy.values())
        started_s = time.process_time()
        chain.step(noisy)
        steps_ms.append(1e3 * (time.process_time() - started_s) * 1000 / window_us)
    return steps_ms, events


def _with_noise(window: Window, noise_hz: float, rng: np.random.Generator) -> Window:
    events, sensor = window.events, window.events.sensor
    length_us = window.end_us - window.start_us
    count = rng.poisson(noise_hz * 1e-6 * length_us * sensor.width_px * sensor.height_px)
    t_us = np.concatenate([events.t_us, rng.integers(window.start_us, window.end_us, count)])
    x_px = np.concatenate([events.x_px, rng.integers(0, sensor.width_px, count, dtype=np.uint16)])
    y_px = np.concatenate([events.y_px, rng.integers(0, sensor.height_px, count, dtype=np.uint16)])
    on, order = np.concatenate([events.on, rng.random(count) < 0.5]), np.argsort(t_us, kind="stable")
    return replace(window, events=Events.from_columns(t_us[order], x_px[order], y_px[order], on[order], sensor))


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
