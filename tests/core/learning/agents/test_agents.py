"""Both agents learn, repeat, and go on from a checkpoint as if nothing had happened."""

import dataclasses
import json

import numpy as np
import pytest

from core.learning.agents.policy import read_policy, save_policy
from core.learning.config import (
    CurriculumConfig,
    DdpgConfig,
    EnvironmentConfig,
    ExplorationConfig,
    LandingModelConfig,
    RunConfig,
    default_run,
)
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.registered_agents import AgentName
from core.learning.runs.training import Training
from core.learning.task.environment import evaluation_balls

pytestmark = pytest.mark.numeric
TRUTH = EnvironmentConfig(state_source="truth")


def short_run(agent: AgentName, **changes: object) -> RunConfig:
    curriculum = CurriculumConfig(speeds_mps=(3.0, 5.0), episodes=(45, 40))
    few = LandingModelConfig(updates_per_episode=6)  # as exact as many
    return RunConfig(agent=agent, environment=TRUTH, curriculum=curriculum, landing_model=few, **changes)  # type: ignore[arg-type]


def play_all(training: Training) -> list[dict[str, object]]:
    lines = []
    while not training.finished:
        lines.append(training.play_episode())
    return lines


@pytest.mark.parametrize("agent", ["ddpg", "landing-model"])
@pytest.mark.gate
def test_a_training_goes_on_from_any_checkpoint_bit_for_bit(agent: AgentName) -> None:
    config = short_run(agent)
    whole = Training(config, 3)
    lines = play_all(whole)
    for stop in (20, 45, 60):
        first = Training(config, 3)
        begun = [first.play_episode() for _ in range(stop)]
        second = Training.from_checkpoint(config, 3, *first.to_checkpoint())
        assert begun + play_all(second) == lines
        arrays, expected = second.to_checkpoint()[0], whole.to_checkpoint()[0]
        assert arrays.keys() == expected.keys()
        for name, array in expected.items():
            np.testing.assert_array_equal(arrays[name], array, err_msg=name)


def test_the_landing_model_places_balls_after_fifty_episodes() -> None:
    config = default_run("landing-model")
    config = dataclasses.replace(config, curriculum=CurriculumConfig(speeds_mps=(5.0,), episodes=(50,)))
    training = Training(config, 0)
    play_all(training)
    score = PolicyEvaluator(config.environment, 200).score(training.policy, 5.0)
    assert score.return_rate > 0.95 and score.error_mm < 80


@pytest.mark.parametrize("extra", [DdpgConfig(), DdpgConfig(twin_critics=True, relabels=1)])
@pytest.mark.gate
def test_ddpg_learns_to_return(extra: DdpgConfig) -> None:
    config = RunConfig(
        environment=TRUTH,
        ddpg=dataclasses.replace(extra, updates_per_episode=4),
        exploration=ExplorationConfig(random_episodes=32),
        curriculum=CurriculumConfig(speeds_mps=(4.0,), episodes=(400,)),
    )
    training = Training(config, 1)
    play_all(training)
    evaluator = PolicyEvaluator(TRUTH, 200)
    assert evaluator.score(training.policy, 4.0).return_rate > 0.95
    assert evaluator.score_actions(np.zeros((200, 3)), 4.0).return_rate < 0.8


def test_the_bootstrapped_target_is_another_algorithm() -> None:
    lines = [
        play_all(Training(short_run("ddpg", ddpg=DdpgConfig(target=target)), 0)) for target in ("terminal", "bootstrap")
    ]
    assert lines[0][30]["state"] == lines[1][30]["state"] and lines[0][60]["action"] != lines[1][60]["action"]


def test_the_noise_decays_with_each_episode_of_a_stage_down_to_the_smallest() -> None:
    explore = ExplorationConfig(scale=0.4, decay=0.93, smallest=0.05)
    lines = play_all(Training(short_run("ddpg", exploration=explore), 0))
    stage = [max(0.05, 0.4 * 0.93**n) for n in range(45)]
    assert stage[28] > 0.05 == stage[29]
    np.testing.assert_allclose([line["noise"] for line in lines], stage + stage[:40], atol=1e-6)


def test_the_action_is_the_policys_with_that_noise_and_random_in_the_first_episodes() -> None:
    explore = ExplorationConfig(scale=0.1, decay=1.0, smallest=0.0, random_episodes=15)
    training = Training(short_run("ddpg", exploration=explore, ddpg=DdpgConfig(updates_per_episode=1)), 0)
    noises, drawn = [], []
    for n in range(45):
        balls = training._backend.observe(training._batch[n : n + 1])
        wanted = training._agent.act(balls.states, balls.racket_speeds_mps, balls.goals_m)[0]
        line = training.play_episode()
        assert line["random"] == (n < 15)
        action = np.array(line["action"])
        if n < 15:
            drawn.append(action)
        else:
            noises.append(action - wanted)
    assert 0.07 < np.sqrt(np.mean(np.square(noises))) < 0.13 and np.abs(noises).max() < 0.45
    assert np.abs(drawn).max() > 0.9 and 0.45 < np.std(drawn) < 0.7, "uniform in [-1, 1]: 0.58"


def test_a_stage_ends_when_enough_balls_come_back() -> None:
    curriculum = CurriculumConfig(
        speeds_mps=(5.0, 6.0), episodes=(300, 5), advance="converged", converged_window=20, converged_rate=0.9
    )
    config = dataclasses.replace(default_run("landing-model"), curriculum=curriculum)
    training = Training(config, 0)
    lines = play_all(training)
    first = [line for line in lines if line["stage"] == 0]
    assert 20 <= len(first) < 300
    assert np.mean([line["case"] == 4 for line in first[-20:]]) >= 0.9


def test_the_line_where_a_stage_starts_tells_what_became_of_the_buffer() -> None:
    lines = play_all(Training(short_run("ddpg"), 0))
    returned = sum(line["case"] == 4 for line in lines[:45])
    assert lines[45]["kept"] == returned and lines[45]["dropped"] == 45 - returned
    assert lines[45]["buffer"] == returned + 1
    counts = {
        str(case): sum(line["case"] == case for line in lines[:45]) for case in {line["case"] for line in lines[:45]}
    }
    assert lines[45]["kept_cases"] == {case: [n, 0] if case == "4" else [0, n] for case, n in counts.items()}


def test_what_a_stage_kept_is_not_forgotten_by_a_checkpoint() -> None:
    training = Training(short_run("ddpg"), 0)
    for _ in range(45):
        training.play_episode()
    arrays, about = training.to_checkpoint()
    again = Training.from_checkpoint(short_run("ddpg"), 0, arrays, json.loads(json.dumps(about)))
    line = training.play_episode()
    assert "kept_cases" in line and again.play_episode() == line
    del about["kept_cases"]  # as an earlier version wrote it
    before = Training.from_checkpoint(short_run("ddpg"), 0, arrays, json.loads(json.dumps(about))).play_episode()
    assert "kept_cases" not in before and before["kept"] == line["kept"]


@pytest.mark.parametrize("agent", ["ddpg", "landing-model"])
def test_a_saved_policy_acts_as_the_agent_does(agent: AgentName, tmp_path) -> None:
    training = Training(short_run(agent), 0)
    for _ in range(60):
        training.play_episode()
    save_policy(training.policy, tmp_path / "policy.safetensors")
    policy = read_policy(tmp_path / "policy.safetensors")
    balls = evaluation_balls(5.0, 20, TRUTH)
    expected = training._agent.act(balls.states, balls.racket_speeds_mps, balls.goals_m)
    np.testing.assert_allclose(policy(balls.states, balls.racket_speeds_mps, balls.goals_m), expected, atol=1e-5)
    alone = policy.act(balls.states[0], balls.goals_m[0])
    assert policy.racket_speed_mps(balls.states[0]) == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(alone, expected[0], atol=0.02)  # the racket speed is read off the ball
