from dataclasses import replace

import numpy as np
import pytest

from benchmarks.rally.closed_loop import ClosedLoop, PlayedBall
from core.cameras import stereo_preset
from core.chain.config import ChainConfig, chain_predictor
from core.live.worlds.world import WorldConfig
from core.physics.episode import Case, Serves
from core.physics.task import task_profile
from core.simulation.episodes.incoming import RecordedServes

BALLS = 2


@pytest.fixture(scope="module")
def played() -> tuple[list[PlayedBall], int]:
    """Some balls at 5 m/s through perception, and the time they took in the world."""
    loop = ClosedLoop(WorldConfig(), stereo_preset(), seed=5)
    try:
        return [loop.play(5.0) for _ in range(BALLS)], loop.world.now_us
    finally:
        loop.close()


def test_balls_are_returned_through_perception_alone(played) -> None:
    balls, _ = played
    assert all(ball.returned for ball in balls)
    assert all(ball.judged.outcome.case is Case.RETURNED for ball in balls)


def test_the_racket_moves_early_and_is_corrected_after_the_bounce(played) -> None:
    for ball in played[0]:
        stages = [command.stage for command in ball.decisions]
        assert stages == sorted(stages, reverse=True), "pre comes before post"
        assert stages.count("pre") >= 5 and stages.count("post") >= 1
        first_post = stages.index("post")
        assert not any(command.action.any() for command in ball.decisions[:first_post])
        assert ball.decisions[-1].action.any()
        assert ball.stage == "post"


def test_the_last_command_expects_the_ball_where_it_comes(played) -> None:
    for ball in played[0]:
        assert ball.aim_error_m < 0.03
        assert abs(ball.decisions[-1].state[:3][0] + 1.42) < 1e-9
        assert ball.aim_error_m == np.linalg.norm(ball.judged.arrival[1:3] - ball.decisions[-1].state[:3][1:3])


def test_a_world_without_enough_light_misses_every_ball_and_says_so() -> None:
    """A ball as dark as the room makes no events: the chain finds nothing, and no command is given."""
    from core.simulation import SceneConfig, StereoConfig

    dark = SceneConfig(ball=0.12, table=0.12, line=0.12, floor=0.12, wall=0.12, net=0.12, ambient=1.0, shadow=0.0)
    loop = ClosedLoop(WorldConfig(stereo=StereoConfig(scene=dark)), stereo_preset(), seed=1)
    try:
        ball = loop.play(5.0)
    finally:
        loop.close()
    assert ball.judged.outcome.case is Case.MISSED
    assert ball.decisions == () and ball.stage == "none" and np.isnan(ball.aim_error_m)


def test_a_recorded_ball_with_spin_comes_back_in_the_fitted_physics() -> None:
    task = task_profile("real")
    topspin = Serves(np.array([[1.2, 0.0, 0.35]]), np.array([[-6.0, 0.1, 0.8]]), np.array([[0.0, -60.0, 0.0]]))
    world = WorldConfig(task=task)
    loop = ClosedLoop(world, stereo_preset(), seed=5, recorded=RecordedServes(topspin, task))
    try:
        ball = loop.play(6.0)
    finally:
        loop.close()
    np.testing.assert_allclose(ball.judged.serve.state, topspin.states()[0])
    assert ball.returned and ball.stage == "post"
    assert ball.aim_error_m < 0.03


def test_points_alone_play_the_chosen_hit_and_a_ball_met_elsewhere_is_measured_there() -> None:
    """No cameras: the ball's true place with noise. At 3 m/s the plane is too low for most balls."""
    loop = ClosedLoop(
        WorldConfig(task=task_profile("real")), stereo_preset(), seed=7, hit="chosen", point_sigma_m=0.0008
    )
    try:
        balls = [loop.play(3.0) for _ in range(2)]
    finally:
        loop.close()
    assert all(ball.returned for ball in balls)
    for ball in balls:
        assert ball.choice is not None and ball.choice.chosen is not None
        met = ball.decisions[-1].state[:3]
        assert ball.aim_error_m < 0.02, "measured where it was met"
        assert np.linalg.norm(ball.judged.arrival[:3] - met) < 0.05
    assert any(abs(ball.decisions[-1].state[0] + 1.42) > 0.05 for ball in balls)


def test_a_ball_that_is_hit_behind_the_plane_arrives_where_it_is_hit() -> None:
    chain = ChainConfig(predictor=replace(chain_predictor(), hit_x_m=-1.6))
    loop = ClosedLoop(WorldConfig(), stereo_preset(), seed=7, chain=chain, point_sigma_m=0.0008)
    try:
        ball = loop.play(5.0)
    finally:
        loop.close()
    assert ball.returned and abs(ball.judged.arrival[0] + 1.6) < 0.02
    assert ball.aim_error_m < 0.02
