"""What is wrong between a simulated world and who plays in it: late stamps, a lamp, a blocked camera, late commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.robustness.cells import Cell
from core.cameras import Camera
from core.events import Events
from core.geometry import random_direction
from core.live.worlds.world import SimulatedWorld
from core.physics.rotation import multiply_quaternions
from core.simulation.episodes.racket import RacketTarget

LAMP_HZ: Final = 100.0
LAMP_RADIUS_PX: Final = 40
SWING_US: Final = 1000
"""Within so much the lamp's pixels answer a rise or a fall."""
EARLIEST_S, LATEST_S = 0.05, 0.35
"""After the serve a camera is blocked some time in between."""


class WrongWires:
    """Errors of one session, drawn as a cell specifies."""

    def __init__(self, cell: Cell, cameras: Mapping[str, Camera], rng: np.random.Generator) -> None:
        self._cell, self._rng = cell, rng
        self._names = sorted(cameras)
        self._late = str(rng.choice(self._names))
        self._held: dict[str, Events] = {}
        self._lamps = {name: self._lamp(camera) for name, camera in cameras.items()} if cell.lamp else {}
        self._blocked, self._blocked_us = "", (0, 0)
        self._tilt = np.array([1.0, 0.0, 0.0, 0.0])

    def begin_ball(self, served_us: int) -> None:
        """Draw what is another with every ball."""
        start_us = served_us + round(1e6 * self._rng.uniform(EARLIEST_S, LATEST_S))
        self._blocked = str(self._rng.choice(self._names))
        self._blocked_us = start_us, start_us + round(1e3 * self._cell.blocked_ms)
        self._tilt = _turn(self._cell.racket_deg, self._rng).as_quat(scalar_first=True)

    def seen(self, events: Mapping[str, Events], start_us: int, end_us: int) -> Mapping[str, Events]:
        """What of a block's events comes through, by camera."""
        found = dict(events)
        for name, lamp in self._lamps.items():
            found[name] = _joined(found[name], self._flicker(lamp, found[name], start_us, end_us))
        low_us, high_us = self._blocked_us
        if self._blocked in found and low_us < end_us and start_us < high_us:
            one = found[self._blocked]
            found[self._blocked] = _joined(one.between(start_us, low_us), one.between(high_us, end_us))
        if self._cell.clock_ms and self._late in found:
            late = _later(found[self._late], round(1e3 * self._cell.clock_ms))
            held = self._held.get(self._late)
            whole = late if held is None else _joined(held, late)
            self._held[self._late] = whole.between(end_us, 1 << 62)
            found[self._late] = whole.between(start_us, end_us)
        return found

    def command(self, world: SimulatedWorld, target: RacketTarget) -> None:
        """Give the racket a target: tilted, and so much later as commands take.

        Raises:
            ConfigError: if it is out of bounds.
        """
        cell = self._cell
        late_s = 1e-3 * max(0.0, cell.latency_ms + self._rng.uniform(-1.0, 1.0) * cell.jitter_ms)
        q = multiply_quaternions(self._tilt, target.q_wxyz)
        world.aim(replace(target, q_wxyz=q, t_s=target.t_s + late_s), after_s=late_s)

    def _lamp(self, camera: Camera) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Its pixels in a picture."""
        r, sensor = LAMP_RADIUS_PX, camera.sensor
        u = int(self._rng.integers(r, sensor.width_px - r))
        v = int(self._rng.integers(r, sensor.height_px - r))
        y, x = np.mgrid[-r : r + 1, -r : r + 1]
        inside = x * x + y * y <= r * r
        return u + x[inside], v + y[inside]

    def _flicker(
        self, lamp: tuple[NDArray[np.int64], NDArray[np.int64]], like: Events, start_us: int, end_us: int
    ) -> Events:
        """One event of each pixel for each rise and fall."""
        xs, ys = lamp
        half_us = round(0.5e6 / LAMP_HZ)
        swings = np.arange(-(-start_us // half_us), -(-end_us // half_us))
        t = swings[:, None] * half_us + self._rng.integers(0, SWING_US, (len(swings), len(xs)))
        t = np.clip(t, start_us, end_us - 1).ravel()
        on = np.repeat(swings % 2 == 0, len(xs))
        order = np.argsort(t, kind="stable")
        x, y = (np.tile(one, len(swings))[order].astype(np.uint16) for one in (xs, ys))
        return Events.from_columns(t[order], x, y, on[order], like.sensor)


def wrong_cameras(cell: Cell, cameras: Mapping[str, Camera], rng: np.random.Generator) -> dict[str, Camera]:
    """The cameras as a calibration has them that is as wrong as the cell says."""
    return {name: _wrong(cell, camera, rng) for name, camera in cameras.items()}


def _wrong(cell: Cell, camera: Camera, rng: np.random.Generator) -> Camera:
    angle = rng.uniform(0, 2 * math.pi)
    K, T = camera.K.copy(), camera.T_world_camera.copy()
    K[:2, 2] += cell.pixels * np.array([math.cos(angle), math.sin(angle)])
    T[:3, :3] = T[:3, :3] @ _turn(cell.degrees, rng).as_matrix()
    return replace(camera, K=K, T_world_camera=T)


def _turn(degrees: float, rng: np.random.Generator) -> Rotation:
    """By an angle about any axis."""
    return Rotation.from_rotvec(math.radians(degrees) * random_direction(rng))


def _later(events: Events, by_us: int) -> Events:
    return Events.from_columns(events.t_us + by_us, events.x_px, events.y_px, events.on, events.sensor)


def _joined(one: Events, other: Events) -> Events:
    t, x, y, on = (
        np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("t_us", "x_px", "y_px", "on")
    )
    order = np.argsort(t, kind="stable")
    return Events.from_columns(t[order], x[order], y[order], on[order], one.sensor)
