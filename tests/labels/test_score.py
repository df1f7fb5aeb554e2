from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from core.detection import Detection
from core.events import Events, SensorSize, Window
from core.metrics.at_times import LEAD_IN_WINDOWS, answers_at
from labels.agreement import measure_agreement
from labels.arrays import LabelArrays, label_arrays
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.score import motion_of, pooled, score_groups, score_labels

SENSOR = SensorSize(1280, 720)
STREAM = SimpleNamespace(slice=lambda start, end: Events.empty(SENSOR), sensor=SENSOR)
V_PX_PER_MS = 2.0


class KnownDetector:
    """Sees a ball that moves right with 2 px/ms, `ahead_px` too far; says so for `late_us` before its window's end."""

    def __init__(self, ahead_px: float = 0.0, late_us: int = 0, blind_us: Sequence[int] = ()) -> None:
        self.extra_circles = 0
        self.windows: list[Window] = []
        self.resets = 0
        self._ahead_px, self._late_us, self._blind = ahead_px, late_us, set(blind_us)

    def reset(self) -> None:
        self.resets += 1

    def step(self, window: Window) -> Detection | None:
        self.windows.append(window)
        t_us = window.end_us - self._late_us
        if t_us in self._blind:
            return None
        return Detection(t_us, t_us * 1e-3 * V_PX_PER_MS + self._ahead_px, 100.0, 5.0)


def ball(t_us: int, source: PositionSource = PositionSource.BY_HAND, dy: float = 0.0) -> Label:
    return Label(
        t_us=t_us,
        state=LabelState.VISIBLE,
        x_px=t_us * 1e-3 * V_PX_PER_MS,
        y_px=100.0 + dy,
        provenance=Provenance(source=source),
    )


def score(detector: KnownDetector, labels: LabelArrays):
    return score_labels(STREAM, detector, labels, 2000)  # type: ignore[arg-type]


def test_a_perfect_detector_has_perfect_scores() -> None:
    (everything, by_hand) = score(KnownDetector(), label_arrays(ball(t) for t in range(10_000, 60_000, 3300)))
    assert everything.group == "all" and by_hand.group == "by hand"
    assert [(at.precision, at.recall, at.f1) for at in everything.at] == [(1.0, 1.0, 1.0)] * 4
    assert everything.median_px == pytest.approx(0, abs=1e-9)


def test_an_error_along_the_motion_counts_as_such_and_from_its_tolerance_on() -> None:
    everything = score(KnownDetector(ahead_px=3.0), label_arrays(ball(t) for t in range(10_000, 60_000, 2000)))[0]
    assert [at.recall for at in everything.at] == [0.0, 0.0, 1.0, 1.0]
    assert everything.median_px == pytest.approx(3.0)
    assert everything.along_px == pytest.approx(3.0)
    assert everything.across_px == pytest.approx(0.0)


def test_an_error_to_the_right_of_the_motion_is_positive_across() -> None:
    labels = label_arrays(ball(t, dy=-1.5) for t in range(10_000, 60_000, 2000))
    assert score(KnownDetector(), labels)[0].across_px == pytest.approx(1.5)


def test_misses_and_false_balls_are_counted_by_hand() -> None:
    labels = label_arrays(
        [
            *(ball(t) for t in (10_000, 12_000, 14_000, 16_000)),
            Label(t_us=18_000, state=LabelState.NO_BALL),
            Label(t_us=20_000, state=LabelState.OUT_OF_FRAME),
            Label(t_us=22_000, state=LabelState.OCCLUDED, x_px=44.0, y_px=100.0),
        ]
    )
    everything = score(KnownDetector(blind_us=[12_000, 20_000]), labels)[0]
    at = everything.at[-1]
    assert (everything.labels, everything.with_ball) == (6, 4)  # the occluded one is asked of nobody
    assert (at.precision, at.recall) == (3 / 4, 3 / 4)
    assert at.f1 == pytest.approx(0.75)


def test_unchecked_times_are_never_negatives() -> None:
    detector = KnownDetector()
    everything = score(detector, label_arrays([ball(10_000), ball(30_000)]))[0]
    assert len(detector.windows) > 2
    assert everything.at[0].precision == 1.0


def test_sources_are_scored_apart() -> None:
    labels = label_arrays(
        [*(ball(t, PositionSource.SNAPPED, dy=2.5) for t in (10_000, 14_000)), ball(12_000, PositionSource.ACCEPTED)]
    )
    by_name = {row.group: row for row in score(KnownDetector(), labels)}
    assert set(by_name) == {"all", "by hand", "accepted"}
    assert by_name["by hand"].median_px == pytest.approx(2.5)
    assert by_name["accepted"].median_px == pytest.approx(0.0)


def test_a_detector_that_answers_for_an_earlier_instant_is_asked_later() -> None:
    labels = label_arrays(ball(t) for t in range(30_000, 60_000, 2000))
    everything = score(KnownDetector(late_us=200), labels)[0]
    assert everything.p95_px < 0.41  # only the first answer, from which the lateness is learned, is 0.4 px behind


def test_windows_end_at_the_labels_and_lead_in_before_one_that_stands_alone() -> None:
    detector = KnownDetector()
    times = np.array([100_000, 104_500, 400_000])
    answers_at(STREAM, detector, times, 2000)  # type: ignore[arg-type]
    ends = [window.end_us for window in detector.windows]
    assert set(times.tolist()) <= set(ends)
    assert ends == sorted(ends)
    assert ends.index(100_000) == LEAD_IN_WINDOWS
    assert ends.index(400_000) - ends.index(104_500) == LEAD_IN_WINDOWS + 1
    assert detector.resets == 3
    first = KnownDetector()
    answers_at(STREAM, first, np.array([0, 1000]), 2000)  # type: ignore[arg-type]
    assert all(window.start_us >= 0 for window in first.windows)


def test_the_progress_is_the_share_of_the_labels() -> None:
    shares: list[float] = []
    times = np.array([10_000, 12_000, 90_000, 92_000])
    answers_at(STREAM, KnownDetector(), times, 2000, progress=shares.append)  # type: ignore[arg-type]
    assert shares == [0.25, 0.5, 0.75, 1.0]


def test_motion_is_known_only_beside_near_neighbours() -> None:
    labels = label_arrays([ball(0), ball(10_000), ball(500_000)])
    np.testing.assert_allclose(motion_of(labels), [(1, 0), (1, 0), (np.nan, np.nan)])


def test_nothing_labelled_is_no_score() -> None:
    assert score(KnownDetector(), label_arrays([])) == ()


def test_agreement_of_two_annotators_by_hand() -> None:
    first = label_arrays(
        [*(ball(t) for t in range(0, 20_000, 2000)), Label(t_us=20_000, state=LabelState.NO_BALL), ball(99_000)]
    )
    second = label_arrays(
        [
            *(ball(t, dy=1.0) for t in range(0, 18_000, 2000)),
            Label(t_us=18_000, state=LabelState.NO_BALL),
            Label(t_us=20_000, state=LabelState.NO_BALL),
        ]
    )
    found = measure_agreement(first, second)
    assert (found.common, found.only_first, found.only_second, found.same_state, found.both_seen) == (11, 1, 0, 10, 9)
    chance = (10 * 9 + 1 * 2) / 11**2
    assert found.kappa == pytest.approx((10 / 11 - chance) / (1 - chance))
    assert (found.median_px, found.bias_x_px, found.bias_y_px) == (1.0, 0.0, 1.0)
    assert found.median_low_px == found.median_high_px == 1.0


def test_the_noise_of_one_annotator_comes_out_of_two_looks() -> None:
    rng = np.random.default_rng(0)
    times = range(0, 2_000_000, 2000)

    def look() -> LabelArrays:
        noise = rng.normal(0, 0.5, (len(times), 2))
        return label_arrays(
            Label(t_us=t, state=LabelState.VISIBLE, x_px=100 + float(dx), y_px=50 + float(dy))
            for t, (dx, dy) in zip(times, noise, strict=True)
        )

    found = measure_agreement(look(), look())
    assert found.sigma_px == pytest.approx(0.5, abs=0.05)
    low, high = found.median_px - found.median_low_px, found.median_high_px - found.median_px
    assert low > 0 and low == pytest.approx(high, rel=0.3), "of so many distances it is even on both sides"
    assert np.isnan(found.kappa)  # both only ever say the same one thing
    assert measure_agreement(label_arrays([]), look()).common == 0


def test_recordings_are_scored_together_as_if_one_came_after_the_other() -> None:
    ahead, behind = label_arrays(ball(t) for t in range(10_000, 60_000, 4000)), label_arrays([ball(5000), ball(9000)])
    parts = [
        (answers_at(STREAM, KnownDetector(ahead_px=by), labels.t_us, 2000), labels)  # type: ignore[arg-type]
        for by, labels in ((+1.5, ahead), (0.0, label_arrays(())), (-0.5, behind))
    ]
    answers, labels = pooled(parts)
    assert len(labels) == len(ahead) + 2 and (np.diff(labels.t_us) > 0).all() and (answers.t_us == labels.t_us).all()
    (everything, _) = score_groups(answers, labels)
    assert everything.labels == 15 and [at.recall for at in everything.at] == [pytest.approx(2 / 15), 1.0, 1.0, 1.0]
    assert everything.along_px == pytest.approx((13 * 1.5 - 2 * 0.5) / 15)
    assert np.isfinite(motion_of(labels)).all(), "each has a neighbour of its own recording"
    alone = pooled([parts[0], (parts[2][0].rows(np.array([0])), behind.rows(slice(0, 1)))])[1]
    assert np.isnan(motion_of(alone)[-1]).all(), "another recording's label tells nothing of its motion"


def test_recordings_without_a_label_that_can_be_asked_for_have_no_scores() -> None:
    nothing = (answers_at(STREAM, KnownDetector(), np.empty(0, np.int64), 2000), label_arrays(()))  # type: ignore[arg-type]
    assert score_groups(*pooled([nothing, nothing])) == ()
