import numpy as np
import pytest

from core.history.lead_time import lead_time_errors, true_crossings
from core.recordings import BallTruth
from core.trajectory.prediction import HitPlane

PLANE_M = -1.42


def straight_ball(start_us: int) -> BallTruth:
    """5 m/s towards the robot, from x = 1, at y = 0.1 and z = 0.2; crosses the plane after 484 ms."""
    t_us = start_us + np.arange(0, 600_001, 1000)
    x = 1.0 - 5.0 * (t_us - start_us) * 1e-6
    ps = np.stack([x, np.full_like(x, 0.1), np.full_like(x, 0.2)], axis=1)
    vs = np.tile((-5.0, 0.0, 0.0), (len(t_us), 1))
    return BallTruth(t_us, ps, vs, np.zeros_like(ps), np.ones(len(t_us), np.bool_))


def said(t_s: float, y_m: float, stage: str) -> HitPlane:
    p = np.array([PLANE_M, y_m, 0.2])
    return HitPlane(t_s, 0.001, p, np.zeros(3), np.array([-5.0, 0, 0]), np.zeros(3), np.zeros((6, 6)), stage)


def test_the_crossing_of_the_plane_is_interpolated() -> None:
    t_us, ps = true_crossings(straight_ball(100_000), PLANE_M)
    assert len(t_us) == 1 and abs(int(t_us[0]) - 584_000) <= 1
    np.testing.assert_allclose(ps[0], [PLANE_M, 0.1, 0.2])


def test_a_ball_that_is_struck_at_the_plane_would_have_come_through_it_there() -> None:
    ball = straight_ball(0)
    struck = ball.p_world_m[:, 0] < PLANE_M + 0.03
    back = ball.p_world_m.copy()
    back[struck, 0] = 2 * (PLANE_M + 0.03) - back[struck, 0]
    vs = np.where(struck[:, None], -ball.v_world_mps, ball.v_world_mps)
    t_us, ps = true_crossings(BallTruth(ball.t_us, back, vs, ball.spin_radps, ball.visible), PLANE_M)
    assert len(t_us) == 1 and abs(int(t_us[0]) - 484_000) <= 1
    np.testing.assert_allclose(ps[0], [PLANE_M, 0.1, 0.2])


def test_errors_and_lead_times_are_those_of_the_predictions() -> None:
    predicted = [(184_000, said(0.6, 0.13, "pre")), (534_000, said(0.585, 0.11, "post"))]
    errors = lead_time_errors(predicted, straight_ball(100_000))
    np.testing.assert_allclose(errors.lead_ms, [400.0, 50.0], atol=0.01)
    np.testing.assert_allclose(errors.error_mm, [30.0, 10.0], atol=1e-6)
    assert errors.after_bounce.tolist() == [False, True]


def test_a_prediction_of_another_ball_does_not_count() -> None:
    assert len(lead_time_errors([(10_000, said(5.0, 0.1, "pre"))], straight_ball(100_000)).lead_ms) == 0


@pytest.mark.parametrize("count", [2, 3])
def test_a_bin_needs_three_predictions(count: int) -> None:
    predicted = [(534_000, said(0.585, 0.11, "post"))] * count
    middles, before, after = lead_time_errors(predicted, straight_ball(100_000)).medians()
    assert np.isnan(before).all()
    shown = np.flatnonzero(np.isfinite(after))
    assert len(shown) == (count == 3)
    if count == 3:
        assert abs(middles[shown[0]] - 50) <= 12.5 and after[shown[0]] == pytest.approx(10.0)
