import numpy as np
import pytest

from benchmarks.prediction.bench_perceived_prediction import evaluate
from benchmarks.prediction.bench_prediction import spinning_task
from benchmarks.prediction.perceived_balls import PerceivedBall, draw_physics, perceived_ball
from core.trajectory import FilterConfig, FilterPredictor


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("balls")


@pytest.fixture(scope="module")
def ball(folder) -> PerceivedBall:
    return perceived_ball(folder, 9.0, 0, "refined")


def test_a_ball_is_seen_to_millimetres_up_to_the_plane(ball) -> None:
    assert len(ball.t_us) > 100 and (np.diff(ball.t_us) > 0).all()
    assert np.median(ball.errors_m) < 0.001
    assert 0 < ball.truth.bounce_s < ball.t_us[-1] * 1e-6 < ball.truth.hit_s
    assert (ball.when_us >= ball.t_us).all(), "a point is there when its window is over"
    assert ball.begins[0] and np.linalg.eigvalsh(ball.covariances_m2).min() > 0


def test_it_is_kept_and_not_seen_again(ball, folder) -> None:
    (path,) = folder.glob("*.npz")
    written = path.stat().st_mtime_ns
    again = perceived_ball(folder, 9.0, 0, "refined")
    assert path.stat().st_mtime_ns == written
    for name in ("when_us", "t_us", "ps_m", "covariances_m2", "begins", "errors_m"):
        np.testing.assert_array_equal(getattr(again, name), getattr(ball, name))
    assert again.truth.hit_s == ball.truth.hit_s
    np.testing.assert_array_equal(again.truth.landing_m, ball.truth.landing_m)


def test_predictions_come_after_what_they_are_made_of(ball) -> None:
    said = ball.predict(FilterPredictor(FilterConfig(restless_odds=0.0)))
    assert len(said.when_s) > 10
    assert all(p.t_us * 1e-6 <= when for when, p in zip(said.when_s, said.predictions, strict=True))
    assert said.at(0.0) is None and said.at(1.0) is said.predictions[-1]


def test_no_two_balls_have_the_same_air_and_table() -> None:
    fitted = spinning_task().physics
    drawn = [draw_physics(fitted, np.random.default_rng(seed)) for seed in range(300)]
    off = [
        (
            one.air.drag_coefficient - fitted.air.drag_coefficient,
            one.table.restitution - fitted.table.restitution,
            one.table.friction - fitted.table.friction,
        )
        for one in drawn
    ]
    np.testing.assert_allclose(np.std(off, axis=0), 0.02, rtol=0.15)
    np.testing.assert_allclose(np.mean(off, axis=0), 0.0, atol=0.004)


def test_every_method_is_scored_on_the_same_balls(ball) -> None:
    found = evaluate({"refined": {9.0: [ball]}, "auto": {9.0: [ball]}})
    assert [(row["speed_mps"], row["method"]) for row in found.rows] == [
        (speed, method) for speed in (9.0, "all") for method in ("filter", "fit", "paper", "filter-auto")
    ]
    assert all(row["balls"] == 1 and row["landing_80ms_ahead_flights"] == 1 for row in found.rows)
    by_method = {row["method"]: row for row in found.rows}
    name = "hit_plane_30ms_after_median_mm"
    assert by_method["filter"][name] < by_method["paper"][name]  # type: ignore[operator]
