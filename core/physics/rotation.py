"""Actions as racket orientations: q = q_base qx(a1) qy(a2) qz(a3), intrinsic x-y-z, unit quaternions wxyz.

The racket's frame has its origin in the middle of the face and its x axis along the face's normal, so a1 turns the face
about its normal, a positive a2 tilts it down, a positive a3 turns it to the left.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.physics.task import StrokeConfig

Array = NDArray[np.float64]


def multiply_quaternions(a: ArrayLike, b: ArrayLike) -> Array:
    """The product a b of quaternions (..., 4) wxyz: first b turns, then a."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    product = np.empty(np.broadcast(a, b).shape)  # stacking four columns would take longer than computing them
    aw, ax, ay, az = (a[..., k] for k in range(4))
    bw, bx, by, bz = (b[..., k] for k in range(4))
    product[..., 0] = aw * bw - ax * bx - ay * by - az * bz
    product[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    product[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    product[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return product


def axis_quaternion(axis: int, angle_rad: ArrayLike) -> Array:
    """The rotation (..., 4) wxyz about coordinate axis 0, 1 or 2."""
    half = np.asarray(angle_rad, np.float64) / 2
    q = np.zeros((*half.shape, 4))
    q[..., 0] = np.cos(half)
    q[..., 1 + axis] = np.sin(half)
    return q


def base_orientation(stroke: StrokeConfig) -> Array:
    """The racket's orientation (4,) for action zero. Tilting the normal up is a negative turn about y."""
    return axis_quaternion(1, -math.radians(stroke.base_pitch_deg))


def orientations_from_actions(actions: ArrayLike, stroke: StrokeConfig) -> Array:
    """Racket orientations (..., 4) wxyz of actions (..., 3), clipped to [-1, 1]."""
    angles = np.clip(np.asarray(actions, np.float64), -1, 1) * math.radians(stroke.action_limit_deg)
    q = multiply_quaternions(base_orientation(stroke), axis_quaternion(0, angles[..., 0]))
    q = multiply_quaternions(q, axis_quaternion(1, angles[..., 1]))
    return multiply_quaternions(q, axis_quaternion(2, angles[..., 2]))


def normals_from_orientations(qs_wxyz: ArrayLike) -> Array:
    """The faces' outward normals (..., 3): the x axes of the racket frames in the world."""
    q = np.asarray(qs_wxyz, np.float64)
    w, x, y, z = (q[..., k] for k in range(4))
    normals = np.empty((*q.shape[:-1], 3))
    normals[..., 0] = 1 - 2 * (y * y + z * z)
    normals[..., 1] = 2 * (x * y + w * z)
    normals[..., 2] = 2 * (x * z - w * y)
    return normals
