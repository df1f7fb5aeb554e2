"""How good a detector is, measured on labels: at the instants a person has looked at, and by how the labels came about.

Unchecked times and occluded balls count neither for nor against it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.detection import Detector
from core.metrics import WindowAnswers, score_answers
from core.metrics.at_times import answers_at
from core.metrics.run import TimedDetector
from core.metrics.score import statistic_of
from core.metrics.streaming import after_delay
from core.recordings import CameraStream, PixelTruth
from labels.arrays import SOURCES, STATES, LabelArrays, label_arrays
from labels.model import LabelState, PositionSource

Array = NDArray[np.float64]
Rows = TypeVar("Rows", WindowAnswers, LabelArrays)
TOLERANCES_PX: Final = (1.0, 2.0, 4.0, 8.0)
MOTION_GAP_US: Final = 50_000
"""Labels farther apart do not tell the direction of motion."""
SEAM_US: Final = 1_000_000
"""Between two recordings whose labels are scored together."""
GROUPS: Final[dict[str, tuple[PositionSource, ...]]] = {
    "all": tuple(PositionSource),
    "by hand": (PositionSource.BY_HAND, PositionSource.SNAPPED, PositionSource.EPIPOLAR),
    "corrected": (PositionSource.CORRECTED,),
    "accepted": (PositionSource.ACCEPTED,),
    "interpolated": (PositionSource.INTERPOLATED,),
    "imported": (PositionSource.IMPORTED,),
    "settled": (PositionSource.SETTLED,),
}
"""Accepted proposals favour the detector that made them: read the rows by hand first."""


@dataclass(frozen=True, slots=True)
class ScoreAt:
    """At one tolerance: an answer this close to a visible ball is right."""

    tolerance_px: float
    precision: float
    recall: float
    f1: float


@dataclass(frozen=True, slots=True)
class GroupScore:
    """Scores at the labels of one kind of source. Errors are those of answers within the largest tolerance."""

    group: str
    labels: int
    with_ball: int
    at: tuple[ScoreAt, ...]
    median_px: float
    mean_px: float
    p95_px: float
    along_px: float
    """Mean error along the ball's motion, positive ahead of it: the detector's delay times the speed."""
    across_px: float
    """Mean error to the right of the motion, as seen in the picture."""


@dataclass(frozen=True, slots=True, eq=False)
class InTime:
    """The newest answers that have arrived by the times of labels, as `core.metrics.streaming` has them."""

    delay_us: int
    """From the moment that an answer is about to its arrival."""
    held: WindowAnswers
    moved: WindowAnswers


def answers_in_time(
    stream: CameraStream,
    detector: TimedDetector,
    answers: WindowAnswers,
    window_us: int,
    added_us: int,
    *,
    progress: Callable[[float], None] | None = None,
) -> InTime:
    """What a robot would have at the labels' times: answers about balls one delay earlier, held or moved on.

    The delay is what a detector that is always asked in time has: the rest of the window after the moment that the
    answer is about, the median time of computing, and what is added.

    Args:
        stream: the camera.
        detector: the one that gave the answers, with the times that its steps took.
        answers: what `answers_at` gave for the labels' own times.
        window_us: length of its windows.
        added_us: what every answer takes besides.
        progress: is given the share that is done.
    """
    # The median: a single slow step (compilation, another process) is not the delay.
    rest_us = int(np.median((answers.end_us - answers.t_us)[answers.detected])) if answers.detected.any() else 0
    delay_us = rest_us + round(1e6 * float(np.median(detector.seconds or [0.0]))) + added_us
    earlier = answers_at(stream, detector, answers.t_us - delay_us, window_us, progress=progress)
    moved = after_delay(earlier, answers.t_us, moved=True)
    return InTime(delay_us, after_delay(earlier, answers.t_us, moved=False), moved)


def score_labels(
    stream: CameraStream,
    detector: Detector,
    labels: LabelArrays,
    window_us: int,
    *,
    progress: Callable[[float], None] | None = None,
) -> tuple[GroupScore, ...]:
    """Run a detector at every label and score it, all labels first and then each group that has any.

    Args:
        stream: the camera.
        detector: is reset first.
        labels: with their groups.
        window_us: length of the detector's windows.
        progress: gets the share that is done.
    """
    asked = labels.rows(labels.state != STATES.index(LabelState.OCCLUDED))
    return score_groups(answers_at(stream, detector, asked.t_us, window_us, progress=progress), asked)


def score_groups(answers: WindowAnswers, labels: LabelArrays) -> tuple[GroupScore, ...]:
    """Score the answers to the labels, row by row."""
    motion = motion_of(labels)
    scores = []
    for name, sources in GROUPS.items():
        rows = np.flatnonzero(np.isin(labels.source, [SOURCES.index(source) for source in sources]))
        if len(rows):
            scores.append(_score_group(name, answers.rows(rows), labels.rows(rows), motion[rows]))
    return tuple(scores)


def pooled(parts: Sequence[tuple[WindowAnswers, LabelArrays]]) -> tuple[WindowAnswers, LabelArrays]:
    """Answers and labels of several recordings, as if one came after the other: later ones are moved on in time.

    The gap between two is longer than motion is told across.
    """
    moved_answers, moved_labels, end_us = [], [], 0
    for answers, labels in parts:
        if not len(labels):
            continue
        by_us = end_us - int(labels.t_us[0])
        moved_answers.append(replace(answers, end_us=answers.end_us + by_us, t_us=answers.t_us + by_us))
        moved_labels.append(replace(labels, t_us=labels.t_us + by_us))
        end_us = int(moved_labels[-1].t_us[-1]) + SEAM_US
    if not moved_labels:
        return parts[0]
    return _joined(WindowAnswers, moved_answers), _joined(LabelArrays, moved_labels)


def joined_in_time(parts: Sequence[LabelArrays], moved_us: Sequence[int]) -> LabelArrays:
    """Labels of several cameras or recordings, each moved on by its time: the caller sees to it that they ascend."""
    moved = [replace(labels, t_us=labels.t_us + by_us) for labels, by_us in zip(parts, moved_us, strict=True)]
    return _joined(LabelArrays, moved) if moved else label_arrays([])


def _joined(kind: type[Rows], parts: Sequence[Rows]) -> Rows:
    """One after the other; the answers' own detections are not kept."""
    names = [field.name for field in fields(kind) if field.name != "detections"]
    values: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return kind(**values)


def _score_group(name: str, answers: WindowAnswers, labels: LabelArrays, motion: Array) -> GroupScore:
    seen = labels.seen
    truth = PixelTruth(labels.t_us, labels.x_px, labels.y_px, labels.r_px, seen)
    at = []
    for tolerance in TOLERANCES_PX:
        score = score_answers(answers, truth, match_radius_px=tolerance)
        at.append(ScoreAt(tolerance, score.precision, score.recall, score.f1))
    error = np.column_stack([answers.u_px - labels.x_px, answers.v_px - labels.y_px])
    distance = np.linalg.norm(error, axis=1)
    found = seen & (np.nan_to_num(distance, nan=np.inf) <= TOLERANCES_PX[-1])
    moving = found & np.isfinite(motion[:, 0])
    along = np.einsum("ij,ij->i", error, motion)[moving]
    across = (motion[:, 0] * error[:, 1] - motion[:, 1] * error[:, 0])[moving]
    return GroupScore(
        group=name,
        labels=len(labels),
        with_ball=int(seen.sum()),
        at=tuple(at),
        median_px=statistic_of(distance[found], np.median),
        mean_px=statistic_of(distance[found], np.mean),
        p95_px=statistic_of(distance[found], lambda values: np.percentile(values, 95)),
        along_px=statistic_of(along, np.mean),
        across_px=statistic_of(across, np.mean),
    )


def motion_of(labels: LabelArrays) -> Array:
    """(N, 2) unit direction of the ball's motion at each label, from the visible labels round it; nan where unknown."""
    motion = np.full((len(labels), 2), np.nan)
    rows = np.flatnonzero(labels.seen)
    if len(rows) < 2:
        return motion
    t, places = labels.t_us[rows], np.column_stack([labels.x_px, labels.y_px])[rows]
    before, after = np.maximum(np.arange(len(rows)) - 1, 0), np.minimum(np.arange(len(rows)) + 1, len(rows) - 1)
    before = np.where(t - t[before] <= MOTION_GAP_US, before, np.arange(len(rows)))
    after = np.where(t[after] - t <= MOTION_GAP_US, after, np.arange(len(rows)))
    step = places[after] - places[before]
    length = np.linalg.norm(step, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        motion[rows] = np.where(length[:, None] > 1.0, step / length[:, None], np.nan)
    return motion
