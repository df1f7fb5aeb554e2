"""What the networks are given: numbers of the order of one, by constants that every stored policy depends on."""

import numpy as np
import pytest

from core.learning.config import EnvironmentConfig, environment_profile
from core.learning.task.environment import draw_serve_batch
from core.learning.task.normalise import normal_goals, normal_observations, normal_racket_speeds, normal_states

pytestmark = pytest.mark.numeric


def test_a_spread_beyond_the_middle_is_one() -> None:
    """A stored policy gives other actions when any of these changes."""
    middle, spread = np.array([-1.42, 0.0, 0.24, -5.0, 0.0, 0.9]), np.array([0.1, 0.25, 0.1, 2.2, 0.5, 0.9])
    for factor in (-2.0, 0.0, 1.0):
        np.testing.assert_allclose(normal_states((middle + factor * spread)[None])[0], np.full(6, factor), atol=1e-5)
    np.testing.assert_allclose(normal_racket_speeds(np.array([1.0, 2.4, -0.4])), [0, 1, -1], atol=1e-6)


def test_the_default_target_box_becomes_minus_one_to_one() -> None:
    goal = EnvironmentConfig().goal
    corners = np.array([[0.45, -0.45], [1.1, 0.45]])
    np.testing.assert_allclose(normal_goals(corners), [[-1, -1], [1, 1]], atol=1e-6)
    np.testing.assert_allclose(normal_goals(np.array([goal.centre_m])), [[0, 0]], atol=1e-6)


def test_a_wild_estimate_is_cut_off_at_ten_spreads() -> None:
    wild = np.array([[1e6, -1e6, 0.24, -5.0, 0.0, 0.9]])
    np.testing.assert_allclose(normal_states(wild)[0, :3], [10, -10, 0], atol=1e-5)


def test_states_racket_speed_and_goal_follow_each_other() -> None:
    states, goals = np.array([[-1.42, 0.25, 0.24, -5.0, 0.0, 0.9]]), np.array([[1.1, 0.0]])
    np.testing.assert_allclose(normal_observations(states, goals), [[0, 1, 0, 0, 0, 0, 1, 0]], atol=1e-6)
    known = normal_observations(states, goals, np.array([2.4]))
    np.testing.assert_allclose(known, [[0, 1, 0, 0, 0, 0, 1, 1, 0]], atol=1e-6)
    assert known.dtype == np.float32


def test_serves_of_all_speeds_are_of_the_order_of_one() -> None:
    config = environment_profile(serves="hard", state_source="truth")
    rng = np.random.default_rng(0)
    states = np.concatenate([draw_serve_batch(speed, 60, config, rng).states for speed in (3.0, 5.0, 7.0, 9.0)])
    seen = normal_states(states)
    assert np.abs(seen.mean(0)).max() < 0.7
    assert (seen.std(0)[1:] > 0.3).all() and (seen.std(0) < 1.5).all() and np.abs(seen).max() < 4
