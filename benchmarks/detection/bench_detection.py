"""Speed of the fast detector beside the readable reference in one process, that both agree, and how good they are.

For each row the two are timed alternately on the same windows, in thread CPU time, with the caches emptied before every
call by reading a buffer larger than the last-level cache: the regime of a machine that does other things between two
windows. Every timed window has the ball in the picture. In mode `roi` the region lies where the ball was.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, report_rows_to
from core.cameras.presets import stereo_preset
from core.config import replace_setting
from core.detection import Detection, DetectorConfig, FastDetector, TrackState, trace_window
from core.detection.methods import method_config
from core.events import Window
from core.metrics.run import duration_of
from core.metrics.score import score_recording
from core.recordings import CameraStream, PixelTruth, open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, scene_named, simulate_recording

TOLERANCE_PX: Final = 1e-3


def distance_px(one: Detection | None, other: Detection | None) -> float:
    """Largest difference of u, v or r, or endless if only one found a ball or their times differ."""
    if one is None or other is None:
        return 0.0 if one is other else np.inf
    off_px = max(abs(one.u_px - other.u_px), abs(one.v_px - other.v_px), abs(one.r_px - other.r_px))
    return off_px if one.t_us == other.t_us else np.inf


def simulate_flights(
    scene: str, noise_hz: float, speeds_mps: tuple[float, ...], *, seed: int, placement: str = "side"
) -> list[CameraStream]:
    """Both 1280x720 cameras of a placement while one serve, or rally, of each speed flies by.

    Raises:
        RallyscopeError: for an unknown scene.
    """
    config = StereoConfig(scene=scene_named(scene), sensor=SensorConfig(noise_hz=noise_hz))
    serves = [LaunchConfig(speed_mps=speed) for speed in speeds_mps]
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as folder:
        path = Path(folder) / "flights.h5"
        simulate_recording(path, config, stereo_preset(placement), serves, seed=seed)
        return list(open_recording(path).cameras.values())


SPEEDS_MPS: Final = (4.0, 5.0, 6.0, 7.0)
CASES: Final = (("paper", 0.1), ("paper", 1.0), ("auto", 1.0), ("paper", 5.0))
"""Method and noise (events per second and pixel) of the rows."""
WINDOWS_US: Final = (1000, 2000)
MODES: Final = ("full", "roi")
WINDOWS_TIMED: Final = 1000
CACHE_BYTES: Final = 48 << 20
"""Read before each timed call; more than the last-level cache of common machines."""

Progress = Callable[[float], None]


def run(progress: Progress) -> dict[str, object]:
    """Rows as the command line's contract names them, and the machine."""
    rows: list[dict[str, object]] = []
    evict = np.zeros(CACHE_BYTES // 8, np.int64)
    streams: dict[float, list[CameraStream]] = {}
    steps = len(CASES) * len(WINDOWS_US) * len(MODES)
    for method, noise_hz in CASES:
        if noise_hz not in streams:
            streams = {noise_hz: simulate_flights("ball", noise_hz, SPEEDS_MPS, seed=11)}
        for window_us in WINDOWS_US:
            for mode in MODES:
                config = replace_setting(method_config(method), ("roi", "enabled"), mode == "roi")
                row = {"scene": "ball", "noise_hz": noise_hz, "window_us": window_us, "mode": mode, "method": method}
                timed = time_both(streams[noise_hz], config, window_us, WINDOWS_TIMED, evict)
                rows.append(row | timed | accuracy(streams[noise_hz], config, window_us))
                report_rows_to(progress, rows[-1:], len(rows) / steps)
    return {
        "rows": rows,
        "machine": describe_machine(
            "numpy",
            "numba",
            "scikit-learn",
            clock="thread CPU time",
            caches=f"cold: {CACHE_BYTES >> 20} MiB are read before every call, reference and fast alternate",
            sensor="1280x720, ball simulated at 4 to 7 m/s, in the picture in every timed window",
        ),
    }


def time_both(
    streams: Sequence[CameraStream], config: DetectorConfig, window_us: int, count: int, evict: NDArray[np.int64]
) -> dict[str, object]:
    """Compare the fast detector with the reference on `count` windows with the ball in the picture, its track known.

    Milliseconds of thread CPU time of the fast detector and the reference, ratios of the reference's to the fast one's,
    and in how many windows they did not answer the same.
    """
    cases = [(stream, start_us) for stream in streams for start_us in _starts(stream, window_us, count // len(streams))]
    fast = FastDetector(config, streams[0].sensor)
    for stream, start_us in cases[:5]:  # compile and load
        window, state = _case(stream, start_us, window_us)
        _time_fast(fast, window, state)
        trace_window(window, state, config)
    fast_ns, reference_ns, differing = [], [], 0
    for stream, start_us in cases:
        window, state = _case(stream, start_us, window_us)
        evict.sum()
        begin_ns = time.thread_time_ns()
        trace = trace_window(window, state, config)
        reference_ns.append(time.thread_time_ns() - begin_ns)
        evict.sum()
        found, took_ns = _time_fast(fast, window, state)
        fast_ns.append(took_ns)
        differing += distance_px(trace.detection, found) > TOLERANCE_PX or trace.extra_circles != fast.extra_circles
    (p50, p99), (reference_p50, reference_p99) = (np.percentile(ns, (50, 99)) / 1e6 for ns in (fast_ns, reference_ns))
    return {
        "p50_ms": float(p50),
        "p99_ms": float(p99),
        "ratio_p50": float(reference_p50 / p50),
        "ratio_p99": float(reference_p99 / p99),
        "windows": len(cases),
        "reference_p50_ms": float(reference_p50),
        "reference_p99_ms": float(reference_p99),
        "differing": differing,
    }


def accuracy(streams: Sequence[CameraStream], config: DetectorConfig, window_us: int) -> dict[str, object]:
    """Means over the cameras of precision, recall and errors, windows in a row with the live region of interest."""
    scores = [score_recording(stream, config, window_us=window_us) for stream in streams]
    names = ("precision", "recall", "precision_all_circles", "mean_error_px", "median_error_px", "p95_error_px")
    return {name: float(np.mean([getattr(score, name) for score in scores])) for name in names}


def _starts(stream: CameraStream, window_us: int, count: int) -> NDArray[np.int64]:
    """Starts of so many windows, evenly spread over the times when the ball is seen; they overlap if need be."""
    starts, truth = np.arange(0, duration_of(stream) - window_us, 100), _truth(stream)
    seen = truth.at(starts).visible & truth.at(starts + window_us).visible
    return starts[seen][np.linspace(0, seen.sum() - 1, count).astype(np.int64)]


def _truth(stream: CameraStream) -> PixelTruth:
    assert stream.truth is not None, "it is simulated"
    return stream.truth


def _case(stream: CameraStream, start_us: int, window_us: int) -> tuple[Window, TrackState]:
    truth = _truth(stream).at(start_us)
    centre_px = (round(float(truth.u_px[0]), 2), round(float(truth.v_px[0]), 2))
    window = Window(stream.slice(start_us, start_us + window_us), start_us, start_us + window_us)
    return window, TrackState(centre_px=centre_px)


def _time_fast(fast: FastDetector, window: Window, state: TrackState) -> tuple[Detection | None, int]:
    fast.resume(state)
    begin_ns = time.thread_time_ns()
    found = fast.step(window)
    return found, time.thread_time_ns() - begin_ns
