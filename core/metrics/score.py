"""Precision, recall and pixel errors of a detector's answers against the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.detection import Detector, DetectorConfig, FastDetector
from core.errors import RecordingError
from core.metrics.run import WindowAnswers, run_detector
from core.recordings import CameraStream, PixelTruth


def binomial_interval(share: float, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share seen in `count` trials."""
    z = 1.96
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return max(0.0, middle - half), min(1.0, middle + half)


MATCH_RADIUS_PX = 8.0
"""A ball counts as found within this distance of the truth, about the radius of a ball in the middle of the table."""


@dataclass(frozen=True, slots=True)
class Score:
    """How good a detector is on one camera.

    Every window counts once, at the time its answer is for. With a ball in the picture then, the answer is *found*
    (within the match radius), *missed* (no answer), or both *missed* and *false* (an answer somewhere else). Without a
    ball, an answer is *false* and silence is right. Windows before the first and after the last sample of the truth are
    left out: there, nobody knows. Ratios without anything to divide by are nan.
    """

    windows: int
    """Windows that are counted."""
    windows_unknown: int
    """Windows outside the truth's time range, not counted."""
    with_ball: int
    """Windows with the ball in the picture: found + missed."""
    found: int
    missed: int
    false: int
    extra_circles: int
    """Further circles beside the answers, not counted as false except in `precision_all_circles`."""
    precision: float
    """found / (found + false)."""
    recall: float
    """found / with_ball."""
    f1: float
    precision_all_circles: float
    """found / (found + false + extra_circles)."""
    mean_error_px: float
    """Distance of the found centres from the truth at the estimate's own time."""
    median_error_px: float
    p95_error_px: float


@dataclass(frozen=True, slots=True, eq=False)
class WindowVerdicts:
    """Verdicts of N answers at their times. An answer away from the ball counts as missed and false."""

    t_us: NDArray[np.int64]
    known: NDArray[np.bool_]
    """Whether the truth covers the time."""
    with_ball: NDArray[np.bool_]
    found: NDArray[np.bool_]
    false: NDArray[np.bool_]
    error_px: NDArray[np.float64]
    """Error, px; nan without an answer or a ball."""

    @property
    def missed(self) -> NDArray[np.bool_]:
        """(N,) whether there was a ball that was not found."""
        return self.with_ball & ~self.found


def judge_answers(
    answers: WindowAnswers, truth: PixelTruth, *, match_radius_px: float = MATCH_RADIUS_PX
) -> WindowVerdicts:
    """Compare each answer with the truth."""
    known = np.zeros(len(answers.t_us), np.bool_)
    if len(truth.t_us):
        known = (truth.t_us[0] <= answers.t_us) & (answers.t_us <= truth.t_us[-1])
    there = truth.at(answers.t_us)
    with_ball = known & there.visible
    error_px = np.hypot(answers.u_px - there.u_px, answers.v_px - there.v_px)
    found = with_ball & answers.detected & (np.nan_to_num(error_px, nan=np.inf) <= match_radius_px)
    return WindowVerdicts(answers.t_us, known, with_ball, found, known & answers.detected & ~found, error_px)


def score_answers(answers: WindowAnswers, truth: PixelTruth, *, match_radius_px: float = MATCH_RADIUS_PX) -> Score:
    """Compare answers with the truth."""
    judged = judge_answers(answers, truth, match_radius_px=match_radius_px)
    known, found, error_px = judged.known, judged.found, judged.error_px
    false = int(judged.false.sum())
    extra = int(answers.extra_circles[known].sum())
    hits, balls = int(found.sum()), int(judged.with_ball.sum())
    precision, recall = _ratio(hits, hits + false), _ratio(hits, balls)
    return Score(
        windows=int(known.sum()),
        windows_unknown=int((~known).sum()),
        with_ball=balls,
        found=hits,
        missed=balls - hits,
        false=false,
        extra_circles=extra,
        precision=precision,
        recall=recall,
        f1=_ratio(2 * hits, 2 * hits + false + balls - hits),
        precision_all_circles=_ratio(hits, hits + false + extra),
        mean_error_px=statistic_of(error_px[found], np.mean),
        median_error_px=statistic_of(error_px[found], np.median),
        p95_error_px=statistic_of(error_px[found], lambda errors: np.percentile(errors, 95)),
    )


def score_recording(
    stream: CameraStream,
    detector: Detector | DetectorConfig,
    *,
    window_us: int | None = None,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Score:
    """Score a detector, or the fast detector of a config, on a whole camera; on the part so far when cancelled.

    `window_us` defaults to the config's, and must be given with a detector.

    Raises:
        RecordingError: if the recording has no ground truth for the camera.
    """
    if isinstance(detector, DetectorConfig):
        window_us = window_us or detector.window.window_us
        detector = FastDetector(detector, stream.sensor)
    assert window_us is not None, "a detector does not know its windows"
    truth = known_truth(stream)
    return score_answers(run_detector(stream, detector, window_us, progress=progress, cancelled=cancelled), truth)


def known_truth(stream: CameraStream) -> PixelTruth:
    """Truth of a camera.

    Raises:
        RecordingError: if the recording has none for it.
    """
    if stream.truth is None:
        remedy = "say where its balls are: in the app's mode Label, or with `rallyscope labels import`"
        raise RecordingError("nobody knows the true balls of this camera", where=stream.name, remedy=remedy)
    return stream.truth


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")


def statistic_of(values: NDArray[np.float64], statistic: Callable[[NDArray[np.float64]], np.floating]) -> float:
    """A statistic of values (N,); nan without any, where NumPy would warn."""
    return float(statistic(values)) if len(values) else float("nan")
