"""Loading the compiled stages of a player before a ball comes: the first use of each takes up to a second in all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from core.cameras import Camera
from core.events import Events, Window
from core.rally.control.player import Player, PlayerState
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

STEPS: Final = 50
START_M: Final = (0.4, 0.05, 0.12)
VELOCITY_MPS: Final = (-4.0, 0.0, -1.5)


def warm_up(player: Player, cameras: Mapping[str, Camera], window_us: int) -> PlayerState | None:
    """Let the player see a painted ball fly and bounce in a tenth of a second, then forget it; the last state."""
    state = None
    for number in range(max(STEPS, 100_000 // window_us)):
        end_us = (number + 1) * window_us
        state = player.step({name: _painted(camera, end_us, window_us) for name, camera in cameras.items()})
    player.reset()
    return state


def _painted(camera: Camera, end_us: int, window_us: int) -> Window:
    """Events on the ball's disc in the picture, if it is in it."""
    t_s = end_us * 1e-6
    p = np.array(START_M) + np.array(VELOCITY_MPS) * t_s - [0.0, 0.0, 0.5 * GRAVITY_MPS2 * t_s**2]
    p[2] = BALL_RADIUS_M + abs(p[2] - BALL_RADIUS_M)
    u, v = camera.project(p[None])[0]
    if not np.isfinite([u, v]).all():
        return Window(Events.empty(camera.sensor), end_us - window_us, end_us)  # the ball is behind this camera
    radius = camera.K[0, 0] * BALL_RADIUS_M / max(float(camera.to_camera(p[None])[0, 2]), 0.1)
    x, y = np.meshgrid(np.arange(int(u - radius), int(u + radius) + 1), np.arange(int(v - radius), int(v + radius) + 1))
    size = camera.sensor
    seen = (np.hypot(x - u, y - v) <= radius) & (x >= 0) & (y >= 0) & (x < size.width_px) & (y < size.height_px)
    t_us = np.linspace(end_us - window_us, end_us - 1, int(seen.sum())).astype(np.int64)
    xs, ys = x[seen].astype(np.uint16), y[seen].astype(np.uint16)
    return Window(Events.from_columns(t_us, xs, ys, np.ones(len(xs), np.bool_), size), end_us - window_us, end_us)
