"""Rigid transforms and rotations. `T_a_b` maps coordinates in b to a; quaternions are unit wxyz, local to parent."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import CalibrationError

Array = NDArray[np.float64]


def make_transform(R: ArrayLike, t: ArrayLike) -> Array:
    """The (4, 4) rigid transform with rotation `R` (3, 3) and translation `t` (3,)."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = t
    return T


def random_direction(rng: np.random.Generator) -> Array:
    """(3,) a unit vector, all of them alike probable."""
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def invert_transform(T: ArrayLike) -> Array:
    """`T_b_a` from a rigid `T_a_b` (4, 4)."""
    T = np.asarray(T, np.float64)
    R_inverse = T[:3, :3].T
    return make_transform(R_inverse, -R_inverse @ T[:3, 3])


def transform_points(T_a_b: ArrayLike, ps_b: ArrayLike) -> Array:
    """Points (..., 3) given in b, in a."""
    T = np.asarray(T_a_b, np.float64)
    return np.asarray(ps_b, np.float64) @ T[:3, :3].T + T[:3, 3]


FARTHEST_M: Final = 1e9
"""Nothing is farther away; sums of powers of it stay far from what a number can hold."""


def check_transform(T: ArrayLike, *, where: str) -> Array:
    """`T` as a float64 (4, 4) array if it is rigid.

    Raises:
        CalibrationError: if the shape, the last row or the orthonormality is wrong.
    """
    T = np.asarray(T, np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all() or np.abs(T).max() > FARTHEST_M:
        raise CalibrationError(
            "not a transform", expected=f"a (4, 4) matrix of numbers up to {FARTHEST_M:g}", got=T.shape, where=where
        )
    R = T[:3, :3]
    rigid = np.abs(R).max() < 2 and np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0
    if not rigid or not np.allclose(T[3], (0, 0, 0, 1)):
        raise CalibrationError("not a rigid transform", expected="a rotation and a last row of 0 0 0 1", where=where)
    return T


def look_at(position_world: ArrayLike, target_world: ArrayLike) -> Array:
    """`T_world_camera` (4, 4) of an upright camera (x right, y down, z forward) that looks at a point.

    Raises:
        CalibrationError: if the view is straight up or down, where upright means nothing.
    """
    position = np.asarray(position_world, np.float64)
    forward = np.asarray(target_world, np.float64) - position
    right = np.cross(forward, (0.0, 0.0, 1.0))
    if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(forward))):
        raise CalibrationError("an upright camera cannot look straight up or down", got=f"{position} to {target_world}")
    forward /= np.linalg.norm(forward)
    right /= np.linalg.norm(right)
    R_world_camera = np.stack([right, np.cross(forward, right), forward], axis=1)
    return make_transform(R_world_camera, position)


def quaternion_from_matrix(R: ArrayLike) -> Array:
    """Unit quaternion wxyz (w >= 0) of a rotation matrix (3, 3)."""
    R = np.asarray(R, np.float64)
    products = np.empty((4, 4))  # 4 q q^T: every row is q times one of its parts
    products[0] = 1.0 + np.trace(R), R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    products[1:, 0] = products[0, 1:]
    products[1:, 1:] = R + R.T + (1.0 - np.trace(R)) * np.eye(3)
    q = products[np.argmax(np.diag(products))]  # the largest part: nothing small is divided by
    q = q / np.linalg.norm(q)
    return -q if q[0] < 0 else q


def matrix_from_quaternion(q_wxyz: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a quaternion wxyz."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = np.asarray(q_wxyz, np.float64)
    return Rotation.from_quat([x, y, z, w]).as_matrix()


def xyzw_from_wxyz(qs_wxyz: ArrayLike) -> Array:
    """Quaternions (..., 4) in the order of Rerun and SciPy."""
    return np.roll(np.asarray(qs_wxyz, np.float64), -1, axis=-1)
