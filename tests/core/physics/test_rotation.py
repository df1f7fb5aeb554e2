"""Actions, orientations and normals against SciPy and against plain words."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.physics.rotation import (
    base_orientation,
    multiply_quaternions,
    normals_from_orientations,
    orientations_from_actions,
)
from core.physics.task import StrokeConfig

pytestmark = pytest.mark.numeric


def test_actions_are_intrinsic_x_y_z_angles_after_the_base() -> None:
    stroke = StrokeConfig(base_pitch_deg=7.0)
    actions = np.random.default_rng(1).uniform(-1, 1, (50, 3))
    ours = orientations_from_actions(actions, stroke)
    base = Rotation.from_euler("Y", -7.0, degrees=True)
    theirs = base * Rotation.from_euler("XYZ", actions * 15.0, degrees=True)
    x, y, z, w = theirs.as_quat().T
    expected = np.stack([w, x, y, z], axis=1)
    assert np.abs((ours * expected).sum(axis=1)) == pytest.approx(np.ones(50))
    assert normals_from_orientations(ours) == pytest.approx(theirs.apply([1, 0, 0]))


def test_the_base_pitch_tilts_the_face_up() -> None:
    normal = normals_from_orientations(base_orientation(StrokeConfig(base_pitch_deg=10.0)))
    assert normal == pytest.approx([math.cos(math.radians(10)), 0, math.sin(math.radians(10))])


def test_the_second_angle_tilts_down_the_third_turns_left_and_the_first_changes_no_normal() -> None:
    normals = normals_from_orientations(orientations_from_actions(np.eye(3), StrokeConfig()))
    tilt = math.radians(15)
    assert normals[0] == pytest.approx([1, 0, 0])
    assert normals[1] == pytest.approx([math.cos(tilt), 0, -math.sin(tilt)])
    assert normals[2] == pytest.approx([math.cos(tilt), math.sin(tilt), 0])


def test_actions_beyond_one_are_clipped() -> None:
    stroke = StrokeConfig()
    assert orientations_from_actions([2, -3, 9], stroke) == pytest.approx(orientations_from_actions([1, -1, 1], stroke))


def test_a_quaternion_times_its_conjugate_is_one() -> None:
    q = np.random.default_rng(2).normal(size=(10, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    assert multiply_quaternions(q, q * [1, -1, -1, -1]) == pytest.approx(np.tile([1.0, 0, 0, 0], (10, 1)))
