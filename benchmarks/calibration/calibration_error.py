"""What an error of the calibration does to positions in space: cameras perturbed at random by a known amount."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from core.cameras import Camera, StereoRig
from core.geometry import make_transform
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
Part = Literal["pose", "lens", "both"]

VOLUME_M: Final = (
    (-TABLE_LENGTH_M / 2, -TABLE_WIDTH_M / 2, 0.02),
    (TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2, 0.5),
)
"""Above the table, as high as most balls fly."""
LENS_UNKNOWNS: Final = 8
"""fx, fy, cx, cy and k1, k2, p1, p2."""
TINY: Final = 1e-5
ROUNDS: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class SpaceErrors:
    """Errors of N positions, metres."""

    depth_m: Array
    """Along the line from the middle between the cameras, absolute."""
    lateral_m: Array
    """Across it."""

    @property
    def whole_m(self) -> Array:
        """Distances of whole positions from the truth, in metres."""
        return np.hypot(self.depth_m, self.lateral_m)


def seen_volume(cameras: Mapping[str, Camera], count: int, rng: np.random.Generator) -> Array:
    """Points (K, 3) spread evenly over the volume above the table, of `count` those that all cameras see."""
    ps = rng.uniform(*VOLUME_M, (count, 3))
    seen = np.ones(count, np.bool_)
    for camera in cameras.values():
        uvs = camera.project(ps)
        size = np.array([camera.sensor.width_px, camera.sensor.height_px])
        with np.errstate(invalid="ignore"):
            seen &= ((uvs > -0.5) & (uvs < size - 0.5)).all(axis=1)
    return ps[seen]


def perturb(camera: Camera, ps: Array, rms_px: float, part: Part, rng: np.random.Generator) -> Camera:
    """The camera with errors that move the pictures of points (N, 3) by `rms_px`.

    The direction is random, every unknown weighed by what it does to the picture: a rotation, a shift of the optical
    centre and a change of a lens coefficient contribute alike.
    """
    if rms_px == 0:
        return camera
    before = camera.project(ps)

    def moved_px(step: Array) -> float:
        return float(np.sqrt(np.square(_moved(camera, step).project(ps) - before).sum(axis=1).mean()))

    unknowns = {"pose": range(6), "lens": range(6, 6 + LENS_UNKNOWNS), "both": range(6 + LENS_UNKNOWNS)}[part]
    step = np.zeros(6 + LENS_UNKNOWNS)
    for unknown in unknowns:
        alone = np.zeros_like(step)
        alone[unknown] = TINY
        step[unknown] = rng.normal() * TINY / moved_px(alone)
    for _ in range(ROUNDS):  # nearly linear: a few corrections of the length are enough
        step *= rms_px / moved_px(step)
    return _moved(camera, step)


def _moved(camera: Camera, step: Array) -> Camera:
    """Rotation (3,) rad, position (3,) m, then relative focal lengths, principal point / 1000 px, and coefficients."""
    T = camera.T_world_camera
    K = camera.K.copy()
    K[0, 0] *= 1 + step[6]
    K[1, 1] *= 1 + step[7]
    K[:2, 2] += 1000.0 * step[8:10]
    distortion = camera.distortion.copy()
    distortion[:4] += step[10:14]
    R = T[:3, :3] @ Rotation.from_rotvec(step[:3]).as_matrix()
    return replace(camera, K=K, distortion=distortion, T_world_camera=make_transform(R, T[:3, 3] + step[3:6]))


def space_errors(
    true: Mapping[str, Camera],
    believed: Mapping[str, Camera],
    ps: Array,
    noise_px: float,
    rng: np.random.Generator,
) -> SpaceErrors:
    """Errors of points (N, 3) that the true cameras see, with noise, and the believed ones triangulate."""
    uvs = np.stack([camera.project(ps) for camera in true.values()], axis=1)
    found = StereoRig(believed).triangulate(uvs + rng.normal(0, noise_px, uvs.shape)).ps_world_m
    middle = np.mean([camera.position_world_m for camera in true.values()], axis=0)
    ahead = (ps - middle) / np.linalg.norm(ps - middle, axis=1, keepdims=True)
    off = found - ps
    depth = np.einsum("ij,ij->i", off, ahead)
    return SpaceErrors(np.abs(depth), np.linalg.norm(off - depth[:, None] * ahead, axis=1))
