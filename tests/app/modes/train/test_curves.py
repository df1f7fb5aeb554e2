"""Smoothing and thinning of learning curves."""

import numpy as np
import pytest

from app.modes.train.curves import (
    FEWEST,
    MAX_POINTS,
    curves_of,
    interval_curves,
    mean_curve,
    on_axis,
    points_on_axis,
    rolling_mean,
    shared_axis,
)
from app.shared.training.metrics import COLUMNS, Metrics
from core.learning.runs.summary import spread_of

NAN = float("nan")


def test_the_band_is_students_t_over_the_seeds_that_have_come_so_far() -> None:
    rng = np.random.default_rng(1)
    curves = [rng.normal(size=length) for length in (30, 20, 30, 10)]
    curves[2][5] = NAN
    low, high = interval_curves(curves)
    for k in (0, 5, 9, 10, 19, 20, 29):
        values = [float(curve[k]) for curve in curves if k < len(curve)]
        spread = spread_of(values)
        assert (low[k], high[k]) == pytest.approx((spread.low, spread.high))
    alone = interval_curves([curves[0], curves[3]])
    assert np.isfinite(alone[0][:10]).all() and np.isnan(alone[0][10:]).all() and np.isnan(alone[1][10:]).all()


def test_a_rolling_mean_is_the_mean_of_the_last_ones_that_are_known() -> None:
    rng = np.random.default_rng(0)
    values = np.where(rng.random(60) < 0.3, np.nan, rng.random(60))
    smooth = rolling_mean(values, 10)
    for k in range(60):
        last = values[max(0, k - 9) : k + 1]
        expected = np.nanmean(last) if k + 1 >= FEWEST and np.isfinite(last).any() else NAN
        assert smooth[k] == pytest.approx(expected, nan_ok=True)
    assert len(rolling_mean(np.empty(0), 10)) == 0


@pytest.mark.parametrize("longest", [1, 7, MAX_POINTS, MAX_POINTS + 1, 12_345])
def test_an_axis_has_at_most_a_thousand_points_and_ends_with_the_last_episode(longest: int) -> None:
    axis = shared_axis(longest)
    assert len(axis) <= MAX_POINTS and axis[-1] == longest and axis[0] >= 1
    assert (np.diff(axis) > 0).all()
    assert longest > MAX_POINTS or len(axis) == longest


def test_a_shorter_curve_ends_where_it_ends() -> None:
    axis = shared_axis(5)
    assert on_axis(np.array([1.0, 2.0, 3.0]), axis) == pytest.approx([1, 2, 3, NAN, NAN], nan_ok=True)
    assert np.isnan(on_axis(np.empty(0), axis)).all()


def test_single_points_stand_at_the_nearest_place_of_the_axis() -> None:
    axis = np.array([1.0, 4.0, 7.0])
    placed = points_on_axis(np.array([3.0, 9.0]), np.array([30.0, 90.0]), axis)
    assert placed == pytest.approx([NAN, 30.0, 90.0], nan_ok=True)


def test_the_mean_over_seeds_goes_as_far_as_the_longest() -> None:
    mean = mean_curve([np.array([1.0, 3.0, NAN, 7.0]), np.array([3.0, NAN])])
    assert mean == pytest.approx([2.0, 3.0, NAN, 7.0], nan_ok=True)


def test_returned_counts_case_four_in_per_cent() -> None:
    columns = {name: np.zeros(10) for name in COLUMNS} | {"case": np.array([4.0] * 5 + [1, 2, 3, 5, 4])}
    evaluations = ({"episode": 10, "returned": 0.5, "error_mm": None},)
    curves = curves_of(Metrics(columns, np.zeros((10, 2)), np.zeros((10, 2)), evaluations, ()))
    assert curves.values["returned"][4] == 100.0 and curves.values["returned"][9] == 60.0
    assert curves.evaluated["returned"][0] == 50.0 and np.isnan(curves.evaluated["error_mm"][0])
