"""The baselines that learn play the same balls, and what is kept of them acts as the library's own model does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.config import CurriculumConfig, EnvironmentConfig, RewardConfig, RunConfig, Sb3Config
from core.learning.registered_agents import AgentName
from core.learning.runs.run_files import create_run, load_policy, read_lines, seed_files
from core.learning.runs.running import run_training
from core.learning.runs.sb3_baselines import Sb3Environment, extract_policy, make_model
from core.learning.runs.training import Training
from core.learning.task.environment import evaluation_balls
from core.learning.task.normalise import normal_observations

pytestmark = pytest.mark.numeric
TRUTH = EnvironmentConfig(state_source="truth")


def baseline_run(agent: AgentName, exploration: str = "default") -> RunConfig:
    return RunConfig(
        agent=agent,
        environment=TRUTH,
        reward=RewardConfig(kind="case"),
        rival=Sb3Config(exploration=exploration),  # type: ignore[arg-type]
        curriculum=CurriculumConfig(speeds_mps=(3.0, 5.0), episodes=(50, 50), replay="retain"),
        evaluation_balls=20,
    )


@pytest.mark.parametrize("agent", ["ppo", "a2c", "trpo", "td3", "sac"])
def test_a_baseline_trains_over_the_curriculum_on_the_balls_of_our_agents(agent: AgentName, tmp_path: Path) -> None:
    config = baseline_run(agent)
    create_run(tmp_path / "run", config)
    assert run_training(tmp_path / "run", progress=lambda share: None, stopped=lambda: False) == "finished"
    lines, _ = read_lines(seed_files(tmp_path / "run", 0).metrics)
    assert [line["speed_mps"] for line in lines] == [3.0] * 50 + [5.0] * 50
    ours = Training(RunConfig(environment=TRUTH, curriculum=config.curriculum), 0)
    for line in lines[:3]:
        mine = ours.play_episode()
        assert (mine["serve"], mine["goal_m"]) == (line["serve"], line["goal_m"])
    balls = evaluation_balls(5.0, 10, TRUTH)
    actions = load_policy(tmp_path / "run")(balls.states, balls.racket_speeds_mps, balls.goals_m)
    assert actions.shape == (10, 3) and np.abs(actions).max() <= 1


def test_a_stopped_baseline_says_so_and_begins_its_seed_again(tmp_path: Path) -> None:
    create_run(tmp_path / "run", baseline_run("a2c"))
    asked = iter(range(10**6))
    stopped = run_training(tmp_path / "run", progress=lambda share: None, stopped=lambda: next(asked) == 7)
    begun, _ = read_lines(seed_files(tmp_path / "run", 0).metrics)
    assert stopped == "stopped" and 0 < len(begun) < 20
    assert not seed_files(tmp_path / "run", 0).checkpoint.exists()
    assert run_training(tmp_path / "run", progress=lambda share: None, stopped=lambda: False) == "finished"
    lines, _ = read_lines(seed_files(tmp_path / "run", 0).metrics)
    assert [line["episode"] for line in lines] == list(range(100)) and lines[: len(begun)] == begun


@pytest.mark.parametrize("agent", ["ppo", "td3", "sac"])
def test_gradient_steps_per_ball_are_as_many_as_asked_for(agent: AgentName) -> None:
    def steps_per_ball(updates: int) -> float:
        base = baseline_run(agent, "matched")
        config = replace(base, rival=replace(base.rival, updates_per_episode=updates))
        model = make_model(config, Sb3Environment(config, 0, 0, 0), 0)
        if agent == "ppo":  # a pass over one batch of all its balls is a step
            assert model.batch_size == model.n_steps
            return model.n_epochs / model.n_steps
        return model.gradient_steps

    assert steps_per_ball(4) == 4
    assert steps_per_ball(0) == (0.2 if agent == "ppo" else 1)


@pytest.mark.parametrize("agent", ["ppo", "a2c", "trpo", "td3", "sac"])
def test_the_learning_rate_is_the_one_asked_for(agent: AgentName) -> None:
    def rate(exploration: str, asked: float) -> float:
        base = baseline_run(agent, exploration)
        config = replace(base, rival=replace(base.rival, rate=asked))
        return make_model(config, Sb3Environment(config, 0, 0, 0), 0).learning_rate

    assert rate("default", 0.004) == rate("matched", 0.004) == 0.004
    assert rate("matched", 0.0) == 0.001


@pytest.mark.parametrize("agent", ["a2c", "trpo"])
def test_a_method_of_one_step_refuses_another_number(agent: AgentName) -> None:
    base = baseline_run(agent)
    config = replace(base, rival=replace(base.rival, updates_per_episode=4))
    with pytest.raises(ConfigError, match="one gradient step"):
        make_model(config, Sb3Environment(config, 0, 0, 0), 0)


@pytest.mark.parametrize("exploration", ["default", "matched"])
@pytest.mark.parametrize("agent", ["ppo", "a2c", "trpo", "td3", "sac"])
def test_the_kept_policy_is_the_library_s(agent: AgentName, exploration: str) -> None:
    config = baseline_run(agent, exploration)
    model = make_model(config, Sb3Environment(config, 0, 0, 0), 0)
    policy = extract_policy(model, config)
    balls = evaluation_balls(5.0, 10, TRUTH)
    seen = normal_observations(balls.states, balls.goals_m)
    expected, _ = model.predict(seen, deterministic=True)
    got = policy(balls.states, balls.racket_speeds_mps, balls.goals_m)
    np.testing.assert_allclose(got, expected, atol=1e-5)
