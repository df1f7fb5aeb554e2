"""Sightings of simulated serves by cameras of which one was moved by a known amount since they were calibrated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from core.cameras import Camera
from core.cameras.stereo import EpipolarPair
from core.chain.calibration_drift import CalibrationDrift
from core.geometry import make_transform, random_direction
from core.simulation.flights import LaunchConfig, draw_serve_series
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
VOLUME_M: Final = ((-TABLE_LENGTH_M / 2, -TABLE_WIDTH_M / 2, 0.02), (TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2, 0.5))
VOLUME_POINTS: Final = 600
LENGTH_ROUNDS: Final = 4
POINT_EVERY_S: Final = 0.002
STRAY_PX: Final = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SightingNoise:
    """How a detector errs."""

    sigma_px: float = 0.4
    """Along each picture axis, in each window anew."""
    flight_px: float = 0.1
    """The same in a whole flight: what it does wrong with balls that fly so."""
    stray_share: float = 0.03
    """Sightings of something else."""


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


def epipolar_rms_px(true: Mapping[str, Camera], believed: Mapping[str, Camera], ps_world_m: Array) -> float:
    """Root mean square distance of the true pictures of points (N, 3) from the believed epipolar lines."""
    (a, b) = believed
    pair = EpipolarPair(believed[a], believed[b])
    residuals = pair.residuals_px(true[a].project(ps_world_m), true[b].project(ps_world_m))
    return float(np.sqrt(np.mean(np.square(residuals))))


def turn_second(cameras: Mapping[str, Camera], drift_px: float, rng: np.random.Generator) -> dict[str, Camera]:
    """What is believed of a pair whose second camera was turned about a random axis.

    The true pictures of the volume above the table are `drift_px` (rms) off the believed epipolar lines.
    """
    first, second = cameras
    ps = seen_volume(cameras, VOLUME_POINTS, np.random.default_rng(0))
    axis = random_direction(rng)

    def turned(angle_rad: float) -> dict[str, Camera]:
        T = cameras[second].T_world_camera
        R = T[:3, :3] @ Rotation.from_rotvec(angle_rad * axis).as_matrix()
        return {
            first: cameras[first],
            second: replace(cameras[second], T_world_camera=make_transform(R, T[:3, 3])),
        }

    if drift_px == 0:
        return dict(cameras)
    angle_rad = 1e-4
    for _ in range(LENGTH_ROUNDS):  # nearly linear
        angle_rad *= drift_px / epipolar_rms_px(cameras, turned(angle_rad), ps)
    return turned(angle_rad)


def feed_serves(
    monitor: CalibrationDrift,
    true: Mapping[str, Camera],
    serves: int,
    rng: np.random.Generator,
    noise: SightingNoise | None = None,
    *,
    start_us: int = 0,
) -> int:
    """Show a monitor what the true cameras see of random serves of 4 to 8 m/s; returns when the last one ended."""
    noise = noise or SightingNoise()
    configs = [LaunchConfig(speed_mps=float(speed), yaw_spread_deg=6.0) for speed in rng.uniform(4, 8, serves)]
    series = draw_serve_series(configs, rng)
    for flight in series.flights:
        times_s = np.arange(flight.discontinuities_s[0], flight.end_s, POINT_EVERY_S)
        states = flight.at(times_s)
        ps = states.p_world_m[states.present]
        uvs = {name: _sighted(camera, ps, noise, rng) for name, camera in true.items()}
        for row, t_s in enumerate(times_s[states.present]):
            monitor.add_pixels(start_us + round(1e6 * t_s), {name: seen[row] for name, seen in uvs.items()})
    return start_us + round(1e6 * series.end_s)


def _sighted(camera: Camera, ps: Array, noise: SightingNoise, rng: np.random.Generator) -> Array:
    """(N, 2), nan outside the picture."""
    uvs = camera.project(ps)
    uvs = uvs + rng.normal(0, noise.flight_px, 2) + rng.normal(0, noise.sigma_px, uvs.shape)
    strays = rng.random(len(uvs)) < noise.stray_share
    uvs[strays] += rng.normal(0, STRAY_PX, (int(strays.sum()), 2))
    with np.errstate(invalid="ignore"):
        inside = ((uvs >= 0) & (uvs <= (camera.sensor.width_px - 1, camera.sensor.height_px - 1))).all(axis=1)
    uvs[~inside] = np.nan
    return uvs
