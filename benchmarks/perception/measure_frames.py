"""The frame detector on the pictures of a recording: the same figures as of the methods that look at events."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.perception.measure import ANY_SPEED, LoadedRecording, one_thread
from benchmarks.perception.recovery import recovery_times_ms
from benchmarks.perception.results import PerceptionResult, rounded
from core.detection.yolo.detector import YoloDetector
from core.detection.yolo.weights import SHIPPED, YoloWeights, load_weights
from core.jobs.threads import one_torch_thread
from core.metrics.grid_score import GridScore, score_on_grid
from core.metrics.run import run_on_frames
from core.metrics.timed import TimedDetector
from core.recordings.frames import FrameStream, frame_windows

METHOD: Final = "yolo"
WARM_UP: Final = 2
"""Pictures before the first that counts."""
STAMP_DIGITS: Final = 10
"""Of a stamp."""


def weights_stamp(path: Path | None = None) -> str | None:
    """What tells these weights from others, by default those that come with the package; None if there are none."""
    path = path or SHIPPED
    return hashlib.sha256(path.read_bytes()).hexdigest()[:STAMP_DIGITS] if path.is_file() else None


def measure_frames(recording: LoadedRecording, path: Path | None = None) -> PerceptionResult | None:
    """The detector on the pictures of every camera, on one thread; None if the recording has no pictures.

    A picture counts for half a period to both sides, as a window of events does for half its length.

    Raises:
        ConfigError: if the weights cannot be used.
    """
    streams = {name: one for name, one in recording.file.frames.items() if len(one) > 1}
    if not streams:
        return None
    weights = load_weights(path or SHIPPED)
    score, seconds, recovery = GridScore(), [], []
    period_us = round(float(np.median(np.concatenate([np.diff(one.t_us) for one in streams.values()]))))
    with one_thread(), one_torch_thread():
        for name, frames in streams.items():
            camera = recording.cameras[name]
            detector = TimedDetector(_warm(weights, frames))
            answers = run_on_frames(frames, detector)
            score += score_on_grid(answers, camera.truth, camera.sensor, ANY_SPEED, window_us=period_us)
            seconds.append(np.array(detector.seconds)[answers.detected])
            recovery += recovery_times_ms(answers, camera.truth)
    first, count = next(iter(streams.values())), sum(len(one) for one in streams.values())
    return PerceptionResult(
        scene=recording.scene,
        seed=recording.seed,
        recording=recording.name,
        method=METHOD,
        window_us=period_us,
        windows=count,
        asked=score.asked,
        found=score.found,
        answers=score.answers,
        false=score.false,
        error_px=rounded(score.error_px),
        events=0,
        cpu_ms=rounded(1e3 * np.concatenate(seconds)),
        recovery_ms=tuple(recovery),
        bound_px=(),
        pixel_bound_px=(),
        point_mm=(),
        points_without_ball=0,
        hits=0,
        hit_mm=(),
        shown=None,
        frame_bytes=count * first.image(0).nbytes,
        exposure_us=int(first.exposure_us[0]),
        sharp_recall=None if weights.score is None else weights.score.recall,
    )


def _warm(weights: YoloWeights, frames: FrameStream) -> YoloDetector:
    """A detector that has seen some pictures: what it loads and allocates first is no part of a step."""
    detector = YoloDetector(weights)
    for _, window in zip(range(WARM_UP), frame_windows(frames), strict=False):
        detector.step(window)
    return detector
