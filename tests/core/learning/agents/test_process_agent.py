"""The landing model as a Gaussian process: what a ball tells, what is learned of the stroke, what the actor becomes."""

import dataclasses

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.agents.agent import StageProgress
from core.learning.agents.policy import read_policy, save_policy
from core.learning.agents.process_agent import (
    FEATURES,
    GaussianProcessModel,
    ProcessAgent,
    _process_of,
    landings_of,
    stroke_inputs,
    velocities_after,
)
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import EnvironmentConfig, LandingModelConfig, RunConfig, default_run
from core.learning.evaluation.policy_evaluator import landing_errors_mm, really_seen, transition_of
from core.learning.runs.training import Training
from core.learning.task.environment import ServeBatch, draw_serve_batch, evaluation_balls, play
from core.learning.task.reward import Weights
from core.physics.episode import Outcomes

pytestmark = pytest.mark.numeric
ENVIRONMENT = EnvironmentConfig(state_source="truth")


def process_run(**changes: object) -> RunConfig:
    base = default_run("landing-model")
    return dataclasses.replace(base, landing_model=LandingModelConfig(head="process"), **changes)  # type: ignore[arg-type]


def struck(count: int, seed: int) -> tuple[ServeBatch, np.ndarray, Outcomes]:
    """Balls of 5 m/s with random strokes."""
    rng = np.random.default_rng(seed)
    balls = draw_serve_batch(5.0, count, ENVIRONMENT, rng)
    actions = rng.uniform(-1, 1, (count, 3))
    return balls, actions, play(balls, actions, ENVIRONMENT)


def known_of(balls: ServeBatch, actions: np.ndarray, outcomes: Outcomes) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and velocities of those that crossed the net and came down."""
    known = really_seen(outcomes).all(axis=1)
    velocities = velocities_after(balls.states, outcomes.landings_m, outcomes.net_z_m)[known]
    return stroke_inputs(balls.states, balls.racket_speeds_mps, actions)[known], velocities


def buffer_of(balls: ServeBatch, actions: np.ndarray, outcomes: Outcomes) -> ReplayBuffer:
    buffer = ReplayBuffer(len(balls))
    for n in range(len(balls)):
        one = balls[n : n + 1]
        buffer.add(transition_of(one, actions[n], play(one, actions[n : n + 1], ENVIRONMENT), 0.0))
    return buffer


def test_landing_and_height_at_the_net_tell_how_the_ball_left_the_racket() -> None:
    balls, _, outcomes = struck(200, 1)
    known = really_seen(outcomes).all(axis=1)
    told = velocities_after(balls.states, outcomes.landings_m, outcomes.net_z_m)
    assert known.sum() > 100
    np.testing.assert_allclose(told[known], outcomes.hit_states[known, 3:6], atol=1e-6)
    np.testing.assert_allclose(landings_of(balls.states, told)[known], outcomes.landings_m[known], atol=1e-6)
    assert np.isnan(velocities_after(balls.states[:1], np.array([[-0.5, 0.0]]), np.array([0.3]))).all()


def test_some_fifty_returned_balls_teach_the_law_of_reflection_for_every_stroke() -> None:
    process = GaussianProcessModel(*known_of(*struck(80, 2)))
    inputs, velocities = known_of(*struck(200, 3))
    predicted, slopes = process(inputs)
    assert np.median(np.linalg.norm(predicted - velocities, axis=1)) < 0.01  # m/s, of 5
    assert process.noise_mps <= 1e-2
    for k in (0, 1):
        moved = inputs.copy()
        moved[:, 4 + k] += 1e-5
        np.testing.assert_allclose((process(moved)[0] - predicted) / 1e-5, slopes[:, :, k], atol=1e-3)


def test_noise_is_learned_and_a_stroke_that_went_wrong_is_left_out() -> None:
    inputs, velocities = known_of(*struck(120, 4))
    rng = np.random.default_rng(0)
    assert GaussianProcessModel(inputs, velocities + rng.normal(0, 0.1, velocities.shape)).noise_mps == 0.1
    wrong = velocities.copy()
    wrong[7] += (2.0, -1.0, 0.0)
    clean, spoilt = GaussianProcessModel(inputs, velocities), GaussianProcessModel(inputs, wrong)
    assert spoilt.noise_mps == clean.noise_mps
    others = np.arange(len(inputs)) != 7
    np.testing.assert_allclose(spoilt(inputs[others])[0], velocities[others], atol=0.02)


def test_balls_that_did_not_come_down_behind_the_net_teach_nothing() -> None:
    balls, actions, outcomes = struck(40, 5)
    buffer = buffer_of(balls, actions, outcomes)
    whole = _process_of(buffer)
    known = really_seen(outcomes).all(axis=1)
    assert whole is not None and (~known).sum() > 0
    buffer.keep(np.logical_not(known))
    assert _process_of(buffer) is None
    agent = ProcessAgent(process_run(), np.random.default_rng(0))
    agent.learn(buffer, StageProgress(0, 0.0, Weights(0.0, 1.0)), np.random.default_rng(0))
    assert not agent.act(balls.states, balls.racket_speeds_mps, balls.goals_m).any()  # neutral


def error_mm(training: Training) -> float:
    balls = evaluation_balls(5.0, 200, ENVIRONMENT)
    actions = training.policy(balls.states, balls.racket_speeds_mps, balls.goals_m)
    return float(landing_errors_mm(play(balls, actions, ENVIRONMENT), balls.goals_m).mean())


def test_forty_balls_are_enough_for_a_centimetre() -> None:
    training = Training(process_run(), seed=100)
    for _ in range(40):
        training.play_episode()
    assert error_mm(training) < 12  # 25 are aimed at; 4 to 5 mm in 20 seeds


def test_a_training_goes_on_from_its_checkpoint_to_the_bit(check_it_goes_on_to_the_bit) -> None:
    check_it_goes_on_to_the_bit(process_run(), before=18, later=6)


def test_its_policy_is_one_as_any_other(tmp_path) -> None:
    training = Training(process_run(), 1)
    for _ in range(25):
        training.play_episode()
    save_policy(training.policy, tmp_path / "policy.safetensors")
    policy, balls = (
        read_policy(tmp_path / "policy.safetensors"),
        draw_serve_batch(5.0, 50, ENVIRONMENT, np.random.default_rng(0)),
    )
    assert policy.layers[0][0].shape == (9, FEATURES) and policy.sees_racket_speed
    known = balls.states, balls.racket_speeds_mps, balls.goals_m
    np.testing.assert_allclose(policy(*known), training._agent.act(*known), atol=1e-3)


def test_it_is_refused_where_it_knows_too_little() -> None:
    spin = dataclasses.replace(ENVIRONMENT, state="spin")
    for environment in (spin, dataclasses.replace(ENVIRONMENT, racket="chosen")):
        with pytest.raises(ConfigError, match="head process"):
            process_run(environment=environment)
