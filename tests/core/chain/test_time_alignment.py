"""Detections of cameras that answer at different times, read at one time."""

from dataclasses import dataclass

import numpy as np
import pytest

from core.chain.time_aligner import TimeAligner
from core.detection import Detection

pytestmark = pytest.mark.numeric


def seen(t_us: int, u_px: float) -> Detection:
    """A ball on the line v = 2 u."""
    return Detection(t_us, u_px, 2 * u_px, 6.0)


def test_a_camera_that_is_ahead_is_read_between_its_last_two_detections() -> None:
    aligner = TimeAligner(("left", "right"), 6000)
    assert aligner.add({"left": seen(1000, 10.0), "right": None}) is None
    assert aligner.add({"left": seen(3000, 20.0), "right": seen(2500, 70.0)}) is not None
    found = aligner.add({"left": seen(5000, 40.0), "right": seen(4500, 90.0)})
    assert found is not None and found[0] == 4500
    np.testing.assert_allclose(found[1], [[35.0, 70.0], [90.0, 180.0]])


def test_equal_times_are_read_as_they_are_and_each_time_is_given_once() -> None:
    aligner = TimeAligner(("left", "right"), 6000)
    found = aligner.add({"left": seen(2000, 1.0), "right": seen(2000, 2.0)})
    assert found is not None and found[0] == 2000
    np.testing.assert_array_equal(found[1], [[1.0, 2.0], [2.0, 4.0]])
    assert aligner.add({"left": None, "right": None}) is None
    assert aligner.add({"left": seen(4000, 3.0), "right": None}) is None, "the other is still at 2000"
    aligner.reset()
    again = aligner.add({"left": seen(2000, 1.0), "right": seen(2000, 2.0)})
    assert again is not None and again[0] == 2000


def test_only_the_last_two_detections_of_a_camera_are_remembered() -> None:
    """The right one falls behind; what the left one had at that time is no longer known."""
    for steps, known in ((2, True), (3, False)):
        aligner = TimeAligner(("left", "right"), 20_000)
        for number in range(1, steps + 1):
            aligner.add({"left": seen(2000 * number, 10.0 * number), "right": None})
        found = aligner.add({"left": None, "right": seen(3000, 5.0)})
        assert (found is not None) == known
        if found is not None:
            np.testing.assert_allclose(found[1], [[15.0, 30.0], [5.0, 10.0]])


@pytest.mark.parametrize(("apart_us", "read"), [(6000, True), (6001, False)])
def test_a_camera_is_not_read_across_a_longer_gap(apart_us: int, read: bool) -> None:
    aligner = TimeAligner(("left", "right"), 6000)
    aligner.add({"left": seen(1000, 0.0), "right": None})
    aligner.add({"left": seen(1000 + apart_us, 60.0), "right": None})
    found = aligner.add({"left": None, "right": seen(4000, 5.0)})
    assert (found is not None) == read


def test_a_third_camera_that_fell_behind_does_not_hold_the_others_up() -> None:
    aligner = TimeAligner(("a", "b", "c"), 6000)
    first = aligner.add({"a": seen(1000, 1.0), "b": seen(1000, 2.0), "c": seen(1000, 3.0)})
    assert first is not None and np.isfinite(first[1]).all()
    found = aligner.add({"a": seen(3000, 4.0), "b": seen(3000, 5.0), "c": None})
    assert found is not None and found[0] == 3000
    np.testing.assert_array_equal(found[1], [[4.0, 8.0], [5.0, 10.0], [np.nan, np.nan]])


def test_a_better_detection_takes_the_place_of_the_newest() -> None:
    aligner = TimeAligner(("left", "right"), 6000)
    aligner.add({"left": seen(1000, 10.0), "right": None})
    aligner.add({"left": seen(3000, 99.0), "right": None})
    aligner.replace("left", seen(3000, 20.0))
    found = aligner.add({"left": None, "right": seen(2000, 5.0)})
    assert found is not None and found[0] == 2000
    np.testing.assert_allclose(found[1], [[15.0, 30.0], [5.0, 10.0]])


@dataclass(frozen=True, slots=True)
class SureDetection(Detection):
    """One that says how sure it is."""

    sigma_px: float = 0.1

    @property
    def centre_covariance_px2(self) -> np.ndarray:
        return self.sigma_px**2 * np.eye(2)


def test_the_covariances_are_those_of_the_newest_detections_where_they_are_said() -> None:
    aligner = TimeAligner(("left", "right", "third"), 6000)
    aligner.add({"left": SureDetection(1000, 1.0, 2.0, 6.0, 0.3), "right": seen(1000, 2.0)})
    found = aligner.add({"left": SureDetection(3000, 2.0, 4.0, 6.0, 0.2), "right": seen(3000, 3.0)})
    assert found is not None
    np.testing.assert_allclose(found.covariances_px2[0], 0.04 * np.eye(2))
    assert np.isnan(found.covariances_px2[1:]).all()


def lone(aligner: TimeAligner) -> list[tuple[str, int]]:
    return [(name, found.t_us) for name, found in aligner.take_lone()]


def test_detections_without_a_partner_are_handed_out_once_when_no_other_can_meet_them() -> None:
    aligner = TimeAligner(("a", "b", "c"), 6000)
    aligner.add({"a": seen(1000, 1.0), "b": seen(1000, 2.0)})
    assert lone(aligner) == [], "both are of a common time"
    for t_us, expected in ((2000, []), (3000, []), (4000, [("a", 2000)]), (5000, [("a", 3000)])):
        aligner.add({"a": seen(t_us, 1.0)})
        assert lone(aligner) == expected, "b may be read between two of its detections, up to two back"
    aligner.add({"a": seen(7001, 1.0)})
    assert lone(aligner) == [("a", 4000), ("a", 7001)], "b is 6 ms behind"
    aligner.add({"a": seen(8000, 1.0), "b": seen(8000, 2.0), "c": seen(7500, 3.0)})
    assert lone(aligner) == [("c", 7500)], "the common time has passed it"


def test_what_was_not_of_one_ball_is_handed_out_after_all() -> None:
    aligner = TimeAligner(("a", "b", "c"), 6000)
    aligner.add({"a": seen(1000, 1.0), "b": seen(1000, 2.0)})
    aligner.put_back()
    assert lone(aligner) == [("a", 1000), ("b", 1000)] and lone(aligner) == []
