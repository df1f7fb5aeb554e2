"""Loading the compiled stages of a player before a ball comes: the first use of each takes up to a second in all."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.chain.control.controller import BuiltInController
from core.chain.control.player import Player, PlayerState
from core.events import Events, Window
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory.prediction import HitPlane

STEPS: Final = 50
START_M: Final = (0.4, 0.05, 0.12)
VELOCITY_MPS: Final = (-4.0, 0.0, -1.5)
LOOKS: Final = 20
"""At the painted ball in a window."""


class Table(NamedTuple):
    """What the player expects of it."""

    restitution: float
    friction: float


def warm_up(player: Player, cameras: Mapping[str, Camera], window_us: int) -> PlayerState | None:
    """Let the player see a painted ball fly and bounce in a tenth of a second, then forget it; the last state."""
    expected = player.chain.config.filter
    state, table = None, Table(expected.restitution, expected.friction)
    for number in range(max(STEPS, 100_000 // window_us)):
        end_us = (number + 1) * window_us
        state = player.step({name: _painted(camera, end_us, window_us, table) for name, camera in cameras.items()})
    player.reset()
    if player.hit == "chosen":
        load_strokes()
    return state


def load_strokes() -> None:
    """Load what the choice of the hit asks of a stroke: the painted ball may be too low for one everywhere.

    Quick where it is loaded: a player that begins to choose later calls it too.
    """
    sigmas = np.full(3, 1e-3)
    spread = 1e-6 * np.eye(6)
    p, v = np.array([-1.3, 0.0, 0.25]), np.array([-4.0, 0.0, 0.0])
    hit = HitPlane(0.0, 1e-3, p, sigmas, v, sigmas, spread, "post", np.zeros(3), sigmas)
    BuiltInController().strokes().stroke_at(hit, spread)


def _painted(camera: Camera, end_us: int, window_us: int, table: Table) -> Window:
    """Events where the rim of the ball's disc passes pixels, if it is in the picture: ON ahead of it, OFF behind."""
    start_us = end_us - window_us
    times_us = np.linspace(start_us, end_us, LOOKS + 1)
    discs = [_disc(camera, _place(1e-6 * float(t_us), table)) for t_us in times_us]
    if any(disc is None for disc in discs):
        return Window(Events.empty(camera.sensor), start_us, end_us)
    us, vs, radii = np.array(discs).T
    margin = radii.max() + 2.0
    x = np.arange(max(0, int(us.min() - margin)), min(camera.sensor.width_px, int(us.max() + margin) + 1))
    y = np.arange(max(0, int(vs.min() - margin)), min(camera.sensor.height_px, int(vs.max() + margin) + 1))
    away = np.hypot(x[None, None, :] - us[:, None, None], y[None, :, None] - vs[:, None, None])
    inside = away <= radii[:, None, None]
    look, row, column = np.nonzero(inside[1:] != inside[:-1])
    entered = inside[1:][look, row, column]
    t_us = (times_us[look] + (times_us[1] - times_us[0]) * np.random.default_rng(0).random(len(look))).astype(np.int64)
    order = np.argsort(t_us, kind="stable")
    x_px, y_px = x[column[order]].astype(np.uint16), y[row[order]].astype(np.uint16)
    return Window(Events.from_columns(t_us[order], x_px, y_px, entered[order], camera.sensor), start_us, end_us)


def _place(t_s: float, table: Table) -> NDArray[np.float64]:
    """(3,) of a ball without spin that slides over the table when it bounces."""
    (x, y, z), (vx, _, vz) = START_M, VELOCITY_MPS
    down_mps = math.sqrt(vz * vz + 2.0 * GRAVITY_MPS2 * (z - BALL_RADIUS_M))
    bounce_s = (down_mps + vz) / GRAVITY_MPS2
    before_s, after_s = min(t_s, bounce_s), max(0.0, t_s - bounce_s)
    slowed = vx + table.friction * (1.0 + table.restitution) * down_mps
    if after_s > 0.0:
        z = BALL_RADIUS_M + (table.restitution * down_mps - 0.5 * GRAVITY_MPS2 * after_s) * after_s
    else:
        z += (vz - 0.5 * GRAVITY_MPS2 * t_s) * t_s
    return np.array([x + vx * before_s + slowed * after_s, y, z])


def _disc(camera: Camera, p: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """Centre and radius in pixels of a ball at (3,); None for one behind the camera."""
    u, v = camera.project(p[None])[0]
    if not np.isfinite([u, v]).all():
        return None
    return float(u), float(v), camera.K[0, 0] * BALL_RADIUS_M / max(float(camera.to_camera(p[None])[0, 2]), 0.1)
