"""A ball swung on a thread through the play volume, and what calibrated cameras would report of any ball's path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.cameras.calibration.point_track import PointTrack
from core.cameras.calibration.table_corners import CORNERS, Clicks
from core.simulation.flights.ball_path import BallPath, BallStates, VisibleRange
from core.simulation.truth import pixel_truth

Array = NDArray[np.float64]

STRAY_PX: Final = 60.0
"""Spread of detections that are none of the ball."""


@dataclass(frozen=True, slots=True)
class BallSwing:
    """A Lissajous figure through most of the volume over the robot's half, up to 5 m/s, in all directions."""

    end_s: float
    middle_m: tuple[float, float, float] = (-0.6, 0.0, 0.36)
    reach_m: tuple[float, float, float] = (0.6, 0.45, 0.28)
    turns_hz: tuple[float, float, float] = (0.83, 1.13, 1.57)
    phases_rad: tuple[float, float, float] = (0.0, 0.4, 1.1)

    @property
    def discontinuities_s(self) -> Array:
        """It is there from the start to the end."""
        return np.array([0.0, self.end_s])

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        rate = 2 * np.pi * np.array(self.turns_hz)
        angle = t[:, None] * rate + np.array(self.phases_rad)
        p = np.array(self.middle_m) + np.array(self.reach_m) * np.sin(angle)
        v = np.array(self.reach_m) * rate * np.cos(angle)
        present = (t >= 0) & (t < self.end_s)
        p[~present], v[~present] = np.nan, np.nan
        return BallStates(t, p, v, np.zeros_like(p), present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """Nothing ever hides the swept ball."""
        count = len(np.atleast_1d(np.asarray(t_s)))
        return VisibleRange(np.zeros((count, 3)), np.full(count, -np.inf))


def seen_by(
    camera: Camera,
    path: BallPath,
    rng: np.random.Generator,
    *,
    noise_px: float,
    clock_ahead_us: int = 0,
    stray_share: float = 0.0,
    lead_px: float = 0.0,
    every_us: int = 2000,
) -> PointTrack:
    """What a detector with independent errors would say: outline centres with noise, some of them astray.

    `lead_px` puts all of them ahead of the ball along its motion.
    """
    t_us = np.arange(every_us, int(path.end_s * 1e6), every_us, dtype=np.int64)
    truth = pixel_truth(camera, path, t_us - clock_ahead_us)
    later = pixel_truth(camera, path, t_us - clock_ahead_us + 100)
    motion = np.column_stack([later.u_px - truth.u_px, later.v_px - truth.v_px])
    ahead = lead_px * motion / np.linalg.norm(motion, axis=1, keepdims=True) if lead_px else 0.0
    uvs = np.column_stack([truth.u_px, truth.v_px]) + ahead + rng.normal(0, noise_px, (len(t_us), 2))
    stray = rng.uniform(size=len(t_us)) < stray_share
    uvs[stray] += rng.normal(0, STRAY_PX, (int(stray.sum()), 2))
    return PointTrack.of(t_us, uvs)


def click_corners(cameras: Mapping[str, Camera], rng: np.random.Generator, sigma_px: float) -> dict[str, Clicks]:
    """Every named point of the table that is in a picture, clicked with an error."""
    clicks = {}
    for name, camera in cameras.items():
        uvs = camera.project(np.array(list(CORNERS.values())))
        size = (camera.sensor.width_px, camera.sensor.height_px)
        with np.errstate(invalid="ignore"):
            inside = (uvs > 0).all(axis=1) & (uvs < size).all(axis=1)
        names = tuple(corner for corner, there in zip(CORNERS, np.asarray(inside).tolist(), strict=True) if there)
        clicks[name] = Clicks(names, uvs[inside] + rng.normal(0, sigma_px, (len(names), 2)))
    return clicks
