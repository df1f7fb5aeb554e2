"""Short simulated clips of one ball with a known centre: what snapping is measured on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.events import Events, SensorSize
from core.geometry import look_at
from core.recordings import PixelTruth
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights.ball_path import BallStates, VisibleRange
from core.simulation.scenes.scene import SceneConfig, scene_named
from core.simulation.sensor.sensor import SensorConfig
from core.simulation.truth import pixel_truth
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

SENSOR = SensorSize(320, 240)
FOCAL_PX = 1000.0
CLIP_US = 60_000
MIDDLE_US = 30_000


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """A ball that flies through the middle of the picture at `MIDDLE_US`."""

    events: Events
    truth: PixelTruth
    """One sample, at `MIDDLE_US`."""
    v_px_per_ms: NDArray[np.float64]
    """(2,)"""


@dataclass(frozen=True, slots=True, eq=False)
class _Throw:
    """A ball that is at `middle` at `MIDDLE_US` and flew freely before and after: no launcher near the picture."""

    middle: NDArray[np.float64]
    velocity: NDArray[np.float64]
    end_s: float = CLIP_US * 1e-6

    @property
    def discontinuities_s(self) -> NDArray[np.float64]:
        return np.empty(0)

    def at(self, t_s: ArrayLike) -> BallStates:
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        since = (t - MIDDLE_US * 1e-6)[:, None]
        drop = np.array([0.0, 0.0, -GRAVITY_MPS2])
        p = self.middle + self.velocity * since + 0.5 * drop * since**2
        return BallStates(t, p, self.velocity + drop * since, np.zeros((len(t), 3)), np.ones(len(t), np.bool_))

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        count = len(np.atleast_1d(np.asarray(t_s)))
        return VisibleRange(np.zeros((count, 3)), np.full(count, -np.inf))


def draw_clip(
    rng: np.random.Generator,
    *,
    speed_mps: float,
    radius_px: float,
    noise_share: float = 0.05,
    scene: str = "ball",
    sensor: SensorConfig | None = None,
) -> Clip:
    """A clip with a ball of this speed and size, a random direction of flight and view, and added noise events.

    Of the events near the ball's way, `noise_share` are noise: uniform in time and place.
    """
    middle = np.array([rng.uniform(-1.0, 1.0), rng.uniform(-0.5, 0.5), 0.45])
    around, down = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 1.0)
    away = np.array([np.cos(around) * np.cos(down), np.sin(around) * np.cos(down), np.sin(down)])
    camera = Camera(
        SENSOR,
        np.array([[FOCAL_PX, 0, 160], [0, FOCAL_PX, 120], [0, 0, 1.0]]),
        np.zeros(5),
        look_at(middle + away * FOCAL_PX * BALL_RADIUS_M / radius_px, middle + rng.normal(0, 0.02, 3)),
    )
    heading = rng.uniform(0, 2 * np.pi)
    velocity = speed_mps * np.array([np.cos(heading), np.sin(heading), rng.uniform(-0.3, 0.3)])
    path = _Throw(middle, velocity)
    look: SceneConfig = scene_named(scene)
    rig = EventCamera(camera, look, sensor or SensorConfig(), rng)
    clean = rig.advance(path, -(-CLIP_US // BLOCK_US) * BLOCK_US)
    truth = pixel_truth(camera, path, [MIDDLE_US])
    near = pixel_truth(camera, path, [MIDDLE_US - 100, MIDDLE_US + 100])
    v = np.array([near.u_px[1] - near.u_px[0], near.v_px[1] - near.v_px[0]]) / 0.2
    return Clip(_with_noise(clean, noise_share, rng), truth, v)


def _with_noise(events: Events, share: float, rng: np.random.Generator) -> Events:
    """Noise in the box that the middle 20 ms of the ball's events take."""
    near = events.between(MIDDLE_US - 10_000, MIDDLE_US + 10_000)
    count = round(share * len(near))
    if not count:
        return events
    low_x, high_x = int(near.x_px.min()), int(near.x_px.max()) + 1
    low_y, high_y = int(near.y_px.min()), int(near.y_px.max()) + 1
    t = np.concatenate([events.t_us, rng.integers(MIDDLE_US - 10_000, MIDDLE_US + 10_000, count)])
    order = np.argsort(t, kind="stable")
    x = np.concatenate([events.x_px, rng.integers(low_x, high_x, count)])[order]
    y = np.concatenate([events.y_px, rng.integers(low_y, high_y, count)])[order]
    on = np.concatenate([events.on, rng.random(count) < 0.5])[order]
    return Events.from_columns(t[order], x, y, on, events.sensor)
