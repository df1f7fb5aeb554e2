"""What answers are compared with."""

import numpy as np
import pytest

from core.events import SensorSize
from core.metrics import WindowAnswers
from core.metrics.compare import labels_reference, method_reference, truth_reference
from core.recordings import PixelTruth

pytestmark = pytest.mark.numeric
NAN = float("nan")


def places(t_us: list[int], visible: list[bool] | None = None) -> PixelTruth:
    """A ball of 6 px that moves at 2 px/ms along v = 50."""
    seen = np.array(visible if visible is not None else [True] * len(t_us), np.bool_)
    t = np.array(t_us, np.int64)
    return PixelTruth(t, np.where(seen, 20 + 2e-3 * t, NAN), np.where(seen, 50.0, NAN), np.where(seen, 6.0, NAN), seen)


def test_the_truth_is_known_from_its_first_to_its_last_sample_and_asked_after_a_while_in_view() -> None:
    reference = truth_reference(places(list(range(1000, 40_000, 500))), SensorSize(400, 100))
    there, known = reference.at(np.array([999, 1000, 20_250, 39_500, 39_501]))
    assert known.tolist() == [False, True, True, True, False]
    assert there.u_px[2] == 20 + 40.5
    assert reference.asked_us[0] == 12_000 and reference.asked_us[-1] == 39_000
    assert set(np.diff(reference.asked_us)) == {1000}


def test_without_samples_nothing_is_known_and_nothing_asked() -> None:
    for reference in (truth_reference(places([]), SensorSize(400, 100)), labels_reference(places([]), "nobody")):
        assert len(reference.asked_us) == 0 and not reference.at(np.array([5]))[1].any()


def test_labels_speak_for_what_is_between_near_ones_and_beside_each() -> None:
    reference = labels_reference(places([0, 20_000, 50_000], [True, True, True]), "ann")
    there, known = reference.at(np.array([-1001, -1000, 10_000, 21_000, 21_001, 48_999, 49_000, 50_000]))
    assert known.tolist() == [False, True, True, True, False, False, True, True]
    assert there.visible.tolist() == known.tolist()
    assert there.u_px[[1, 2, 3, 6, 7]].tolist() == [20, 40, 60, 120, 120]
    assert reference.asked_us.tolist() == [0, 20_000, 50_000]


def test_a_label_without_a_ball_is_known_and_not_asked() -> None:
    reference = labels_reference(places([0, 2000, 4000], [True, False, False]), "ann")
    there, known = reference.at(np.array([0, 1000, 3000]))
    assert known.all() and there.visible.tolist() == [True, False, False]
    assert reference.asked_us.tolist() == [0]


def test_what_a_method_does_not_answer_is_no_ball_at_the_time_it_would_have_answered_for() -> None:
    ends = np.arange(1000, 7000, 1000)
    found = np.array([True, True, False, False, True, True])
    u = np.where(found, 20 + 2e-3 * (ends - 800), NAN)
    answers = WindowAnswers(ends, np.where(found, ends - 800, ends), u, u, u, np.zeros(6, np.int32))
    reference = method_reference(answers, "refined")
    assert reference.places.t_us.tolist() == [200, 1200, 2200, 3200, 4200, 5200]
    assert reference.asked_us.tolist() == [200, 1200, 4200, 5200]
    there, known = reference.at(np.array([700, 2200, 4700]))
    assert known.all() and there.visible.tolist() == [True, False, True] and there.u_px[0] == 21.4
