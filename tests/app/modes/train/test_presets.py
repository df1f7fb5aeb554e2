"""What may be asked of a training."""

import dataclasses
import importlib.util

import pytest

from app.modes.train.presets import (
    MAX_EPISODES,
    MAX_SEEDS,
    PACES,
    PRESETS,
    TRAIN_NOW,
    offered_agents,
    offered_presets,
    startable_run,
)
from core.config import replace_setting
from core.errors import ConfigError
from core.learning.config import CurriculumConfig, RunConfig, default_run


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_can_be_started_and_has_a_pace_that_is_offered(name: str) -> None:
    preset = PRESETS[name]
    assert preset.pace in PACES
    if preset.config.agent in offered_agents():
        started = startable_run(preset.config)
        assert dataclasses.replace(started, checkpoint_every=50) == preset.config


def test_the_button_of_a_newcomer_takes_less_than_a_minute_of_balls() -> None:
    preset = PRESETS[TRAIN_NOW]
    rate = PACES[preset.pace]
    assert rate is not None
    assert 30 <= preset.config.episodes / rate < 50  # the rest is for starting the process


def test_the_papers_preset_is_the_papers_run() -> None:
    preset = next(preset for preset in PRESETS.values() if preset.slug == "paper")
    assert startable_run(preset.config) == default_run("ddpg")


def stages(*episodes: int, speed_mps: float = 5.0) -> RunConfig:
    curriculum = CurriculumConfig(speeds_mps=(speed_mps,) * len(episodes), episodes=episodes)
    return dataclasses.replace(default_run("landing-model"), curriculum=curriculum)


@pytest.mark.parametrize(("episodes", "every"), [(100, 10), (5, 1), (1700, 50)])
def test_a_short_stage_is_evaluated_at_least_ten_times_and_a_long_one_as_in_the_paper(episodes, every) -> None:
    assert startable_run(stages(episodes)).checkpoint_every == every


@pytest.mark.parametrize(
    "config",
    [
        stages(*(1,) * 11),
        stages(MAX_EPISODES + 1),
        dataclasses.replace(stages(10), seeds=MAX_SEEDS + 1),
        replace_setting(stages(10), ("environment", "state_source"), "events"),
    ],
)
def test_what_is_not_offered_to_browsers_is_refused_in_one_line(config: RunConfig) -> None:
    with pytest.raises(ConfigError) as caught:
        startable_run(config)
    assert "\n" not in str(caught.value)


def test_agents_of_stable_baselines3_are_offered_only_where_it_is() -> None:
    has = importlib.util.find_spec("stable_baselines3") is not None
    assert ("td3" in offered_agents()) == has
    assert any(PRESETS[name].config.agent == "td3" for name in offered_presets()) == has
    if not has:
        with pytest.raises(ConfigError, match="not offered"):
            startable_run(default_run("td3"))
