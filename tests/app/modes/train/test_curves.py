"""Smoothing and thinning of learning curves."""

import numpy as np
import pytest

from app.modes.train.curves import (
    FEWEST,
    LISTED_SEEDS,
    MAX_POINTS,
    MAX_VALUES,
    border_lines,
    curves_of,
    interval_curves,
    mean_curve,
    on_axis,
    points_on_axis,
    rolling_mean,
    seed_results,
    seed_results_html,
    shared_axis,
    stage_borders,
    stage_labels,
    stages_of,
    with_borders,
)
from app.modes.train.view import RunsViewer, ViewRequest
from app.shared.trainer import Trainer
from app.shared.training_records import COLUMNS, Metrics, MetricsStore
from app.shared.workspace import Workspace
from core.learning.runs.run_files import read_lines, seed_files
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


def line(episode: int, returned: float, error_mm: float | None, speed_mps: float = 5.0) -> dict[str, object]:
    return {"episode": episode, "speed_mps": speed_mps, "returned": returned, "error_mm": error_mm}


def test_a_finished_run_tells_the_mean_of_its_seeds_with_the_interval(trained: Workspace) -> None:
    details = RunsViewer(trained, Trainer(trained), MetricsStore())(ViewRequest("small", None)).details
    assert details is not None and details.seed_results is not None
    results = details.seed_results
    ends = [read_lines(seed_files(trained.run_path("small"), seed).evaluations)[0][-1] for seed in (0, 1)]
    errors = [float(str(end["error_mm"])) for end in ends]
    assert [one.error_mm for one in results.seeds] == errors and results.counted == 2
    assert results.error_mm.mean == pytest.approx(np.mean(errors))
    half = 12.7062 * abs(errors[0] - errors[1]) / 2  # t of one degree of freedom, times the standard error of two
    assert results.error_mm.high - results.error_mm.mean == pytest.approx(half, rel=1e-4)


def test_seeds_on_their_way_are_not_counted_with_those_that_went_farther() -> None:
    evaluations = {
        0: (line(50, 0.2, 500.0), line(100, 1.0, 30.0)),
        1: (line(100, 0.9, 50.0),),
        2: (line(50, 0.1, 900.0),),
    }
    under_way = seed_results(evaluations, finished=False)
    assert under_way is not None and under_way.counted == 2 and under_way.error_mm.mean == 40.0
    assert [one.episode for one in under_way.seeds] == [100, 100, 50]
    over = seed_results(evaluations, finished=True)  # stages that converge early end after fewer balls
    assert over is not None and over.counted == 3 and over.returned.mean == pytest.approx(100 * 2.0 / 3)
    slower = {0: (line(100, 1.0, 30.0, 3.0),), 1: (line(100, 1.0, 90.0, 5.0),)}
    assert seed_results(slower, finished=False).counted == 1  # type: ignore[union-attr]


def test_nothing_is_said_of_one_seed_or_before_the_first_evaluation() -> None:
    assert seed_results({0: (line(50, 1.0, 30.0),)}, finished=True) is None
    assert seed_results({0: (), 1: ()}, finished=False) is None and seed_results_html(None) == ""


def test_the_rows_name_seeds_mean_and_interval_and_an_interval_needs_two() -> None:
    text = seed_results_html(seed_results({3: (line(100, 1.0, 30.0),), 4: (line(100, 0.98, 50.0),)}, finished=True))
    for words in ("100.0 %", "98.0 %", "30 mm", "50 mm", "mean of 2", "99.0 %", "40 mm", "Student's t", "0 to 167"):
        assert words in text, words
    assert "86.3 to 100.0" in text  # no share is above 100 %
    alone = seed_results_html(seed_results({0: (line(100, 1.0, None),), 1: ()}, finished=False))
    assert "mean of 1" in alone and "interval</td>" not in alone and "<td" in alone and "nan" not in alone
    many = seed_results_html(seed_results({n: (line(9, 1.0, 1.0),) for n in range(LISTED_SEEDS + 3)}, finished=True))
    assert "and 3 seeds before" in many and many.count("<tr>") == LISTED_SEEDS + 3


def test_damaged_numbers_do_no_harm() -> None:
    broken = seed_results({0: ({"episode": "x", "returned": 1e300},), 1: (line(10, 1.0, 5.0),)}, finished=True)
    assert broken is not None and "nan" not in seed_results_html(broken)


def test_a_stage_begins_with_the_first_ball_of_another_speed_and_is_an_upright_line() -> None:
    borders = stage_borders(np.array([3.0, 3.0, 4.0, 4.0, 4.0, 5.0]))
    assert borders.tolist() == [3.0, 6.0]
    axis = with_borders(shared_axis(6), borders)
    assert (np.diff(axis) >= 0).all() and np.count_nonzero(axis == 3.0) == 3
    line = border_lines(axis, borders, 1.0, 9.0)
    known = np.isfinite(line)
    assert axis[known].tolist() == [3.0, 3.0, 6.0, 6.0] and line[known].tolist() == [1.0, 9.0, 1.0, 9.0]
    assert len(stage_borders(np.full(5, 3.0))) == 0


def test_each_stage_has_its_speed_where_it_begins_as_far_as_there_is_room() -> None:
    stages = stages_of(np.array([3.0] * 30 + [4.0] * 3 + [5.0] * 27))
    assert stages == ((0.0, 3.0), (31.0, 4.0), (34.0, 5.0))
    assert stage_labels(stages, 60) == ("3 m/s", "4", "5 m/s")
    assert stage_labels(stages, 200) == ("3 m/s", "", "5 m/s"), "no text where it would lie over the next"
    assert stages_of(np.array([])) == () and stage_labels((), 100) == ()


def test_many_seeds_have_fewer_points_each() -> None:
    assert len(shared_axis(2000, 1)) == MAX_POINTS
    axis = shared_axis(2000, 40)
    assert axis[-1] == 2000 and 40 * len(axis) <= MAX_VALUES
    assert shared_axis(200, 40).tolist() == list(range(1, 201))
