"""Words say what is to come, and are not in the ball's way."""

import math

import numpy as np
import pytest

from app.scene.prediction import PLACE_M, PLACES, diamonds
from app.scene.view_camera import ViewCamera
from app.scene.world import apart, note_text


def test_the_time_is_rounded_to_what_can_be_read() -> None:
    assert note_text("bounce", 0.1149) == "bounce in 110 ms" and note_text("hit", 0.004) == "hit in 0 ms"


def test_two_points_are_apart_by_a_share_of_the_picture() -> None:
    eye = ViewCamera(np.zeros(3), np.array([1.0, 0, 0, 0]), 2 * math.atan(0.5))
    assert apart(eye, np.array([0.0, 0, 4]), np.array([1.0, 0, 4])) == pytest.approx(0.25)
    assert apart(eye, np.array([0.0, 0, 4]), np.array([0.0, 0, 9])) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("count", [1, 14, PLACES + 3])
def test_each_place_has_a_diamond_and_there_are_always_as_many_lines(count: int) -> None:
    ps_m = np.random.default_rng(0).normal(size=(count, 3))
    edges = diamonds(ps_m)
    assert edges.shape == (4 * PLACES, 2, 3) and edges.dtype == np.float32
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    shown = 4 * min(count, PLACES)
    np.testing.assert_allclose(lengths[:shown], math.sqrt(2) * PLACE_M, rtol=1e-4)
    assert not lengths[shown:].any()
    np.testing.assert_allclose(edges[:4].mean(axis=(0, 1)), ps_m[0], atol=1e-6)
