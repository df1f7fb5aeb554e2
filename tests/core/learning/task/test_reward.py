"""The rewards against values worked out by hand."""

import math

import numpy as np
import pytest

from core.learning.config import RewardConfig
from core.learning.task.reward import Weights, distance_to_far_half, reward_weights, rewards_of
from core.physics.episode import Case

GOAL = np.array([[0.8, 0.1]])


def reward(case: int, landing: tuple[float, float], net_z: float, weights: Weights, config: RewardConfig) -> float:
    return float(rewards_of(np.array([case]), np.array([landing]), np.array([net_z]), GOAL, weights, config)[0])


def test_cdta_weights_move_from_returning_to_placing() -> None:
    config = RewardConfig(kind="cdta", beta=0.02)
    assert reward_weights(0, config) == Weights(1.0, 0.0)
    later = reward_weights(50, config)
    assert later.w1 == pytest.approx(math.exp(-1)) and later.w1 + later.w2 == pytest.approx(1)
    assert reward_weights(10**6, config).w2 == pytest.approx(1)


def test_constant_weights_do_not_move() -> None:
    config = RewardConfig(kind="case", case_weight=0.3)
    assert reward_weights(0, config) == reward_weights(1000, config) == Weights(0.3, 0.7)


@pytest.mark.parametrize(
    ("case", "landing", "net_z", "expected"),
    [
        (Case.OWN_HALF, (-0.685, 0.0), math.nan, -0.5),  # half of d_max2 = 1.37 before the net
        (Case.NET, (0.3, 0.0), 0.0, -1.0),
        (Case.NET, (0.3, 0.0), 0.07625, -0.5),
        (Case.NET, (0.3, 0.0), 0.16, 0.0),  # the cord: not below it
        (Case.OUT, (2.37, 0.0), 0.5, -0.5),  # 1 m behind the table of d_max3 = 2
        (Case.OUT, (9.0, 0.0), 0.5, -1.0),
        (Case.MISSED, (math.nan, math.nan), math.nan, -1.0),
        (Case.RETURNED, (0.8, 0.1), 0.3, 0.25 * 1 + 0.75 * 4),  # on the target
        (Case.RETURNED, (0.8, -0.4), 0.3, 0.25 * 1 + 0.75 * 2.5),  # 0.5 m beside it
        (Case.RETURNED, (1.36, 0.76), 0.3, 0.25 + 0.75 * (1 + 3 * (1 - math.hypot(0.56, 0.66)))),
    ],
)
def test_every_case_has_its_own_formula(case: int, landing: tuple[float, float], net_z: float, expected: float) -> None:
    got = reward(case, landing, net_z, Weights(0.25, 0.75), RewardConfig())
    assert got == pytest.approx(expected)


def test_simple_pays_for_a_return_and_nothing_else() -> None:
    config = RewardConfig(kind="simple")
    weights = reward_weights(7, config)
    assert reward(Case.RETURNED, (0.1, 0.1), 0.3, weights, config) == 1
    assert [reward(c, (0.1, 0.1), 0.1, weights, config) for c in (Case.OWN_HALF, Case.NET, Case.OUT)] == [0, 0, 0]
    placed = RewardConfig(kind="simple", simple_accuracy=True)
    assert reward(Case.RETURNED, (0.8, 0.1), 0.3, reward_weights(7, placed), placed) == 4


def test_only_returned_balls_reach_the_threshold_of_the_replay_rule() -> None:
    rng = np.random.default_rng(0)
    n = 2000
    case = rng.integers(1, 6, n)
    landings = rng.uniform(-3, 3, (n, 2))
    goals = rng.uniform(0.4, 1.1, (n, 2))
    for episode in (0, 30, 500):
        for config in (RewardConfig(), RewardConfig(kind="case"), RewardConfig(kind="simple")):
            got = rewards_of(case, landings, rng.uniform(0, 0.4, n), goals, reward_weights(episode, config), config)
            np.testing.assert_array_equal(got >= config.base - 1e-9, case == Case.RETURNED)


def test_the_distance_to_the_far_half_is_zero_on_it_and_goes_to_its_nearest_edge() -> None:
    points = [[0.5, 0.3], [-1.0, 0.0], [0.5, 1.7625], [1.67, 1.1625]]
    np.testing.assert_allclose(distance_to_far_half(points), [0, 1, 1, 0.5])
