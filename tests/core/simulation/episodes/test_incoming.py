"""Struck balls, drawn or recorded, are told by what they do before the robot."""

from pathlib import Path

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics import Serves
from core.physics.ball_states import join_serves, read_ball_states
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves, fly_serves
from core.simulation.episodes.incoming import Incoming, RecordedServes, fly_incoming

pytestmark = pytest.mark.numeric
REAL = task_profile("real")
PAPER = task_profile("paper")


def test_topspin_pulls_a_ball_down() -> None:
    """A ball that flies to -x has topspin when it turns about -y: its upper side goes ahead."""
    states = np.array([[1.0, 0.0, 0.4, -5.0, 0.0, 1.0, 0.0, spin, 0.0] for spin in (-100.0, 100.0)])
    balls = fly_incoming(Serves(states[:, :3], states[:, 3:6], states[:, 6:]), REAL)
    topspin, backspin = balls.arrivals.bounce_t_s
    assert topspin < backspin


def ball(p: tuple[float, ...], v: tuple[float, ...]) -> Serves:
    return Serves(np.array([p]), np.array([v]), np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("balls", "incoming", "is_service"),
    [
        (ball((0.7, 0.1, 0.46), (-5.0, 0.0, 0.0)), Incoming.PLAYABLE, False),
        (ball((1.2, 0.1, 0.25), (-4.0, 0.0, -2.0)), Incoming.PLAYABLE, True),
        (ball((1.0, 0.0, 0.1), (-5.0, 0.0, 0.8)), Incoming.NET, False),
        (ball((1.0, 0.0, 0.5), (-9.0, 0.0, 1.0)), Incoming.NO_BOUNCE, False),
        (ball((1.0, 0.0, 0.5), (-4.0, 3.0, 1.0)), Incoming.NO_BOUNCE, False),
        (ball((1.0, 0.0, 0.3), (-1.0, 0.0, 0.0)), Incoming.FAR_HALF, True),
        (ball((0.2, 0.0, 0.5), (-1.2, 0.0, 1.0)), Incoming.TWO_BOUNCES, False),
        (ball((0.5, 0.0, 0.5), (-1.6, 1.2, 1.0)), Incoming.SHORT, False),
    ],
)
def test_each_ball_is_told_by_what_it_does(balls: Serves, incoming: Incoming, is_service: bool) -> None:
    found = fly_incoming(balls, PAPER)
    assert (Incoming(found.incoming[0]), bool(found.is_service[0])) == (incoming, is_service)
    assert found.arrivals.legal[0] == (incoming is Incoming.PLAYABLE) == np.isfinite(found.arrivals.states[0]).all()


def test_drawn_serves_are_playable_and_arrive_as_the_task_says() -> None:
    serves = draw_serves(5.0, 40, REAL, np.random.default_rng(2))
    arrivals, found = fly_serves(serves, REAL), fly_incoming(serves, REAL)
    assert (found.incoming == Incoming.PLAYABLE).all() and not found.is_service.any()
    np.testing.assert_array_equal(found.arrivals.states, arrivals.states)
    np.testing.assert_array_equal(found.arrivals.bounce_states, arrivals.bounce_states)


def test_recorded_serves_are_playable_have_about_the_speed_asked_for_and_follow_the_seed() -> None:
    rng = np.random.default_rng(0)
    legal = [draw_serves(speed, 20, REAL, rng) for speed in (4.0, 5.0, 6.0)]
    recorded = RecordedServes(join_serves([ball((1.0, 0.0, 0.1), (-5.0, 0.0, 0.8)), *legal]), REAL)
    assert len(recorded.balls) == 60, "the one into the net is not served"
    drawn = [recorded.draw(5.1, np.random.default_rng(seed)) for seed in range(30)]
    assert {round(float(np.linalg.norm(one.vs_mps)), 6) for one in drawn} == {5.0}
    assert len({tuple(one.ps_m[0]) for one in drawn}) > 10
    np.testing.assert_array_equal(drawn[3].states(), recorded.draw(5.1, np.random.default_rng(3)).states())
    assert np.linalg.norm(recorded.draw(9.0, rng).vs_mps) == pytest.approx(6.0), "the nearest there is"
    with pytest.raises(ConfigError, match="playable"):
        RecordedServes(ball((1.0, 0.0, 0.1), (-5.0, 0.0, 0.8)), REAL)


def test_most_recorded_states_cross_the_net_and_bounce_once_before_the_robot(shared_data: Path) -> None:
    folder = shared_data / "trajectories"
    rally, service = (read_ball_states(folder / f"deepmind_{name}_ball_states.json") for name in ("rally", "serve"))
    assert (len(rally), len(service), len(join_serves([rally, service]))) == (13_088, 2_704, 15_792)
    in_play, served = fly_incoming(rally, REAL), fly_incoming(service, REAL)
    assert np.mean(in_play.incoming == Incoming.PLAYABLE) > 0.85
    assert in_play.is_service.mean() < 0.01 and served.is_service.mean() > 0.99
    assert np.mean(served.incoming == Incoming.PLAYABLE) > 0.55
