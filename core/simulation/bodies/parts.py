"""Bodies are made of rounded rods and blades, posed in the world at any time.

A rod is all balls whose centres lie between its two ends, with radii that change evenly from one end to the other; a
head is a rod with one end. A blade is a racket's: a cylinder from the middle of its face to the middle of its back.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera

Array = NDArray[np.float64]

ROD, BLADE = 0.0, 1.0
KIND, RADIUS_A, RADIUS_B, REFLECTANCE, TEXTURE, STRIPES_PER_M, BANDS = range(7)
PART_COLUMNS: Final = 7
"""What never changes of a part: kind; radii at its two ends, metres (a blade: the same twice); reflectance; depth of
its texture, 0 to 0.9; waves per metre along it; waves across it."""
NEAREST_M: Final = 0.2
"""A part of which any point is nearer to the camera's plane is left out."""


class MovingBodies(Protocol):
    """All that moves besides the ball and the robot's racket."""

    @property
    def parts(self) -> Array:
        """All parts at a time, as rows (P, PART_COLUMNS)."""
        ...

    def ends(self, t_s: Array) -> Array:
        """(N, P, 2, 3) ends of the parts in the world at the times `t_s` (N,)."""
        ...


class BodyProbes(NamedTuple):
    """The bodies at N instants to one camera; between them everything moves evenly."""

    ends: Array
    """(N, P, 2, 3) in the camera's frame."""
    circles: Array
    """(N, P, 2, 3) pixel and radius in pixels of a circle round each end; radius -1 for a part that is left out."""


def rod(
    radius_a_m: float,
    radius_b_m: float,
    reflectance: float,
    *,
    texture: float = 0.0,
    stripes_per_m: float = 0.0,
    bands: float = 0.0,
) -> Array:
    """A row of PART_COLUMNS.

    Args:
        radius_a_m: at one end.
        radius_b_m: at the other.
        reflectance: share of the light that it gives back.
        texture: depth of its pattern, 0 to 0.9.
        stripes_per_m: waves of the pattern along it.
        bands: waves across it.
    """
    return np.array([ROD, radius_a_m, radius_b_m, reflectance, texture, stripes_per_m, bands])


def blade(radius_m: float, reflectance: float) -> Array:
    """A row of PART_COLUMNS."""
    return np.array([BLADE, radius_m, radius_m, reflectance, 0.0, 0.0, 0.0])


def probe_bodies(camera: Camera, bodies: MovingBodies, t_s: Array) -> BodyProbes:
    """The bodies at the times `t_s` (N,) to a camera."""
    world, radii = bodies.ends(t_s), bodies.parts[:, RADIUS_A : RADIUS_B + 1]
    ends = camera.to_camera(world.reshape(-1, 3)).reshape(world.shape)
    uvs = camera.project_from_camera(ends.reshape(-1, 3)).reshape(*world.shape[:3], 2)
    depth = ends[..., 2]
    there = np.isfinite(uvs).all(axis=(2, 3)) & np.all(depth - radii > NEAREST_M, axis=2)
    r_px = max(camera.K[0, 0], camera.K[1, 1]) * radii / np.maximum(depth - radii, NEAREST_M)
    circles = np.concatenate([np.nan_to_num(uvs), np.where(there[:, :, None], r_px, -1.0)[..., None]], axis=-1)
    return BodyProbes(ends, circles)


def steps_of_fastest(probes: BodyProbes, step_px: float) -> int:
    """How many steps of at most `step_px` the fastest part makes over the probes; at least one."""
    there = (probes.circles[..., 2] >= 0).all(axis=(0, 2))
    moved = np.abs(np.diff(probes.circles[:, there], axis=0))
    return max(1, math.ceil(float(moved.max()) * (len(probes.circles) - 1) / step_px)) if moved.size else 1


def hidden_by_bodies(bodies: MovingBodies, camera_m: Array, ps_world: Array, t_s: Array) -> NDArray[np.bool_]:
    """Whether a body lies between `camera_m` and the points (N, 3) at their times `t_s` (N,).

    Args:
        bodies: the moving bodies.
        camera_m: (3,) place of the camera, world.
        ps_world: (N, 3) points.
        t_s: (N,) their times.
    """
    ends, parts = bodies.ends(t_s), bodies.parts
    to_point = (ps_world - camera_m)[:, None, :]
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(to_point, axis=-1)
        ray = to_point / distance[:, :, None]
        a, d = ends[:, :, 0] - camera_m, ends[:, :, 1] - ends[:, :, 0]
        along_a, along_d = (a * ray).sum(-1), (d * ray).sum(-1)
        across = (d * d).sum(-1) - along_d**2
        share = np.clip((along_a * along_d - (a * d).sum(-1)) / np.maximum(across, 1e-12), 0.0, 1.0)
        near = a + share[..., None] * d
        t = (near * ray).sum(-1)
        gap = np.linalg.norm(near - t[..., None] * ray, axis=-1)
        radius = parts[:, RADIUS_A] + share * (parts[:, RADIUS_B] - parts[:, RADIUS_A])
        # A blade seen on its edge hides less than a ball of its radius.
        axis = d / np.maximum(np.linalg.norm(d, axis=-1, keepdims=True), 1e-9)
        radius = np.where(parts[:, KIND] == BLADE, radius * np.abs((axis * ray).sum(-1)), radius)
        return np.any((gap < radius) & (t > 0) & (t < distance), axis=1)
