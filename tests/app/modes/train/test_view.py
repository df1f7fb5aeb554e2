"""What a browser is shown of the runs."""

import dataclasses

import cv2
import numpy as np
import pytest

from app.modes.train.curves import CURVES
from app.modes.train.plan_view import (
    FLOOR_RGB,
    HIGH_M,
    LOW_M,
    NEW_BALLS,
    NEW_RGB,
    OFFSETS_PX,
    OFFSETS_REACH_M,
    OLD_RGB,
    PIXELS_PER_M,
    TABLE_RGB,
    draw_offsets,
    draw_plan,
)
from app.modes.train.side_panel import _curve_series, _range_of, _scales, chart_columns
from app.modes.train.view import COMPARED, RunsViewer, ViewRequest, chosen_run, compared_runs, make_details
from app.scene.prediction import CASE_RGB
from app.shared.trainer import Trainer
from app.shared.training_records import MetricsStore
from app.shared.workspace import Workspace
from core.learning.runs.run_files import create_run, read_lines, seed_files
from core.physics.episode import Case
from tests.app.modes.train.small_runs import small_run


@pytest.fixture
def viewer(trained: Workspace) -> RunsViewer:
    return RunsViewer(trained, Trainer(trained), MetricsStore())


def test_a_finished_run_is_shown_whole(viewer: RunsViewer, trained: Workspace) -> None:
    view = viewer(ViewRequest(None, None))
    assert view.run is not None and view.run.name == "small" and view.run.phase == "finished"
    assert view.results["small"]["episode"] == 40
    assert view.playable
    details = view.details
    assert details is not None and details.episodes_done == 40 and details.seed == 1  # the one that was trained last
    lines = read_lines(seed_files(trained.run_path("small"), 1).metrics)[0]
    for case in Case:
        assert details.counts[case] == sum(line["case"] == case for line in lines)
    returned = 100 * np.mean([line["case"] == Case.RETURNED for line in lines[-25:]])
    assert details.returned == pytest.approx(returned)
    assert [(spot.x_m, spot.y_m) for spot in details.spots][-1] == pytest.approx(lines[-1]["landing_m"])
    picture = cv2.imdecode(np.frombuffer(details.plan_png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None and picture.shape[1] == round((HIGH_M[0] - LOW_M[0]) * PIXELS_PER_M)


def test_charts_are_aligned_and_hold_the_mean_of_the_seeds(viewer: RunsViewer) -> None:
    details = viewer(ViewRequest("small", None)).details
    assert details is not None
    charts = details.charts
    assert charts.axis.tolist() == list(range(1, 41))
    for curves in (charts.run, charts.seeds_mean, *charts.compared):
        assert set(curves) == set(CURVES) and all(len(curve) == 40 for curve in curves.values())
    assert len(charts.compared) == COMPARED
    assert np.isfinite(charts.seeds_mean["reward"][10:]).all()
    for name in ("returned", "error_mm", "reward"):
        mean = charts.seeds_mean[name][10:]
        assert (charts.seeds_low[name][10:] <= mean).all() and (mean <= charts.seeds_high[name][10:]).all()
    (other,) = charts.seeds.values()  # hidden, beside the newest seed's
    assert list(charts.seeds) == [0] and charts.stages == ((0.0, 5.0),)
    assert other["reward"] == pytest.approx(2 * charts.seeds_mean["reward"] - charts.run["reward"], nan_ok=True)
    for seeds in ((), (200,), tuple(range(200, 207))):  # as many lines as there are curves, each with its seed
        shown = dataclasses.replace(charts, seeds=dict.fromkeys(seeds, other))
        series = _curve_series(seeds)
        assert len(series) == 1 + len(chart_columns(shown)["error_mm"])
        hidden = [one.get("label") for one in series if not one.get("show", True)]
        assert hidden == [f"seed {seed}" for seed in seeds], "shown with the mouse over the chart only"
    assert np.isnan(charts.compared[0]["reward"]).all()
    assert np.count_nonzero(np.isfinite(charts.evaluated["returned"])) == 10


def test_the_scale_of_the_error_covers_the_curves_and_has_no_place_for_a_missing_value() -> None:
    nothing = np.full(3, np.nan)
    curves = [nothing, nothing, nothing, np.array([np.nan, 933.0, 40.0])]
    assert _range_of("error_mm", curves) == (10.0, 1_000.0)
    assert _range_of("error_mm", [*curves[:3], np.array([90.0])]) == (10.0, 100.0)
    # uPlot puts what is not above 0, NaN too, at the lower end of a logarithmic scale (3), and nowhere on others.
    assert _scales(100, "error_mm", (10.0, 1_000.0))["y"]["distr"] == 4


def test_other_runs_are_drawn_as_far_as_the_chosen_one_is_to_go(viewer: RunsViewer, trained: Workspace) -> None:
    metrics = {seed: viewer._metrics.read(trained.run_path("small"), seed) for seed in (0, 1)}
    nothing = viewer._metrics.read(trained.run_path("nobody"), 0)
    young = make_details({0: nothing}, [metrics[0]], 30).charts
    assert young.end == 30 and young.axis[-1] == 30 and np.isfinite(young.compared[0]["reward"][10:]).all()
    assert make_details({0: metrics[0]}, [nothing], 100).charts.axis[-1] == 40


def test_what_is_shown_already_is_not_made_again(viewer: RunsViewer) -> None:
    first = viewer(ViewRequest(None, None))
    again = viewer(ViewRequest(None, None, first.key))
    assert again.details is None and again.key == first.key and again.run == first.run


def test_an_empty_workspace_has_nothing_to_show(tmp_path) -> None:
    workspace = Workspace(tmp_path)
    view = RunsViewer(workspace, Trainer(workspace), MetricsStore())(ViewRequest("gone", ("gone",)))
    assert view.runs == () and view.run is None and view.details is None


def test_a_run_that_has_not_begun_has_empty_curves(tmp_path) -> None:
    workspace = Workspace(tmp_path)
    create_run(workspace.run_path("new"), small_run())
    view = RunsViewer(workspace, Trainer(workspace), MetricsStore())(ViewRequest(None, None))
    assert view.run is not None and view.run.phase == "new" and view.run.resumable
    assert view.details is not None and view.details.episodes_done == 0 and view.details.spots == ()


def test_the_newest_is_followed_and_others_stand_beside_it(tmp_path) -> None:
    workspace = Workspace(tmp_path)
    trainer = Trainer(workspace)
    for k in range(5):
        create_run(workspace.run_path(f"run-{k}"), small_run())
    runs = trainer.runs()
    run = chosen_run(runs, None)
    assert run == runs[0] and chosen_run(runs, "run-2") is not None and chosen_run(runs, "nobody") == runs[0]
    assert run is not None
    assert compared_runs(runs, run, None) == runs[1 : 1 + COMPARED]
    assert [r.name for r in compared_runs(runs, runs[0], (runs[3].name, "nobody"))] == [runs[3].name]
    assert compared_runs(runs, run, ()) == ()


def test_the_plan_shows_each_spot_at_its_place_in_the_colour_of_its_case() -> None:
    cases = np.array([float(case) for case in Case] + [4.0, 3.0])
    landings = np.array([[-0.7, 0.4], [0.1, 0.0], [1.6, 0.9], [0.9, -0.4], [np.nan, np.nan], [0.5, 0.5], [50.0, 0.0]])
    picture = draw_plan(cases, landings, None)

    def pixel(x_m: float, y_m: float) -> tuple[int, ...]:
        column, row = (x_m - LOW_M[0]) * PIXELS_PER_M, (HIGH_M[1] - y_m) * PIXELS_PER_M
        return tuple(picture[min(int(row), len(picture) - 1), int(column)].tolist())

    assert pixel(-1.0, -0.3) == TABLE_RGB and pixel(2.0, 1.0) == FLOOR_RGB
    assert pixel(HIGH_M[0] - 0.03, 0.0) == CASE_RGB[Case.OUT]  # the newest, far out: at the edge
    newer, older = np.array(pixel(0.5, 0.5)), np.array(pixel(0.9, -0.4))
    assert newer.argmax() == older.argmax() == 1 and newer[1] > older[1] > 100  # green, and fading with age
    assert (draw_plan(cases, landings, np.array([0.7, 0.1])) != picture).any()


def test_offsets_are_drawn_from_the_target_in_the_middle() -> None:
    goals = np.full((NEW_BALLS + 1, 2), (0.8, 0.2))
    landings = goals + np.array([[0.25, 0.15]] + [[-0.15, 0.05]] * (NEW_BALLS - 1) + [[9.0, 0.0]])
    picture = draw_offsets(landings, goals)

    def pixel(dx_m: float, dy_m: float) -> tuple[int, ...]:
        scale, middle = OFFSETS_PX / 2 / OFFSETS_REACH_M, OFFSETS_PX / 2
        return tuple(picture[round(middle - dy_m * scale), round(middle + dx_m * scale)].tolist())

    assert pixel(0.25, 0.15) == OLD_RGB and pixel(-0.15, 0.05) == NEW_RGB and pixel(-0.25, 0.15) == FLOOR_RGB
    assert pixel(0.485, 0.0) == NEW_RGB  # far out: at the rim
    empty = draw_offsets(np.full((1, 2), np.nan), np.zeros((1, 2)))
    assert not (empty == NEW_RGB).all(axis=-1).any()


def test_a_run_without_a_policy_cannot_play(tmp_path) -> None:
    workspace = Workspace(tmp_path)
    create_run(workspace.run_path("new"), small_run())
    view = RunsViewer(workspace, Trainer(workspace), MetricsStore())(ViewRequest(None, None))
    assert view.run is not None and view.run.phase == "new" and not view.playable
