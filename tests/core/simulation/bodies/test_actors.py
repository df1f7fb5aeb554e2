"""The bones keep their lengths, the racket meets the ball, and people without a ball repeat themselves."""

import numpy as np
import pytest

from core.simulation.bodies import make_actors
from core.simulation.bodies.actors import (
    CYCLE_S,
    FLOOR_M,
    FOREARM_M,
    SHIN_M,
    THIGH_M,
    UPPER_ARM_M,
    Clothes,
    PlayerStroke,
    person_parts,
)
from core.simulation.bodies.parts import BANDS, PART_COLUMNS, STRIPES_PER_M, TEXTURE
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric
TIMES_S = np.linspace(0.0, CYCLE_S, 4001)
GRIP, BLADE = 14, 15
"""The last parts of a player."""


@pytest.mark.parametrize("cast", ["person", "two-persons", "rally", "head"])
def test_every_cast_has_parts_with_finite_ends_that_move(cast) -> None:
    bodies = make_actors(cast, 1)
    assert bodies is not None
    ends = bodies.ends(TIMES_S)
    assert bodies.parts.shape == (ends.shape[1], PART_COLUMNS)
    assert np.isfinite(ends).all() and (np.ptp(ends[:, :, 0], axis=0).max(axis=1) > 0.01).all()
    assert (ends[..., 2] > FLOOR_M).all()


@pytest.mark.parametrize("cast", ["person", "two-persons", "rally"])
def test_bones_keep_their_lengths(cast) -> None:
    bodies = make_actors(cast, 2)
    assert bodies is not None
    lengths = np.linalg.norm(np.diff(bodies.ends(TIMES_S)[:, :14], axis=2)[:, :, 0], axis=2)
    for first, length in ((4, UPPER_ARM_M), (6, FOREARM_M), (8, THIGH_M), (10, SHIN_M)):
        np.testing.assert_allclose(lengths[:, first : first + 2], length, atol=1e-6)


def test_limbs_hang_together_and_nobody_stands_in_the_table() -> None:
    bodies = make_actors("rally", 3)
    assert bodies is not None
    ends = bodies.ends(TIMES_S)
    for player in (ends[:, :16], ends[:, 16:]):
        for upper, lower in ((4, 6), (5, 7), (8, 10), (9, 11)):
            np.testing.assert_allclose(player[:, upper, 1], player[:, lower, 0], atol=1e-9)
        trunk = player[:, 2, 0]
        inside = (np.abs(trunk[:, 0]) < TABLE_LENGTH_M / 2) & (np.abs(trunk[:, 1]) < TABLE_WIDTH_M / 2)
        assert not inside.any()


def test_clothes_and_skin_have_a_pattern_that_events_can_see_move() -> None:
    """Waves along a part and across it; hair has none along, shoes, grip and blade have none at all."""
    rows = person_parts(Clothes(shirt=0.5, shorts=0.1, texture=0.4), with_racket=True)
    depth, along, across = rows[:, TEXTURE], rows[:, STRIPES_PER_M], rows[:, BANDS]
    hair, plain = 1, slice(12, 16)
    assert (depth[plain] == 0).all() and (along[plain] == 0).all() and (across[plain] == 0).all()
    assert (depth[:12] > 0).all() and (across[:12] >= 1).all() and (np.delete(along[:12], hair) >= 5).all()
    assert depth[2] == 0.4 and (depth[3:12] == 0.2).all(), "half as deep on limbs"
    for pair in range(4, 14, 2):
        np.testing.assert_array_equal(rows[pair], rows[pair + 1])
    assert len(person_parts(Clothes(shirt=0.5, shorts=0.1), with_racket=False)) == 14


def test_the_blade_meets_the_ball_of_a_rally_and_faces_as_it_should() -> None:
    normal = np.array([-0.9, 0.1, 0.3]) / np.linalg.norm([-0.9, 0.1, 0.3])
    strokes = [PlayerStroke(1.0 + 1.1 * k, np.array([1.55, 0.1 * k, 0.25]), normal) for k in range(3)]
    bodies = make_actors("rally", 1, strokes)
    assert bodies is not None
    grip, ends = np.moveaxis(bodies.ends(np.array([stroke.t_s for stroke in strokes]))[:, GRIP : BLADE + 1], 1, 0)
    np.testing.assert_allclose(ends[:, 0], [stroke.p_world_m for stroke in strokes], atol=1e-9)
    hand_m, end_m = np.linalg.norm(grip - ends[:, :1], axis=2).T
    assert (hand_m - end_m > 0.05).all(), "the grip goes from the hand to the blade"
    axis = ends[:, 0] - ends[:, 1]
    np.testing.assert_allclose(axis / np.linalg.norm(axis, axis=1, keepdims=True), [normal] * 3, atol=1e-9)


def test_the_same_seed_gives_the_same_motion_which_repeats_itself() -> None:
    one, same, other = make_actors("person", 5), make_actors("person", 5), make_actors("person", 6)
    assert one is not None and same is not None and other is not None
    np.testing.assert_array_equal(one.ends(TIMES_S), same.ends(TIMES_S))
    assert np.abs(one.ends(TIMES_S) - other.ends(TIMES_S)).max() > 0.05
    np.testing.assert_allclose(one.ends(TIMES_S[:200]), one.ends(TIMES_S[:200] + CYCLE_S), atol=1e-6)


def test_a_swing_is_as_fast_as_a_drive_and_nothing_jumps() -> None:
    bodies = make_actors("person", 5)
    assert bodies is not None
    t_s = np.arange(0.0, CYCLE_S, 0.002)
    speeds = np.linalg.norm(np.diff(bodies.ends(t_s)[:, :, 0], axis=0), axis=2) / 0.002
    assert 2.0 < speeds[:, BLADE].max() < 12.0 and speeds.max() < 15.0
