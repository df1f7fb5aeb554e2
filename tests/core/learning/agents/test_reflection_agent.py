"""The landing model told the law of reflection: its numbers, what it believes of states, what its actor becomes."""

import dataclasses

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.agents.agent import StageProgress
from core.learning.agents.policy import read_policy, save_policy
from core.learning.agents.reflection_agent import FEWEST_BALLS, ReflectionAgent, ReflectionModel, StatePosterior
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import EnvironmentConfig, LandingModelConfig, RunConfig, default_run, environment_profile
from core.learning.evaluation.policy_evaluator import landing_errors_mm
from core.learning.runs.training import Training
from core.learning.task.environment import ServeBatch, draw_serve_batch, play, validation_balls
from core.learning.task.reward import Weights
from core.physics.episode import Outcomes

pytestmark = pytest.mark.numeric
TRUTH = environment_profile(serves="hard", state_source="truth")
NOISY = environment_profile(serves="hard", state_source="truth+noise")


def reflection_run(environment: EnvironmentConfig, speed_mps: float, **changes: object) -> RunConfig:
    base = default_run("landing-model")
    curriculum = dataclasses.replace(base.curriculum, speeds_mps=(speed_mps,), episodes=(200,))
    model = LandingModelConfig(head="reflection")
    return dataclasses.replace(base, environment=environment, curriculum=curriculum, landing_model=model, **changes)  # type: ignore[arg-type]


def struck(count: int, seed: int) -> tuple[ServeBatch, np.ndarray, Outcomes]:
    """Hard serves of 9 m/s with random strokes."""
    rng = np.random.default_rng(seed)
    balls = draw_serve_batch(9.0, count, TRUTH, rng)
    actions = rng.uniform(-1, 1, (count, 3))
    return balls, actions, play(balls, actions, TRUTH)


def law_of(balls: ServeBatch, actions: np.ndarray, velocities: np.ndarray) -> ReflectionModel:
    return ReflectionModel(balls.states, balls.racket_speeds_mps, actions, velocities, TRUTH.task.stroke)


def test_the_law_s_numbers_are_those_of_the_rubber_and_hold_for_other_strokes() -> None:
    balls, actions, outcomes = struck(60, 1)
    law = law_of(balls, actions, outcomes.hit_states[:, 3:6])
    # Of a hollow ball that sticks, 0.6 of the speed along the rubber is left, and the simulator gives back 0.78.
    np.testing.assert_allclose(law.numbers[:2], [0.6, TRUTH.task.physics.rubber.restitution], atol=0.01)
    others, theirs, expected = struck(200, 2)
    predicted = law(others.states, others.racket_speeds_mps, theirs)
    assert np.median(np.linalg.norm(predicted - expected.hit_states[:, 3:6], axis=1)) < 0.02  # m/s, of 5


def test_a_stroke_that_went_wrong_moves_no_number() -> None:
    balls, actions, outcomes = struck(60, 3)
    velocities = outcomes.hit_states[:, 3:6]
    wrong = velocities.copy()
    wrong[7] += (2.0, -1.0, 0.0)
    others = np.arange(60) != 7
    without = law_of(balls[others], actions[others], velocities[others])
    np.testing.assert_allclose(law_of(balls, actions, wrong).numbers, without.numbers, atol=1e-9)


def test_states_are_believed_nearer_to_the_truth_than_they_are_perceived() -> None:
    balls = draw_serve_batch(9.0, 3000, NOISY, np.random.default_rng(4))
    belief = StatePosterior(balls.states[:200], NOISY)
    truth = balls.arrivals.observations[200:]
    perceived_off = (balls.states[200:] - truth).std(axis=0)[1:]
    believed_off = (belief(balls.states[200:]) - truth).std(axis=0)[1:]
    assert (believed_off < 1.01 * perceived_off).all()
    assert believed_off[4] < 0.92 * perceived_off[4]  # where the ball is tells how it rises


def test_a_state_is_taken_as_it_is_where_no_noise_is_told_or_few_balls_are_known() -> None:
    balls = draw_serve_batch(9.0, 50, NOISY, np.random.default_rng(5))
    few = StatePosterior(balls.states[: FEWEST_BALLS - 1], NOISY)
    np.testing.assert_array_equal(few(balls.states), balls.states)
    np.testing.assert_array_equal(StatePosterior(balls.states, TRUTH)(balls.states), balls.states)
    exact = dataclasses.replace(NOISY, position_noise_m=0.0, velocity_noise=0.0)
    np.testing.assert_allclose(StatePosterior(balls.states, exact)(balls.states), balls.states, atol=1e-12)


def test_noise_alone_is_believed_to_be_one_ball() -> None:
    noise = np.random.default_rng(6).normal(0.0, 0.003, (400, 6)) + np.array([-1.42, 0.1, 0.2, -8.0, 0.5, 1.7])
    believed = StatePosterior(noise, NOISY)(noise)
    assert (np.abs(believed - noise.mean(axis=0))[:, 1:].max(axis=0) < 0.0005).all()


def error_mm(training: Training) -> float:
    environment = training.config.environment
    balls = validation_balls(training.speed_mps, 300, environment)
    actions = training.policy(balls.states, balls.racket_speeds_mps, balls.goals_m)
    return float(landing_errors_mm(play(balls, actions, environment), balls.goals_m).mean())


def test_sixty_noisy_balls_are_enough_to_come_near_what_noise_alone_costs() -> None:
    training = Training(reflection_run(NOISY, 9.0), seed=100)
    for _ in range(60):
        training.play_episode()
    assert error_mm(training) < 78  # perfect knowledge that trusts the perceived states: 60 to 65


def test_a_training_goes_on_from_its_checkpoint_to_the_bit(check_it_goes_on_to_the_bit) -> None:
    check_it_goes_on_to_the_bit(reflection_run(NOISY, 9.0), before=26, later=5)


def test_its_policy_is_one_as_any_other(tmp_path) -> None:
    training = Training(reflection_run(TRUTH, 5.0), 1)
    for _ in range(25):
        training.play_episode()
    save_policy(training.policy, tmp_path / "policy.safetensors")
    policy, balls = (
        read_policy(tmp_path / "policy.safetensors"),
        draw_serve_batch(5.0, 50, TRUTH, np.random.default_rng(0)),
    )
    known = balls.states, balls.racket_speeds_mps, balls.goals_m
    np.testing.assert_allclose(policy(*known), training._agent.act(*known), atol=1e-3)


def test_without_a_ball_behind_the_net_it_stays_neutral() -> None:
    agent = ReflectionAgent(reflection_run(TRUTH, 9.0), np.random.default_rng(0))
    balls, _, _ = struck(10, 7)
    agent.learn(ReplayBuffer(10), StageProgress(0, 0.0, Weights(0.0, 1.0)), np.random.default_rng(0))
    assert not agent.act(balls.states, balls.racket_speeds_mps, balls.goals_m).any()


def test_it_is_refused_where_it_knows_too_little() -> None:
    spin = dataclasses.replace(TRUTH, state="spin")
    for environment in (spin, dataclasses.replace(TRUTH, racket="chosen")):
        with pytest.raises(ConfigError, match="head reflection"):
            reflection_run(environment, 5.0)
