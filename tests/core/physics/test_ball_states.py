"""Ball states of human play: read, turned into the world frame, and told by what they do before the robot."""

import json
from pathlib import Path

import numpy as np
import pytest

from core.errors import ConfigError, RecordingError
from core.physics import Serves
from core.physics.ball_states import KEYS, join_serves, read_ball_states, write_ball_states
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves, fly_serves
from core.simulation.episodes.incoming import Incoming, RecordedServes, fly_incoming

pytestmark = pytest.mark.numeric
REAL = task_profile("real")
PAPER = task_profile("paper")
STATE = dict(zip(KEYS, (0.1, 1.2, 0.3, -0.2, -5.0, 1.0, 30.0, 4.0, -7.0), strict=True))


def written(path: Path, *states: dict[str, float]) -> Path:
    path.write_text(json.dumps([{"id": number, **state} for number, state in enumerate(states)]))
    return path


def test_a_state_is_turned_so_that_the_robot_plays_at_negative_x(tmp_path: Path) -> None:
    found = read_ball_states(written(tmp_path / "a.json", STATE))
    np.testing.assert_allclose(found.ps_m[0], [1.2, -0.1, 0.3])
    np.testing.assert_allclose(found.vs_mps[0], [-5.0, 0.2, 1.0])
    np.testing.assert_allclose(found.spins_radps[0], [4.0, -30.0, -7.0])


def test_what_is_written_is_read_as_it_was_with_where_it_is_from(tmp_path: Path) -> None:
    states = np.arange(18.0).reshape(2, 9) / 10 * np.array([1, 1, 1, -1, 1, 1, 1, 1, 1])
    serves = Serves(states[:, :3], states[:, 3:6], states[:, 6:])
    write_ball_states(tmp_path / "a.json", serves, [{"name": "one", "t_us": 2**53 + 1}, {"name": "two", "t_us": None}])
    np.testing.assert_allclose(read_ball_states(tmp_path / "a.json").states(), states)
    assert json.loads((tmp_path / "a.json").read_text())[0]["t_us"] == 2**53 + 1
    with pytest.raises(RecordingError, match="cannot write"):
        write_ball_states(tmp_path, serves, [{}, {}])


def test_a_ball_that_flies_the_other_way_is_turned_half_round_and_does_the_same(tmp_path: Path) -> None:
    turned = STATE | {key: -STATE[key] for key in KEYS if not key.endswith("z")}
    one, other = (read_ball_states(written(tmp_path / "a.json", state)) for state in (STATE, turned))
    np.testing.assert_allclose(one.states(), other.states())


def test_topspin_stays_topspin() -> None:
    """In the file a ball that flies to -y has topspin when it turns about +x: its upper side goes ahead."""
    states = np.array([[1.0, 0.0, 0.4, -5.0, 0.0, 1.0, 0.0, spin, 0.0] for spin in (-100.0, 100.0)])
    balls = fly_incoming(Serves(states[:, :3], states[:, 3:6], states[:, 6:]), REAL)
    topspin, backspin = balls.arrivals.bounce_t_s
    assert topspin < backspin, "topspin pulls it down"


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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON"),
        ("{}", "no list of ball states"),
        ("[]", "no list of ball states"),
        ("[" * 100_000, "not JSON"),
        ("[3]", "not a ball state"),
        ('[{"pos_x": 1}]', "not a ball state"),
        (json.dumps([STATE | {"pos_x": "0.1"}]), "not a ball state"),
        (json.dumps([STATE | {"pos_x": True}]), "not a ball state"),
        (json.dumps([STATE, STATE | {"vel_y": float("nan")}]), "state 1: no possible ball"),
        (json.dumps([STATE | {"pos_z": 50.0}]), "no possible ball"),
        (json.dumps([STATE | {"vel_x": 10**400}]), "no possible ball"),
    ],
)
def test_what_is_no_list_of_ball_states_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=message) as error:
        read_ball_states(path)
    assert "bad.json" in str(error.value) and "\n" not in str(error.value) and len(str(error.value)) < 700


@pytest.mark.parametrize(
    ("keys", "largest"),
    [(("pos_x",), 5.0), (("pos_z",), 5.0), (("vel_x", "vel_y"), 40.0), (("w_vel_y", "w_vel_z"), 1500.0)],
)
def test_a_ball_may_be_at_the_limit_of_what_is_possible_but_not_beyond(
    tmp_path: Path, keys: tuple[str, ...], largest: float
) -> None:
    """Of a position each coordinate counts, of a velocity and a spin the length."""
    still = dict.fromkeys(KEYS, 0.0)
    share = (-0.6, 0.8) if len(keys) == 2 else (-1.0,)
    for factor in (1.0, 1.001):
        state = still | {key: part * largest * factor for key, part in zip(keys, share, strict=True)}
        path = written(tmp_path / "a.json", STATE, state)
        if factor == 1.0:
            assert len(read_ball_states(path)) == 2
        else:
            with pytest.raises(RecordingError, match="state 1: no possible ball"):
                read_ball_states(path)


def test_a_missing_or_too_large_file_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot read"):
        read_ball_states(tmp_path / "none.json")
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate((64 << 20) + 1)
    with pytest.raises(RecordingError, match="too large"):
        read_ball_states(large)


def test_most_recorded_states_cross_the_net_and_bounce_once_before_the_robot(shared_data: Path) -> None:
    folder = shared_data / "trajectories"
    rally, service = (read_ball_states(folder / f"deepmind_{name}_ball_states.json") for name in ("rally", "serve"))
    assert (len(rally), len(service), len(join_serves([rally, service]))) == (13_088, 2_704, 15_792)
    in_play, served = fly_incoming(rally, REAL), fly_incoming(service, REAL)
    assert np.mean(in_play.incoming == Incoming.PLAYABLE) > 0.85
    assert in_play.is_service.mean() < 0.01 and served.is_service.mean() > 0.99
    assert np.mean(served.incoming == Incoming.PLAYABLE) > 0.55
