"""A rally of two players: every ball bounces once, on the other half, and a racket meets it there."""

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics.config import physics_profile
from core.simulation import LaunchConfig, scene_named
from core.simulation.bodies import make_actors
from core.simulation.bodies.rally_flight import CONTACT_X_M, STROKES, draw_flights
from core.table import BALL_RADIUS_M, NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric
RALLY = scene_named("rally")


def drawn(speed_mps: float = 5.0, rallies: int = 3, seed: int = 4):
    return draw_flights(RALLY, [LaunchConfig(speed_mps=speed_mps)] * rallies, np.random.default_rng(seed))


@pytest.mark.parametrize("speed_mps", [4.0, 6.0, 9.0])
def test_every_ball_bounces_once_on_the_other_half_and_clears_the_net(speed_mps) -> None:
    flights, strokes = drawn(speed_mps)
    assert len(strokes) == 3 * STROKES
    for flight in flights.flights:
        arcs = flight.at(flight.discontinuities_s[:-1])
        hits, bounces = arcs.p_world_m[0::2], arcs.p_world_m[1::2]
        assert len(hits) == len(bounces) == STROKES
        assert (np.sign(bounces[:, 0]) == -np.sign(hits[:, 0])).all()
        np.testing.assert_allclose(np.abs(hits[:, 0]), CONTACT_X_M, atol=1e-6)
        np.testing.assert_allclose(bounces[:, 2], BALL_RADIUS_M, atol=1e-9)
        assert (np.abs(bounces[:, :2]) < [TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2]).all()
        path = flight.at(np.linspace(flight.discontinuities_s[0], flight.end_s - 1e-6, 20_001)).p_world_m
        crossing = np.flatnonzero(np.diff(np.sign(path[:, 0])))
        assert len(crossing) == STROKES and (path[crossing, 2] > NET_HEIGHT_M + BALL_RADIUS_M).all()


def test_the_ball_is_in_one_place_and_turns_at_the_rackets() -> None:
    flights, strokes = drawn()
    for stroke in strokes:
        before, after = flights.at([stroke.t_s - 1e-6, stroke.t_s + 1e-6]).p_world_m
        if np.isfinite(before).all():
            np.testing.assert_allclose(before, after, atol=1e-4)
        np.testing.assert_allclose(after - BALL_RADIUS_M * stroke.normal_world, stroke.p_world_m, atol=1e-4)
    v = flights.flights[0].at(flights.flights[0].discontinuities_s[:-1]).v_world_mps
    assert (np.sign(v[0::2, 0]) == [-1, 1, -1, 1, -1]).all()


def test_the_players_rackets_are_where_the_ball_is_struck() -> None:
    _, strokes = drawn()
    bodies = make_actors(RALLY.cast, 4, strokes)
    assert bodies is not None
    ends = bodies.ends(np.array([stroke.t_s for stroke in strokes]))
    blades = np.where([[stroke.p_world_m[0] > 0] for stroke in strokes], ends[:, 15, 0], ends[:, 31, 0])
    np.testing.assert_allclose(blades, [stroke.p_world_m for stroke in strokes], atol=1e-6)


def test_the_same_seed_is_the_same_rally_and_other_scenes_serve() -> None:
    one, same = drawn(seed=9)[0], drawn(seed=9)[0]
    np.testing.assert_array_equal(one.discontinuities_s, same.discontinuities_s)
    serves, strokes = draw_flights(scene_named("person"), [LaunchConfig()] * 2, np.random.default_rng(1))
    assert strokes == () and len(serves.flights) == 2


def test_what_cannot_be_played_is_said() -> None:
    with pytest.raises(ConfigError, match="can be played at this speed"):
        drawn(speed_mps=3.0)
    with pytest.raises(ConfigError, match="without air"):
        draw_flights(RALLY, [LaunchConfig()], np.random.default_rng(0), physics_profile("real"))
