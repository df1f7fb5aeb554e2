"""The paper's prediction: exact where its assumptions hold, and honest about balls that it hardly sees."""

import numpy as np
import pytest

from core.learning.config import EnvironmentConfig, environment_profile
from core.learning.environment import deliver, play
from core.learning.five_points import extrapolate
from core.simulation.physics.episode import Case


@pytest.mark.parametrize("speed", [3.0, 5.0, 9.0])
def test_under_gravity_alone_the_prediction_is_the_truth(speed: float) -> None:
    balls = deliver(speed, 200, EnvironmentConfig(state_source="predicted"), np.random.default_rng(0))
    assert balls.seen.mean() > 0.95 and balls.aim_t_s is not None
    seen = balls.seen
    np.testing.assert_allclose(balls.states[seen], balls.arrivals.observations[seen], atol=1e-9)
    np.testing.assert_allclose(balls.aim_t_s[seen], balls.arrivals.t_s[seen], atol=1e-9)


def test_five_noisy_points_give_the_least_squares_line() -> None:
    rng = np.random.default_rng(1)
    t = np.linspace(0.5, 0.54, 5)
    ps = np.column_stack([-1.0 - 4 * (t - 0.5), 0.1 + 0.2 * (t - 0.5), 0.2 + 1.0 * (t - 0.5)])
    ps += rng.normal(0, 0.002, ps.shape)
    states, when = extrapolate(t[None], ps[None], np.ones((1, 5), np.bool_), -1.42)
    slope, at_zero = np.polyfit(t, ps[:, 0], 1)
    assert when[0] == pytest.approx((-1.42 - at_zero) / slope)
    lifted = ps[:, 2] + 0.5 * 9.81 * t**2
    vz, z = np.polyfit(t, lifted, 1)
    assert states[0, 2] == pytest.approx(z + vz * when[0] - 0.5 * 9.81 * when[0] ** 2)
    assert states[0, 5] == pytest.approx(vz - 9.81 * when[0])


def test_a_ball_that_is_seen_once_is_missed() -> None:
    t = np.array([[0.5, 0.51, 0.52, 0.53, 0.54]])
    observed = np.array([[True, False, False, False, False]])
    states, when = extrapolate(t, np.full((1, 5, 3), -1.0), observed, -1.42)
    assert np.isnan(states).all() and np.isnan(when).all()


def test_drag_makes_the_prediction_wrong_by_centimetres_but_the_racket_is_large_enough() -> None:
    config = environment_profile("real", state_source="predicted")
    balls = deliver(5.0, 200, config, np.random.default_rng(2))
    off = np.abs(balls.states - balls.arrivals.observations)[balls.seen]
    assert 0.005 < np.median(off[:, 2]) < 0.08  # 8 cm is the face's radius
    outcomes = play(balls, np.zeros((200, 3)), config)
    assert not (outcomes.case[balls.seen] == Case.MISSED).any()
    np.testing.assert_array_equal(outcomes.case[~balls.seen], Case.MISSED)
