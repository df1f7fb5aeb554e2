"""The one-step task: the same through every engine, deterministic, and honest about what was seen."""

import dataclasses
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from core.learning.config import EnvironmentConfig, GoalConfig, environment_profile
from core.learning.evaluation.policy_evaluator import landing_errors_mm, really_seen
from core.learning.gym_environment import OneStepReturn, register_environment
from core.learning.task.environment import draw_goals, draw_serve_batch, evaluation_balls, play
from core.physics.episode import Case

pytestmark = pytest.mark.numeric
TRUTH = EnvironmentConfig(state_source="truth")


@pytest.mark.parametrize("source", ["truth", "truth+noise"])
def test_mujoco_and_the_closed_form_play_the_same_episodes(source: str) -> None:
    config = environment_profile("paper", serves="hard", state_source=source)  # type: ignore[arg-type]
    config = dataclasses.replace(config, actuator_error_deg=1.0)
    rng = np.random.default_rng(0)
    for speed in (3.0, 6.0, 9.0):
        balls = draw_serve_batch(speed, 12, config, rng)
        actions = rng.uniform(-1, 1, (12, 3))
        ours = play(balls, actions, config)
        theirs = play(balls, actions, dataclasses.replace(config, engine="mujoco"))
        np.testing.assert_array_equal(ours.case, theirs.case)
        np.testing.assert_allclose(ours.landings_m, theirs.landings_m, atol=1e-3)


def test_every_ball_is_played_on_its_own() -> None:
    rng = np.random.default_rng(1)
    balls = draw_serve_batch(5.0, 20, TRUTH, rng)
    actions = rng.uniform(-1, 1, (20, 3))
    together = play(balls, actions, TRUTH)
    for i in range(20):
        alone = play(balls[i : i + 1], actions[i : i + 1], TRUTH)
        assert alone.case[0] == together.case[i]
        np.testing.assert_array_equal(alone.landing_states[0], together.landing_states[i])


def test_the_evaluation_balls_of_a_speed_are_always_the_same() -> None:
    a, b = (evaluation_balls(4.0, 30, TRUTH) for _ in range(2))
    np.testing.assert_array_equal(a.serves.states(), b.serves.states())
    np.testing.assert_array_equal(a.goals_m, b.goals_m)
    assert not np.array_equal(a.states, evaluation_balls(5.0, 30, TRUTH).states)


def test_goals_are_spread_over_the_box_or_fixed_in_its_middle() -> None:
    rng = np.random.default_rng(0)
    goals = draw_goals(5000, GoalConfig(), rng)
    assert goals.min(0) == pytest.approx([0.45, -0.45], abs=0.01) and goals.max(0) == pytest.approx(
        [1.1, 0.45], abs=0.01
    )
    fixed = draw_goals(3, GoalConfig(kind="fixed"), rng)
    np.testing.assert_array_equal(fixed, [[0.775, 0.0]] * 3)
    off_centre = 1000 * np.hypot(*(goals - GoalConfig().centre_m).T).mean()
    assert off_centre == pytest.approx(298, abs=6)  # what hitting only the middle is worth


def test_noise_is_as_large_as_it_says_and_leaves_the_hitting_plane_where_it_is() -> None:
    config = dataclasses.replace(TRUTH, state_source="truth+noise", position_noise_m=0.005, velocity_noise=0.01)
    balls = draw_serve_batch(5.0, 4000, config, np.random.default_rng(2))
    off = balls.states - balls.arrivals.observations
    speed = np.linalg.norm(balls.arrivals.states[:, 3:6], axis=1, keepdims=True)
    assert np.all(off[:, 0] == 0)
    assert off[:, 1:3].std(0) == pytest.approx([0.005, 0.005], rel=0.1)
    assert (off[:, 3:] / speed).std(0) == pytest.approx([0.01] * 3, rel=0.1)
    assert balls.aim_t_s is not None
    late_m = (balls.aim_t_s - balls.arrivals.t_s) * np.abs(balls.arrivals.states[:, 3])
    assert late_m.std() == pytest.approx(0.005, rel=0.1)


def test_an_actuator_bias_moves_every_landing() -> None:
    rng = np.random.default_rng(3)
    balls = draw_serve_batch(5.0, 50, TRUTH, rng)
    biased = dataclasses.replace(balls, action_errors=np.full((50, 3), 1 / 15))
    moved = play(biased, np.zeros((50, 3)), TRUTH).landings_m - play(balls, np.zeros((50, 3)), TRUTH).landings_m
    distance_mm = 1000 * np.hypot(*moved.T)
    assert 40 < np.median(distance_mm) < 200  # a degree is 64 to 98 mm in pitch, and yaw adds


def test_only_what_happened_before_the_first_contact_counts_as_seen() -> None:
    rng = np.random.default_rng(4)
    balls = draw_serve_batch(4.0, 3000, TRUTH, rng)
    outcomes = play(balls, rng.uniform(-1, 1, (3000, 3)), TRUTH)
    seen = really_seen(outcomes)
    case = outcomes.case
    assert set(np.unique(case)) >= {Case.OWN_HALF, Case.NET, Case.OUT, Case.RETURNED}
    assert seen[case == Case.RETURNED].all()
    net = seen[case == Case.NET]
    assert not net[:, 0].any() and net[:, 1].all()
    own = outcomes.contact_states[:, 0] < -0.01
    assert not seen[own & (case == Case.OWN_HALF), 1].any()
    on_top = (case == Case.OWN_HALF) & (np.abs(outcomes.contact_states[:, 2] - 0.02) < 1e-9)
    assert on_top.any() and seen[on_top, 0].all()


def test_gymnasium_accepts_the_environment() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        environment = gymnasium.make(register_environment())
        check_env(environment.unwrapped)


def test_the_gymnasium_form_gives_the_outcomes_of_the_vectorised_one() -> None:
    balls = draw_serve_batch(5.0, 10, TRUTH, np.random.default_rng(5))
    environment = OneStepReturn(batch=balls)
    actions = np.random.default_rng(6).uniform(-1, 1, (10, 3))
    outcomes = play(balls, np.float32(actions).astype(np.float64), TRUTH)
    errors = landing_errors_mm(outcomes, balls.goals_m)
    for i in range(10):
        environment.reset()
        _, _, terminated, truncated, about = environment.step(np.float32(actions[i]))
        assert terminated and not truncated
        assert about["case"] == outcomes.case[i]
        assert about["error_mm"] == pytest.approx(errors[i])


def test_a_ball_that_is_not_where_it_was_expected_is_missed() -> None:
    config = dataclasses.replace(TRUTH, state_source="truth+noise", position_noise_m=0.1, velocity_noise=0.0)
    balls = draw_serve_batch(5.0, 300, config, np.random.default_rng(7))
    outcomes = play(balls, np.zeros((300, 3)), config)
    off_m = np.hypot(*(balls.states - balls.arrivals.observations)[:, 1:3].T)
    missed = outcomes.case == Case.MISSED
    assert missed[off_m > 0.12].all() and not missed[off_m < 0.05].any()
    assert np.isnan(landing_errors_mm(outcomes, balls.goals_m)[missed]).all()
    assert not really_seen(outcomes)[missed].any()
