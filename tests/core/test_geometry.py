"""Transforms and quaternions: their laws, and values known from the definition."""

import numpy as np
import pytest

from core.errors import CalibrationError
from core.geometry import (
    check_transform,
    invert_transform,
    look_at,
    make_transform,
    matrix_from_quaternion,
    quaternion_from_matrix,
    transform_points,
)

pytestmark = pytest.mark.numeric
QUARTER_TURN_Z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def test_a_transform_and_its_inverse_cancel() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        T = make_transform(random_rotation(rng), rng.normal(size=3))
        assert T @ invert_transform(T) == pytest.approx(np.eye(4), abs=1e-12)
        ps = rng.normal(size=(7, 3))
        assert transform_points(invert_transform(T), transform_points(T, ps)) == pytest.approx(ps)


def test_transforms_chain_by_cancelling_neighbours() -> None:
    rng = np.random.default_rng(1)
    T_a_b, T_b_c = (make_transform(random_rotation(rng), rng.normal(size=3)) for _ in range(2))
    p_c = rng.normal(size=3)
    assert transform_points(T_a_b @ T_b_c, p_c) == pytest.approx(transform_points(T_a_b, transform_points(T_b_c, p_c)))


def test_points_keep_their_shape() -> None:
    T = make_transform(QUARTER_TURN_Z, (1, 2, 3))
    assert transform_points(T, [1, 0, 0]) == pytest.approx([1, 3, 3])
    assert transform_points(T, np.zeros((4, 5, 3))).shape == (4, 5, 3)


def test_a_camera_that_looks_along_x_has_its_axes_where_they_belong() -> None:
    T = look_at((-2.0, 0.0, 1.0), (5.0, 0.0, 1.0))
    assert T[:3, 3] == pytest.approx([-2, 0, 1])
    assert T[:3, 2] == pytest.approx([1, 0, 0]), "forward"
    assert T[:3, 0] == pytest.approx([0, -1, 0]), "right of somebody who looks along +x is -y"
    assert T[:3, 1] == pytest.approx([0, 0, -1]), "down"


def test_what_is_looked_at_lies_on_the_axis() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        position, target = rng.normal(size=3), rng.normal(size=3)
        T = check_transform(look_at(position, target), where="test")
        x, y, z = transform_points(invert_transform(T), target)
        assert (x, y) == pytest.approx((0, 0), abs=1e-12) and z == pytest.approx(np.linalg.norm(target - position))


def test_looking_straight_down_has_no_upright() -> None:
    with pytest.raises(CalibrationError, match="straight up or down"):
        look_at((0, 0, 2), (0, 0, 0))


def test_quaternions_are_wxyz() -> None:
    half = np.sqrt(0.5)
    assert quaternion_from_matrix(QUARTER_TURN_Z) == pytest.approx([half, 0, 0, half])
    assert matrix_from_quaternion([half, 0, 0, half]) == pytest.approx(QUARTER_TURN_Z)
    assert quaternion_from_matrix(np.eye(3)) == pytest.approx([1, 0, 0, 0])


def test_matrix_and_quaternion_are_inverse_to_each_other() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        R = random_rotation(rng)
        q = quaternion_from_matrix(R)
        assert q[0] >= 0 and np.linalg.norm(q) == pytest.approx(1)
        assert matrix_from_quaternion(q) == pytest.approx(R)
        assert matrix_from_quaternion(-q) == pytest.approx(R)


@pytest.mark.parametrize(
    "T",
    [
        np.eye(3),
        np.diag([1.0, 1, -1, 1]),
        np.diag([2.0, 2, 2, 1]),
        np.full((4, 4), np.nan),
        np.eye(4) + np.eye(4)[::-1] * 0.1,
        np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]]),
    ],
)
def test_what_is_not_rigid_is_refused_and_named(T: np.ndarray) -> None:
    with pytest.raises(CalibrationError, match=r"the left one: not a (rigid )?transform"):
        check_transform(T, where="the left one")


def test_a_rigid_transform_passes_unchanged_and_as_floats() -> None:
    T = check_transform([[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]], where="here")
    assert T.dtype == np.float64 and np.array_equal(T, make_transform(QUARTER_TURN_Z, (5, 6, 7)))
