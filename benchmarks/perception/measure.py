"""One method on one recording: everything that the report says of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from benchmarks.perception.hitting_point import space_errors
from benchmarks.perception.limits import CircleBounds, circle_bounds, read_time_ns
from benchmarks.perception.loaded_camera import LoadedCamera, load_camera
from benchmarks.perception.plan import METHODS, chain_of
from benchmarks.perception.recovery import recovery_times_ms
from benchmarks.perception.results import PerceptionResult, RecordingReading, ShownAnswer, rounded
from core.cameras import Camera
from core.chain.follow import calibrated_cameras
from core.detection import make_detector
from core.detection.methods import Method, method_config
from core.detection.window import windows_between
from core.metrics.grid_score import GridScore, score_on_grid, wholly_in_view
from core.metrics.run import WindowAnswers, run_detector
from core.metrics.timed import TimedDetector
from core.recordings import BallTruth
from core.recordings.reader import FileRecording

ANY_SPEED: Final = (0.0, 1e9)
"""Of the ball in the picture, px/ms: all of them."""
WARM_UP_US: Final = 100_000
COMMON_US: Final = math.lcm(*(method_config(method).window.window_us for method in METHODS))
"""Every method has a window that ends at whole multiples of it."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedRecording:
    """A simulated recording with its events in memory."""

    scene: str
    seed: int
    name: str
    file: FileRecording
    cameras: dict[str, LoadedCamera]
    calibrations: dict[str, Camera]
    ball: BallTruth


def load_recording(file: FileRecording, *, scene: str, seed: int, name: str) -> LoadedRecording:
    """Read all of it but the frames.

    Raises:
        CalibrationError: if a camera has no calibration.
    """
    ball = file.ball
    assert ball is not None, "simulated recordings know where the ball is"
    cameras = {camera: load_camera(stream) for camera, stream in file.cameras.items()}
    return LoadedRecording(scene, seed, name, file, cameras, calibrated_cameras(file), ball)


def measure_method(recording: LoadedRecording, method: Method) -> PerceptionResult:
    """The detector alone on every camera, then the whole chain."""
    config, chain = method_config(method), chain_of(method)
    window_us = config.window.window_us
    score, seconds, windows, events = GridScore(), [], 0, 0
    recovery: list[float | None] = []
    bounds: list[CircleBounds] = []
    shown: list[ShownAnswer | None] = []
    end_us = shown_window(recording)
    with one_thread():
        for camera in recording.cameras.values():
            _warm_up(camera, method)
            detector = TimedDetector(make_detector(method, camera.sensor))
            answers = run_detector(camera, detector, window_us)
            score += score_on_grid(answers, camera.truth, camera.sensor, ANY_SPEED, window_us=window_us)
            seconds.append(np.array(detector.seconds)[answers.detected])
            windows += len(answers.end_us)
            events += len(camera.slice(0, window_us * len(answers.end_us)))
            recovery += recovery_times_ms(answers, camera.truth)
            bounds += circle_bounds(camera, method, config)
            shown.append(answer_at(answers, end_us))
        space = space_errors(recording.cameras, recording.calibrations, recording.ball, chain)
    return PerceptionResult(
        scene=recording.scene,
        seed=recording.seed,
        recording=recording.name,
        method=method,
        window_us=window_us,
        windows=windows,
        asked=score.asked,
        found=score.found,
        answers=score.answers,
        false=score.false,
        error_px=rounded(score.error_px),
        events=events,
        cpu_ms=rounded(1e3 * np.concatenate(seconds)),
        recovery_ms=tuple(recovery),
        bound_px=rounded([bound.events_px for bound in bounds]),
        pixel_bound_px=rounded([bound.pixels_px for bound in bounds]),
        point_mm=rounded(space.point_mm),
        points_without_ball=space.points_without_ball,
        hits=space.hits,
        hit_mm=rounded(space.hit_mm),
        shown=shown[0],
    )


def read_recording(recording: LoadedRecording) -> RecordingReading:
    """What frames there are, and what reading the events once costs."""
    frames = {name: stream for name, stream in recording.file.frames.items() if len(stream)}
    with_ball = sum(int(recording.cameras[name].truth.at(one.t_us).visible.sum()) for name, one in frames.items())
    one = next(iter(frames.values()), None)
    return RecordingReading(
        scene=recording.scene,
        seed=recording.seed,
        recording=recording.name,
        seconds=sum(1e-3 * len(camera.counts_per_ms()) for camera in recording.cameras.values()),
        events=sum(camera.event_count for camera in recording.cameras.values()),
        frames=sum(len(stream) for stream in frames.values()),
        frames_with_ball=with_ball,
        frame_bytes=0 if one is None else one.image(0).nbytes,
        frame_period_us=0 if one is None or len(one) < 2 else round(float(np.median(np.diff(one.t_us)))),
        exposure_us=0 if one is None else int(one.exposure_us[0]),
        read_ns=round(min(read_time_ns(camera.events) for camera in recording.cameras.values()), 3),
        shown_us=shown_window(recording),
    )


def shown_window(recording: LoadedRecording) -> int | None:
    """End of the window that is drawn: in the middle of those with the whole ball in the first camera's picture."""
    camera = next(iter(recording.cameras.values()))
    ends_us = np.arange(COMMON_US, 1000 * len(camera.counts_per_ms()) + 1, COMMON_US)
    ends_us = ends_us[wholly_in_view(camera.truth.at(ends_us), camera.sensor)]
    return int(ends_us[len(ends_us) // 2]) if len(ends_us) else None


def answer_at(answers: WindowAnswers, end_us: int | None) -> ShownAnswer | None:
    """What was said of the window that ends then; None if nothing, or if it is not known when."""
    if end_us is None:
        return None
    for row in np.flatnonzero(answers.detected & (answers.end_us == end_us)).tolist():
        place = (round(float(column[row]), 3) for column in (answers.u_px, answers.v_px, answers.r_px))
        u_px, v_px, r_px = place
        return ShownAnswer(t_us=int(answers.t_us[row]), u_px=u_px, v_px=v_px, r_px=r_px)
    return None


def _warm_up(camera: LoadedCamera, method: Method) -> None:
    """Compile and load what the method needs, on windows with the ball: that is no part of a step."""
    visible = camera.truth.t_us[camera.truth.visible]
    start_us = int(visible[0]) if len(visible) else 0
    detector, window_us = make_detector(method, camera.sensor), method_config(method).window.window_us
    for window in windows_between(camera, start_us, start_us + WARM_UP_US, window_us):
        detector.step(window)


@contextmanager
def one_thread() -> Iterator[None]:
    """What OpenCV computes in threads of its own would not be counted."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
