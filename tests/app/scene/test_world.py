"""Words say what is to come, and are not in the ball's way."""

import math

import numpy as np
import pytest

from app.scene.view_camera import ViewCamera
from app.scene.world import apart, note_text


def test_the_time_is_rounded_to_what_can_be_read() -> None:
    assert note_text("bounce", 0.1149) == "bounce in 110 ms" and note_text("hit", 0.004) == "hit in 0 ms"


def test_two_points_are_apart_by_a_share_of_the_picture() -> None:
    eye = ViewCamera(np.zeros(3), np.array([1.0, 0, 0, 0]), 2 * math.atan(0.5))
    assert apart(eye, np.array([0.0, 0, 4]), np.array([1.0, 0, 4])) == pytest.approx(0.25)
    assert apart(eye, np.array([0.0, 0, 4]), np.array([0.0, 0, 9])) == pytest.approx(0.0, abs=1e-6)
