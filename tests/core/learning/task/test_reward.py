"""The rewards against values worked out by hand."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from core.config import field_specs, load_config, replace_setting, save_config, setting
from core.errors import ConfigError, PluginError
from core.learning.config import RewardConfig, RunConfig
from core.learning.rewards import StrokeResults, register_reward
from core.learning.task.reward import Weights, distance_to_far_half, reward_weights, rewards_of
from core.physics.episode import Case
from core.registry import forgotten_afterwards

pytestmark = pytest.mark.numeric
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


@dataclass(frozen=True, kw_only=True)
class FlatConfig:
    """Of a reward that is the same for every ball."""

    value: float = setting(2.0, 0.0, 5.0)
    """What a ball earns."""


def flat(strokes: StrokeResults, weights: Weights, config: FlatConfig) -> np.ndarray:
    return np.full(len(strokes.case), weights.w2 * config.value)


def test_a_registered_reward_has_its_own_section_and_is_one_of_the_choices(tmp_path: Path) -> None:
    with forgotten_afterwards():
        register_reward("flat-one", flat, "always the same", config=FlatConfig)
        (kind, *_, value) = field_specs(RewardConfig)
        assert kind.choices == ("cdta", "case", "simple", "flat-one") and value.path == ("flat_one", "value")
        run = RunConfig(reward=replace_setting(RewardConfig(kind="flat-one"), value.path, 3.5))
        assert reward_weights(0, run.reward) == Weights(0.0, 1.0), "placing only, unless it says otherwise"
        assert reward(Case.MISSED, (0.0, 0.0), 0.0, Weights(0.0, 0.5), run.reward) == 1.75
        save_config(run, tmp_path / "config.toml")
        assert "[reward.flat_one]\nvalue = 3.5\n" in (tmp_path / "config.toml").read_text()
        assert load_config(RunConfig, tmp_path / "config.toml") == run
    with pytest.raises(ConfigError, match=r"expected one of .*; if it comes with a plugin, name that with --plugin"):
        load_config(RunConfig, tmp_path / "config.toml")
    with pytest.raises(ConfigError, match=r"not one of the choices; expected cdta \| case \| simple, got 'flat-one'"):
        RewardConfig(kind="flat-one")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"name": "cdta"}, "there is a reward 'cdta' already"),
        ({"rewards": 3}, "no way to work it out"),
        ({"label": ""}, "no label"),
        ({"config": int}, "no config"),
    ],
)
def test_a_reward_that_does_not_fit_is_refused(given: dict, said: str) -> None:
    whole = {"name": "flat", "rewards": flat, "label": "always the same", "config": FlatConfig, **given}
    with forgotten_afterwards(), pytest.raises((PluginError, ConfigError), match=said):
        register_reward(whole.pop("name"), **whole)
