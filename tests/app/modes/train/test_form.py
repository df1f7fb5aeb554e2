"""What a browser sends as a form, and the run that it means."""

import dataclasses
import importlib.util

import pytest

from app.modes.train.form import (
    MAIN,
    MAX_EPISODES,
    MAX_SEEDS,
    NOT_HERE,
    PACES,
    PRESETS,
    TRAIN_NOW,
    Preset,
    agent_defaults,
    form_specs,
    offered_agents,
    offered_presets,
    run_of_form,
    startable_run,
    value_shown,
)
from core.config import field_specs, get_setting, replace_setting
from core.errors import ConfigError
from core.learning.config import CurriculumConfig, RunConfig, default_run

FORM = {
    ("agent",): "ddpg",
    ("reward", "kind"): "case",
    ("curriculum", "speeds_mps"): "3, 5",
    ("curriculum", "episodes"): "80, 90",
    ("curriculum", "advance"): "converged",
    ("curriculum", "replay"): "discard",
    ("environment", "state_source"): "truth",
    ("seeds",): 2,
    ("first_seed",): 7.0,
}


def test_a_form_is_a_run() -> None:
    run = run_of_form(default_run("ddpg"), FORM)
    curriculum = dataclasses.replace(
        RunConfig().curriculum, speeds_mps=(3.0, 5.0), episodes=(80, 90), advance="converged", replay="discard"
    )
    assert run.curriculum == curriculum and run.reward.kind == "case" and run.environment.state_source == "truth"
    assert (run.agent, run.seeds, run.first_seed) == ("ddpg", 2, 7)
    assert (run.ddpg, run.exploration, run.environment.goal) == (
        RunConfig().ddpg,
        RunConfig().exploration,
        RunConfig().environment.goal,
    )


def test_every_field_of_a_run_but_the_task_and_files_is_in_the_form_once() -> None:
    paths = [spec.path for spec in form_specs()]
    assert len(paths) == len(set(paths)) and tuple(paths[: len(MAIN)]) == MAIN
    assert set(paths) == {s.path for s in field_specs(RunConfig) if s.path[:2] not in NOT_HERE}


@pytest.mark.parametrize("preset", PRESETS.values(), ids=lambda preset: preset.slug)
def test_what_the_form_shows_of_a_preset_means_that_preset(preset: Preset) -> None:
    shown = {spec.path: value_shown(preset.config, spec) for spec in form_specs()}
    if preset.config.agent in form_specs()[0].choices:
        assert run_of_form(RunConfig(), shown | {}) == dataclasses.replace(
            preset.config, environment=dataclasses.replace(preset.config.environment, task=RunConfig().environment.task)
        )


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("ddpg", "tau"), 0.5),
        (("exploration", "random_episodes"), 3.0),
        (("reward", "simple_accuracy"), True),
        (("environment", "randomise", "latency"), True),
        (("environment", "racket"), "uncertain"),
    ],
)
def test_a_setting_that_most_leave_alone_reaches_the_run(path, value) -> None:
    run = run_of_form(default_run("ddpg"), {path: value})
    assert get_setting(run, path) == value and type(get_setting(run, path)) is type(get_setting(RunConfig(), path))


def test_another_agent_brings_its_own_defaults_for_what_is_folded_and_leaves_the_rest() -> None:
    preset = PRESETS["Landing model: 300 balls at 5 m/s"].config
    typed = {("agent",): "ddpg", ("reward", "kind"): "case", ("seeds",): 3}
    assert run_of_form(preset, typed).exploration.random_episodes == 10  # a ddpg that the paper does not know
    run = run_of_form(preset, typed | agent_defaults("ddpg"))
    paper = default_run("ddpg")
    assert (run.exploration, run.ddpg, run.environment.goal) == (paper.exploration, paper.ddpg, paper.environment.goal)
    assert (run.agent, run.reward.kind, run.seeds) == ("ddpg", "case", 3)
    assert run.curriculum.episodes == preset.curriculum.episodes
    assert not agent_defaults("landing-model").keys() & set(MAIN)
    with pytest.raises(ConfigError, match="not offered"):
        agent_defaults("../../etc")


def test_one_number_of_balls_alone_is_for_the_stages_that_there_are() -> None:
    run = run_of_form(default_run("ddpg"), {("curriculum", "episodes"): "70"})
    assert run.curriculum.episodes == (70, 70)


def test_one_number_of_balls_is_for_all_stages() -> None:
    form = {("curriculum", "speeds_mps"): "3 4.5 6", ("curriculum", "episodes"): "100"}
    run = run_of_form(default_run("ddpg"), form)
    assert run.curriculum.episodes == (100, 100, 100)
    by_path = {spec.path: spec for spec in form_specs()}
    assert value_shown(run, by_path[("curriculum", "episodes")]) == "100"
    assert value_shown(run, by_path[("curriculum", "speeds_mps")]) == "3, 4.5, 6"


@pytest.mark.parametrize("path", [*FORM, ("ddpg", "hidden"), ("reward", "scale"), ("reward", "simple_accuracy")])
@pytest.mark.parametrize(
    "value", [None, "../../etc", ["a"], {"a": 1}, float("nan"), float("inf"), -1.5, -1e300, "1" * 13]
)
def test_garbage_is_refused_in_one_line(path, value: object) -> None:
    with pytest.raises(ConfigError) as caught:
        startable_run(run_of_form(default_run("ddpg"), FORM | {path: value}))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


@pytest.mark.parametrize("text", ["", "fast", "3;5", ",".join("3" * 11), "2", "9.5", "nan"])
def test_what_is_no_list_of_speeds_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        run_of_form(default_run("ddpg"), {("curriculum", "speeds_mps"): text, ("curriculum", "episodes"): "10"})


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
