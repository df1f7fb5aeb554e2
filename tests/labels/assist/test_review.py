from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.labels.assistance import MIDDLE_US, SENSOR, draw_clip, try_queue
from core.cameras import Camera
from core.detection import refined_config
from core.events import Events
from labels.arrays import LabelArrays, label_arrays
from labels.assist.blind import is_blind_sample, next_blind
from labels.assist.propose import (
    Proposals,
    accept,
    detector_name,
    joined_proposals,
    propose,
    residual_of_neighbours,
    steady_segment,
)
from labels.assist.review import QueueConfig, review_queue
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore, Layer

pytestmark = pytest.mark.numeric
T = np.arange(0, 60_000, 2000)


def straight_at(t_us: int) -> Label:
    return Label(t_us=t_us, state=LabelState.VISIBLE, x_px=100 + t_us * 2e-3, y_px=50.0)


def straight(**changes: Label) -> LabelArrays:
    labels = {t_us: straight_at(t_us) for t_us in T.tolist()}
    labels.update({label.t_us: label for label in changes.values()})
    return label_arrays(labels.values())


def detections(rows: np.ndarray = T) -> Proposals:
    covariance = np.tile([0.01, 0.0, 0.01], (len(rows), 1))
    return Proposals(rows, 100 + rows * 2e-3, np.full(len(rows), 50.0), np.full(len(rows), 6.0), covariance, 2000, "d")


def test_good_labels_are_not_queued() -> None:
    assert review_queue(straight(), proposals=detections(), frames_us=T) == ()
    assert review_queue(label_arrays([])) == ()


def test_a_label_off_the_path_comes_first_and_says_why() -> None:
    off = Label(t_us=20_000, state=LabelState.VISIBLE, x_px=140.0, y_px=62.0)
    queue = review_queue(straight(off=off))
    assert queue[0].t_us == 20_000
    assert queue[0].reason == "Label is 12.0 px off the neighbours' path"
    assert queue[0].score == pytest.approx(12 / QueueConfig().sigma_px, rel=0.01)


def test_a_ball_that_is_missing_once_or_there_once_is_queued() -> None:
    missing = Label(t_us=20_000, state=LabelState.NO_BALL)
    assert "no ball at this time only" in review_queue(straight(missing=missing))[0].reason
    absent = [Label(t_us=int(t), state=LabelState.NO_BALL) for t in T if t != 20_000]
    lonely = label_arrays([*absent, Label(t_us=20_000, state=LabelState.VISIBLE, x_px=1.0, y_px=1.0)])
    assert [(item.t_us, item.reason) for item in review_queue(lonely)] == [(20_000, "a ball at this time only")]


def test_the_detector_speaks_against_labels() -> None:
    nowhere = straight(**{f"l{t}": Label(t_us=t, state=LabelState.NO_BALL) for t in (20_000, 22_000, 24_000)})
    reasons = {item.t_us: item.reason for item in review_queue(nowhere, proposals=detections())}
    assert all("detector sees a ball" in reasons[t] for t in (20_000, 22_000, 24_000))
    silent = review_queue(straight(), proposals=detections(T[:20]))
    assert {item.t_us for item in silent} == set(T[20:].tolist())
    assert "finds no ball" in silent[0].reason


def test_the_other_camera_speaks_against_labels() -> None:
    residual = np.full(len(T), 0.3)
    residual[7] = 9.0
    residual[8] = np.nan
    queue = review_queue(straight(), stereo_residual_px=residual)
    assert [item.t_us for item in queue] == [14_000]
    assert queue[0].reason == "the cameras disagree by 9.0 px"


def test_a_label_of_a_wrong_size_comes_before_worse_proposals_and_says_why() -> None:
    radii = {int(t): 8.5 for t in T} | {14_000: 12.2, 20_000: 3.2, 30_000: 12.2}
    labels = label_arrays(
        [dataclasses.replace(straight_at(t), r_px=r_px) for t, r_px in radii.items()],
    )
    expected, residual = np.full(len(T), 8.5), np.full(len(T), 0.3)
    expected[10] = 2.1  # of a small ball 1.1 px: 1.6 standard deviations
    residual[15] = 9.0  # the depth, and so the radius, is of no ball
    proposed = detections(T + 1000)  # between the labels
    y_px = proposed.y_px.copy()
    y_px[3] += 60.0
    proposals = dataclasses.replace(proposed, y_px=y_px)
    queue = review_queue(labels, proposals=proposals, stereo_residual_px=residual, expected_r_px=expected)
    assert [(item.t_us, item.reason) for item in queue[:3]] == [
        (30_000, "the cameras disagree by 9.0 px"),
        (14_000, "radius 12.2 px, the cameras expect 8.5 px"),
        (20_000, "radius 3.2 px, the cameras expect 2.1 px"),
    ]


def test_a_stored_label_that_the_other_camera_contradicts_comes_before_worse_proposals() -> None:
    residual = np.full(len(T), 0.3)
    residual[7] = 8.4
    rows = T + 1000  # between the labels
    proposed = detections(rows)
    y_px = proposed.y_px.copy()
    y_px[3] += 60.0
    queue = review_queue(straight(), proposals=dataclasses.replace(proposed, y_px=y_px), stereo_residual_px=residual)
    assert queue[0].t_us == 14_000
    assert queue[1].score > queue[0].score, "by its score alone the proposal came first"


def test_a_bounce_is_no_mistake_of_labels_or_proposals_and_a_mistake_beside_it_is() -> None:
    """The ball falls at 4 px/ms, is back up at 3 px/ms, and each window has noise of 0.2 px."""
    noise = np.random.default_rng(3).normal(0.0, 0.2, (2, len(T)))
    y = np.where(T < 29_000, 300 + 4e-3 * (T - 29_000), 300 - 3e-3 * (T - 29_000))
    x = 100 + T * 2e-3
    proposed = dataclasses.replace(detections(), x_px=x + noise[0], y_px=y + noise[1])
    assert np.nanmax(residual_of_neighbours(T, x, y, max_gap_us=20_000)) > 3.0, "the neighbours' path has a corner"
    assert review_queue(label_arrays([]), proposals=proposed) == ()
    places = list(zip(T.tolist(), proposed.x_px.tolist(), proposed.y_px.tolist(), strict=True))
    labels = [Label(t_us=t, state=LabelState.VISIBLE, x_px=u, y_px=v) for t, u, v in places]
    assert review_queue(label_arrays(labels)) == ()
    row = 14  # the last before the bounce
    labels[row] = Label(t_us=int(T[row]), state=LabelState.VISIBLE, x_px=float(x[row]) + 14.0, y_px=float(y[row]))
    assert [item.t_us for item in review_queue(label_arrays(labels))][:1] == [int(T[row])]


def test_holes_between_labels_are_queued() -> None:
    labels = straight()
    labels = labels.rows(labels.t_us != 30_000)
    assert [(item.t_us, item.reason) for item in review_queue(labels, frames_us=T)] == [
        (30_000, "nobody has looked here")
    ]


@pytest.mark.parametrize("with_detector", [True, False])
def test_the_first_tenth_of_the_queue_holds_injected_errors(with_detector: bool) -> None:
    trial = try_queue(3, np.random.default_rng(4), with_detector=with_detector)
    assert trial.injected > 20
    assert trial.in_first_tenth >= 0.9


def test_what_nobody_has_judged_comes_in_the_order_in_which_it_would_change_a_score() -> None:
    t_us = np.arange(0, 120_000, 2000)
    x, y = 100.0 + t_us / 1000, 200.0 + (t_us / 1000 - 60) ** 2 / 100
    x[20] += 12.0  # a wrong one: a false ball and a miss
    kept = np.arange(len(t_us)) != 40  # a hole: a miss
    proposals = Proposals(
        t_us[kept], x[kept], y[kept], np.full(kept.sum(), 8.0), np.zeros((kept.sum(), 3)), 2000, "made up"
    )
    queue = review_queue(label_arrays(()), proposals=proposals)
    assert [item.t_us for item in queue] == [int(t_us[20]), int(t_us[40])]
    assert "Proposal is 12" in queue[0].reason and "lost the ball" in queue[1].reason
    judged = review_queue(label_arrays(()), proposals=proposals, rejected_us=[int(t_us[20])])
    assert int(t_us[20]) not in [item.t_us for item in judged if "Proposal" in item.reason]


def test_residuals_hold_beside_a_wrong_neighbour() -> None:
    y = 0.001 * (T * 1e-3) ** 2
    x = T * 2e-3
    x[10] += 25.0
    residual = residual_of_neighbours(T, x, y, max_gap_us=20_000)
    assert residual[10] == pytest.approx(25.0, abs=0.1)
    others = np.delete(residual, 10)
    assert np.nanmax(others) < 0.5
    assert np.isnan(residual_of_neighbours(T[:2], x[:2], y[:2], max_gap_us=20_000)).all()
    assert residual_of_neighbours(T[:0], x[:0], y[:0], max_gap_us=1).shape == (0,)


def test_proposals_are_interpolated_only_between_neighbouring_windows() -> None:
    found = detections(np.array([0, 2000, 20_000])).at([1000, 2000, 10_000, 30_000])
    np.testing.assert_allclose(found.x_px, (102.0, 104.0, np.nan, np.nan))
    assert np.isnan(detections(T[:0]).at([5]).x_px).all()


def test_proposals_between_two_times_hold_the_first_and_not_the_last() -> None:
    every = detections(np.arange(0, 20_000, 2000))
    for start, end, expected in (
        (4000, 8000, [4000, 6000]),
        (4001, 8001, [6000, 8000]),
        (-5, 1, [0]),
        (8000, 4000, []),
        (30_000, 40_000, []),
    ):
        part = every.between(start, end)
        assert part.t_us.tolist() == expected
        rows = np.searchsorted(every.t_us, expected)
        for column in ("x_px", "y_px", "r_px", "covariance_px2"):
            np.testing.assert_array_equal(getattr(part, column), getattr(every, column)[rows])
        assert (part.window_us, part.detector) == (every.window_us, every.detector)


def test_proposals_are_joined_by_time_and_the_newer_ones_stand() -> None:
    first, second = detections(np.array([0, 2000, 4000])), detections(np.array([1000, 2000]))
    second.x_px[:] = -1.0
    both = joined_proposals(first, second)
    assert both.t_us.tolist() == [0, 1000, 2000, 4000]
    np.testing.assert_array_equal(both.x_px, [first.x_px[0], -1.0, -1.0, first.x_px[2]])
    np.testing.assert_array_equal(both.covariance_px2[0], first.covariance_px2[0])
    assert joined_proposals(None, second) is second
    other = dataclasses.replace(second, detector="another")
    assert joined_proposals(first, other) is other
    assert joined_proposals(first, dataclasses.replace(second, window_us=500)).t_us.tolist() == [1000, 2000]


def test_an_accepted_proposal_says_so() -> None:
    label = accept(detections(), 3, time_spent_ms=120)
    assert (label.t_us, label.x_px, label.r_px) == (6000, 112.0, 6.0)
    assert label.provenance == Provenance(
        source=PositionSource.ACCEPTED, detector="d", window_us=(4000, 6000), time_spent_ms=120
    )
    assert label.covariance_px2 == (0.01, 0.0, 0.01)


def test_a_segment_ends_where_residuals_or_windows_or_the_other_camera_do_not_agree() -> None:
    proposals = detections(np.delete(T, 25))
    proposals.x_px[20] += 9.0
    stereo = np.full(len(proposals), np.nan)
    stereo[4] = 5.0
    assert steady_segment(proposals, 20_000, stereo_residual_px=stereo).tolist() == list(range(5, 20))
    assert steady_segment(proposals, 40_000).tolist() == []
    assert steady_segment(proposals, 10**7).tolist() == []
    assert steady_segment(detections(T[:0]), 0).tolist() == []


class OneClip:
    """The slices of one clip, as a camera of a recording serves them."""

    name = "left"
    sensor = SENSOR
    calibration: Camera | None = None

    def __init__(self, events: Events) -> None:
        self._events = events

    def slice(self, start_us: int, end_us: int) -> Events:
        return self._events.between(start_us, end_us)


def test_the_detector_proposes_a_simulated_ball_to_a_fraction_of_a_pixel() -> None:
    clip = draw_clip(np.random.default_rng(3), speed_mps=5.0, radius_px=9.0)
    proposals = propose(OneClip(clip.events), MIDDLE_US - 20_000, MIDDLE_US + 20_000)  # type: ignore[arg-type]
    assert len(proposals) > 8
    name = detector_name(refined_config(), "refined")
    assert proposals.detector == name and name.startswith("refined#") and len(name) == 20
    assert not (proposals.t_us % 1000).any(), "at the ends of windows, where labels have their times"
    here = proposals.at([MIDDLE_US])
    assert np.hypot(here.x_px[0] - clip.truth.u_px[0], here.y_px[0] - clip.truth.v_px[0]) < 0.5
    assert np.isfinite(here.covariance_px2[0]).all()


def test_one_in_twenty_labels_is_asked_for_again_the_oldest_first(tmp_path: Path) -> None:
    layer = Layer("u", "left", "anna")
    chosen = [t for t in range(20_000) if is_blind_sample(layer, t)]
    assert 850 < len(chosen) < 1150
    assert chosen != [t for t in range(20_000) if is_blind_sample(Layer("u", "left", "bea"), t)]
    with (
        LabelStore.open(tmp_path, "u", "left", "anna") as first,
        LabelStore.open(tmp_path, "u", "left", "anna", blind=True) as second,
    ):
        assert next_blind(first, second) is None
        times = chosen[:3]
        for age, t in enumerate(reversed(times)):
            first.put(Label(t_us=t, state=LabelState.NO_BALL, provenance=Provenance(made_at_us=age + 1)))
        first.put(Label(t_us=next(t for t in range(99) if t not in chosen), state=LabelState.NO_BALL))
        assert next_blind(first, second) == times[2]
        assert next_blind(first, second, recent_us=[times[2]]) == times[1]
        second.put(Label(t_us=times[2], state=LabelState.NO_BALL))
        second.put(Label(t_us=times[1], state=LabelState.NO_BALL))
        assert next_blind(first, second) == times[0]
        second.put(Label(t_us=times[0], state=LabelState.NO_BALL))
        assert next_blind(first, second) is None
