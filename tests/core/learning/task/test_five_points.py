"""The paper's prediction: exact where its assumptions hold, and honest about balls that it hardly sees."""

import dataclasses

import numpy as np
import pytest

from core.learning.config import EnvironmentConfig, environment_profile
from core.learning.task.environment import draw_serve_batch, play
from core.physics.episode import Case

pytestmark = pytest.mark.numeric


@pytest.mark.parametrize("speed", [3.0, 5.0, 9.0])
def test_under_gravity_alone_the_prediction_is_the_truth(speed: float) -> None:
    balls = draw_serve_batch(speed, 200, EnvironmentConfig(state_source="predicted"), np.random.default_rng(0))
    assert balls.seen.mean() > 0.95 and balls.aim_t_s is not None
    seen = balls.seen
    np.testing.assert_allclose(balls.states[seen], balls.arrivals.observations[seen], atol=1e-9)
    np.testing.assert_allclose(balls.aim_t_s[seen], balls.arrivals.t_s[seen], atol=1e-9)


def test_a_ball_that_is_seen_once_is_missed() -> None:
    config = environment_profile(state_source="predicted")
    config = dataclasses.replace(config, step_s=0.05)  # so coarse that fast balls are observed once or never
    balls = draw_serve_batch(9.0, 100, config, np.random.default_rng(1))
    assert 0 < balls.seen.mean() < 1
    assert not balls.states[~balls.seen].any()
    outcomes = play(balls, np.zeros((100, 3)), config)
    np.testing.assert_array_equal(outcomes.case[~balls.seen], Case.MISSED)


def test_drag_makes_the_prediction_wrong_by_centimetres_but_the_racket_is_large_enough() -> None:
    config = environment_profile("real", state_source="predicted")
    balls = draw_serve_batch(5.0, 200, config, np.random.default_rng(2))
    off = np.abs(balls.states - balls.arrivals.observations)[balls.seen]
    assert 0.005 < np.median(off[:, 2]) < 0.08  # 8 cm is the face's radius
    outcomes = play(balls, np.zeros((200, 3)), config)
    assert not (outcomes.case[balls.seen] == Case.MISSED).any()
    np.testing.assert_array_equal(outcomes.case[~balls.seen], Case.MISSED)
