"""What may be asked of a training."""

import dataclasses
import importlib.util

import pytest

from app.modes.train.plan import (
    MOST_EPISODES,
    PACES,
    PRESETS,
    TRAIN_NOW,
    TrainingPlan,
    numbers_text,
    offered_agents,
    offered_presets,
    parse_episodes,
    parse_speeds,
    run_of_plan,
)
from core.errors import ConfigError
from core.learning.config import default_run


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_a_run_that_can_be_made_and_has_a_pace_that_is_offered(name: str) -> None:
    preset = PRESETS[name]
    assert preset.pace in PACES
    if preset.plan.agent in offered_agents():
        config = run_of_plan(preset.plan)
        assert config.curriculum.speeds_mps == preset.plan.speeds_mps
        assert config.environment.state_source == preset.plan.source


def test_the_button_of_a_newcomer_takes_less_than_a_minute_of_balls() -> None:
    preset = PRESETS[TRAIN_NOW]
    rate = PACES[preset.pace]
    assert rate is not None
    assert 30 <= sum(preset.plan.episodes) / rate < 50  # the rest is for starting the process


def test_the_papers_preset_is_the_papers_run() -> None:
    preset = next(preset for preset in PRESETS.values() if preset.slug == "paper")
    assert run_of_plan(preset.plan) == default_run("ddpg")


def test_a_short_stage_is_evaluated_at_least_ten_times_and_a_long_one_as_in_the_paper() -> None:
    assert run_of_plan(TrainingPlan(episodes=(100,))).checkpoint_every == 10
    assert run_of_plan(TrainingPlan(episodes=(5,))).checkpoint_every == 1
    assert run_of_plan(TrainingPlan(episodes=(1700,))).checkpoint_every == 50


@pytest.mark.parametrize(
    "change",
    [
        {"agent": "rm -rf"},
        {"reward": "huge"},
        {"replay": ""},
        {"advance": "never"},
        {"source": "events"},
        {"speeds_mps": (), "episodes": ()},
        {"speeds_mps": (2.0,)},
        {"speeds_mps": (float("nan"),)},
        {"speeds_mps": (5.0,) * 11, "episodes": (1,) * 11},
        {"episodes": (1, 2)},
        {"episodes": (0,)},
        {"episodes": (MOST_EPISODES + 1,)},
        {"seeds": 0},
        {"seeds": 51},
        {"first_seed": -1},
        {"first_seed": 10_001},
    ],
)
def test_what_is_not_offered_is_refused_in_one_line(change: dict) -> None:
    with pytest.raises(ConfigError) as caught:
        run_of_plan(dataclasses.replace(TrainingPlan(), **change))
    assert "\n" not in str(caught.value)


def test_typed_lists_are_read_and_shown_as_people_write_them() -> None:
    assert parse_speeds("3, 5") == parse_speeds("3 5") == (3.0, 5.0)
    assert parse_episodes("800, 900", 2) == (800, 900)
    assert parse_episodes("100", 3) == (100, 100, 100)
    assert numbers_text((3.0, 4.5)) == "3, 4.5"
    assert numbers_text((100, 100)) == "100"


@pytest.mark.parametrize("text", ["", "fast", "3;5", "1" * 13, ",".join("3" * 11)])
def test_what_is_no_list_of_numbers_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_speeds(text)
    with pytest.raises(ConfigError):
        parse_episodes(text, 1)


def test_rivals_are_offered_only_where_their_libraries_are() -> None:
    has = importlib.util.find_spec("stable_baselines3") is not None
    assert ("td3" in offered_agents()) == has
    assert any(PRESETS[name].plan.agent == "td3" for name in offered_presets()) == has
