"""Thresholds against labels, on a simulated serve whose truth stands for a person."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.config import replace_setting
from core.detection import DetectorConfig, make_detector
from core.errors import RecordingError
from core.recordings import CameraStream, Recording, open_recording
from core.tuning.objective import TuningStoppedError, figures_of
from labels.arrays import LabelArrays, label_arrays
from labels.model import Label, LabelState
from labels.score import score_labels
from labels.tuning_objective import LabelObjective, label_objective

EVERY_US = 4000


@pytest.fixture(scope="module")
def recording(serve_recording: Path) -> Iterator[Recording]:
    with open_recording(serve_recording) as recording:
        yield recording


def labels_of(stream: CameraStream, *, every_us: int = EVERY_US) -> LabelArrays:
    """What a person who makes no mistakes would say."""
    assert stream.truth is not None
    at = stream.truth.at(np.arange(20_000, 590_000, every_us))
    labels = []
    for t, u, v, seen in zip(at.t_us.tolist(), at.u_px.tolist(), at.v_px.tolist(), at.visible, strict=True):
        if seen:
            labels.append(Label(t_us=t, state=LabelState.VISIBLE, x_px=u, y_px=v))
        else:
            labels.append(Label(t_us=t, state=LabelState.NO_BALL))
    return label_arrays(labels)


def objective(recording: Recording, path: Path, *cameras: str) -> LabelObjective:
    return label_objective(path, "auto", {name: labels_of(recording.cameras[name]) for name in cameras})


def test_a_worse_detector_scores_worse(recording: Recording, serve_recording: Path) -> None:
    against = objective(recording, serve_recording, "left")
    strict = replace_setting(DetectorConfig(), ("geometry", "circularity_min"), 0.9)
    good, bad = (figures_of(against.score(recording, one, lambda: False).tuned) for one in (DetectorConfig(), strict))
    assert good.objective > bad.objective + 0.1 and good.precision > 0.9


def test_both_sides_together_are_the_score_of_the_labels(recording: Recording, serve_recording: Path) -> None:
    labels, stream = labels_of(recording.cameras["left"]), recording.cameras["left"]
    against = label_objective(serve_recording, "auto", {"left": labels})
    against = replace(against, blocks=replace(against.blocks, gaps_us=0 * against.blocks.gaps_us))
    both = against.score(recording, DetectorConfig(), lambda: False)
    counts = both.tuned + both.held_out
    (whole, *_) = score_labels(stream, make_detector("auto", stream.sensor), labels, 2000)
    assert both.tuned.asked > 20 and both.held_out.asked > 20 and counts.asked == whole.with_ball
    at = whole.at[-1]
    assert (counts.precision, counts.recall) == pytest.approx((at.precision, at.recall))
    assert counts.error_at(50) == pytest.approx(whole.median_px)


def test_cameras_add_up(recording: Recording, serve_recording: Path) -> None:
    one, both = (objective(recording, serve_recording, *names) for names in (("left",), ("left", "right")))
    first, sum_of = (of.score(recording, DetectorConfig(), lambda: False).tuned for of in (one, both))
    assert sum_of.asked > 1.5 * first.asked


def test_occluded_balls_count_neither_for_nor_against_it(recording: Recording, serve_recording: Path) -> None:
    some = [Label(t_us=t, state=LabelState.OCCLUDED) for t in range(21_000, 590_000, EVERY_US)]
    plain = labels_of(recording.cameras["left"])
    mixed = plain
    for label in some:
        mixed = mixed.changed(label.t_us, label)
    objectives = [label_objective(serve_recording, "auto", {"left": one}) for one in (plain, mixed)]
    figures = [figures_of(one.score(recording, DetectorConfig(), lambda: False).tuned) for one in objectives]
    assert len(mixed) > len(plain) and figures[0] == figures[1]


def test_it_stops_when_nobody_wants_the_answer(recording: Recording, serve_recording: Path) -> None:
    with pytest.raises(TuningStoppedError):
        objective(recording, serve_recording, "left").score(recording, DetectorConfig(), lambda: True)


def test_too_few_labels_are_refused(recording: Recording, serve_recording: Path) -> None:
    few = labels_of(recording.cameras["left"], every_us=200_000)
    with pytest.raises(RecordingError, match="too few ball positions"):
        label_objective(serve_recording, "auto", {"left": few})
