"""A ball's shadow lies below it, on what is below it."""

import numpy as np
import pytest

from app.scene.ball import ABOVE_FLOOR_M, ABOVE_TABLE_M, OWN_RADII, WIDER, shadow_of
from core.table import BALL_RADIUS_M, TABLE_HEIGHT_M


def test_over_the_table_it_lies_on_the_table() -> None:
    shadow = shadow_of(np.array([-0.8, 0.3, 0.25]), BALL_RADIUS_M)
    assert (shadow.x_m, shadow.y_m, shadow.z_m) == (-0.8, 0.3, ABOVE_TABLE_M)
    assert shadow.radius_m == pytest.approx(OWN_RADII * 0.02 + WIDER * 0.25)


@pytest.mark.parametrize("p", [(1.6, 0.0, 0.2), (0.0, -0.9, 0.2), (0.3, 0.2, -0.4)])
def test_beside_or_below_the_table_it_lies_on_the_floor(p) -> None:
    assert shadow_of(np.array(p), BALL_RADIUS_M).z_m == pytest.approx(ABOVE_FLOOR_M - TABLE_HEIGHT_M)


def test_a_higher_ball_has_a_wider_and_fainter_shadow() -> None:
    shadows = [shadow_of(np.array([0.0, 0.0, z]), BALL_RADIUS_M) for z in (0.02, 0.2, 0.6)]
    assert [shadow.strength for shadow in shadows] == [0, 1, 2]
    assert shadows[0].radius_m < shadows[1].radius_m < shadows[2].radius_m
