"""A ball that is played again ends as it did in the training."""

import math

import numpy as np
import pytest

from app.shared.training_records import LONGEST_S, ball_of_line, replay_ball
from app.shared.workspace import Workspace
from core.learning.agents.agent import Losses
from core.learning.config import EnvironmentConfig
from core.learning.evaluation.policy_evaluator import episode_line
from core.learning.randomisation import RandomisationConfig
from core.learning.runs.run_files import load_policy, read_lines, read_run, seed_files
from core.learning.task.environment import draw_serve_batch, play
from core.learning.task.reward import Weights
from core.physics.episode import Case
from core.table import BALL_RADIUS_M


@pytest.fixture(scope="module")
def lines(trained: Workspace) -> list[dict]:
    return read_lines(seed_files(trained.run_path("small"), 0).metrics)[0]


@pytest.fixture(scope="module")
def environment(trained: Workspace):
    return read_run(trained.run_path("small")).environment


def test_case_and_error_are_those_of_the_record(lines, environment) -> None:
    for line in lines:
        replay = replay_ball(ball_of_line(line), environment, None, "")
        assert replay.case == line["case"]
        assert replay.error_mm == pytest.approx(line["error_mm"], abs=0.05)


def test_a_returned_ball_comes_down_where_the_record_says(lines, environment) -> None:
    line = next(line for line in lines if line["case"] == Case.RETURNED)
    replay = replay_ball(ball_of_line(line), environment, None, "")
    landing = [event for event in replay.path.events if event.kind == "bounce"][1]
    assert landing.state[:2] == pytest.approx(line["landing_m"], abs=1e-4)
    assert landing.t_s < replay.duration_s <= LONGEST_S + 1


def test_a_ball_of_a_world_of_its_own_is_played_again_in_that_world() -> None:
    randomise = RandomisationConfig(physics=True, latency=True, rubber=True, calibration=True)
    environment = EnvironmentConfig(state_source="truth", racket="uncertain", randomise=randomise)
    for n in range(3):
        ball = draw_serve_batch(5.0, 1, environment, np.random.default_rng(n))
        action = np.array([0.0, 0.1, -0.2])
        line = episode_line(
            episode=n, stage=0, stage_episode=n, batch=ball, action=action, noise=0.1, is_random=False,
            outcome=play(ball, action[None], environment), reward=0.0, weights=Weights(1.0, 0.0), buffer=0, kept=None,
            losses=Losses(math.nan, math.nan),
        )  # fmt: skip
        replay = replay_ball(ball_of_line(line), environment, None, "")
        assert replay.case == line["case"] and replay.error_mm == pytest.approx(line["error_mm"], abs=0.05)
        usual = replay_ball(ball_of_line({**line, "constants": [0.0, 0.9, 0.15, 0.78, 0.0]}), environment, None, "")
        assert usual.error_mm != pytest.approx(line["error_mm"], abs=0.5)
        damaged = ball_of_line({**line, "constants": [9.0, -9.0, 9.0, 0.5, 0.5]})
        replay_ball(damaged, environment, None, "")  # its constants are cut off at their bounds


def test_the_racket_touches_the_ball_at_the_impact(lines, environment) -> None:
    replay = replay_ball(ball_of_line(lines[-1]), environment, None, "")
    hit = next(event for event in replay.path.events if event.kind == "hit")
    near = min(np.linalg.norm(hit.state[:3] - pose.p_world_m) for pose in replay.rackets)
    assert near == pytest.approx(BALL_RADIUS_M, abs=0.02)  # a pose every 1/60 s, at about 1 m/s
    assert replay.target is not None
    assert np.linalg.norm(hit.state[:3] - replay.target.p_world_m) == pytest.approx(BALL_RADIUS_M, abs=1e-3)


def test_the_picture_follows_the_ball_and_stops_at_the_end(lines, environment) -> None:
    replay = replay_ball(ball_of_line(lines[-1]), environment, None, "")
    start, end = replay.picture(0.0, ()), replay.picture(1e9, ())
    assert start.ball == pytest.approx(lines[-1]["serve"][:3])
    assert end.ball == pytest.approx(replay.path.at(replay.duration_s)[:3])
    assert replay.picture(0.3, ()).trail[-1] == pytest.approx(replay.path.at(0.3)[:3])
    assert start.landing_target == pytest.approx(lines[-1]["goal_m"])


def test_a_policy_plays_the_same_serve_without_noise(trained: Workspace, lines, environment) -> None:
    ball = ball_of_line(lines[-1])
    assert ball is not None
    policy = load_policy(trained.run_path("small"), 0)
    replay = replay_ball(ball, environment, policy, "")
    assert replay.path.at(0.2) == pytest.approx(replay_ball(ball, environment, None, "").path.at(0.2))
    assert replay.case == Case.RETURNED and replay.error_mm != pytest.approx(lines[-1]["error_mm"])


def test_a_ball_that_nobody_saw_is_missed(lines, environment) -> None:
    ball = ball_of_line(lines[-1] | {"state": [None] * 6})
    assert ball is not None
    replay = replay_ball(ball, environment, None, "")
    assert replay.case == Case.MISSED and math.isnan(replay.error_mm) and replay.target is None


@pytest.mark.parametrize("change", [{"serve": [1.0]}, {"action": None}, {"goal_m": [None, 0.0]}, {"episode": "x"}])
def test_a_line_that_does_not_tell_enough_is_no_ball(lines, change: dict) -> None:
    assert ball_of_line(lines[-1] | change) is None
    assert ball_of_line({}) is None
