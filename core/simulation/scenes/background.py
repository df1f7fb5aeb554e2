"""The static picture of a camera: light, depth and net of every pixel, and the ray that belongs to it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.scenes.scene import NET_TAPE_M, ROOM_HALF_M, SceneConfig
from core.table import (
    CENTRE_LINE_WIDTH_M,
    LINE_WIDTH_M,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

SAMPLES = 3
"""Rays along each side of a pixel, for smooth edges of lines and table."""
ROWS_AT_ONCE = 32
"""Rows whose rays are undistorted together, so that they stay in the cache."""
HALF_LENGTH, HALF_WIDTH, HALF_NET = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2, TABLE_WIDTH_M / 2 + NET_OVERHANG_M
ROOM_X, ROOM_Y = ROOM_HALF_M


RAY_X, RAY_Y, LIGHT, DEPTH_M, NET_LIGHT, NET_COVER, LOG_LIGHT = range(7)
"""Columns of a pixel's row: x / z and y / z of the ray through its centre in the camera's frame, distortion taken out;
intensity of what is behind the net, without the net; camera z of that surface; light from the net itself, weighted by
its cover; the cover; logarithm of the whole static picture."""


def make_background(camera: Camera, scene: SceneConfig) -> NDArray[np.float32]:
    """Rows (pixels, 8) of the empty room, ray-cast. Where the distortion has no inverse, pixels look away for good."""
    size = camera.sensor
    rows = np.zeros((size.width_px * size.height_px, 8), np.float32)
    columns = np.arange(size.width_px, dtype=np.float64)
    for top in range(0, size.height_px, ROWS_AT_ONCE):
        lines = np.arange(top, min(top + ROWS_AT_ONCE, size.height_px), dtype=np.float64)
        uvs = np.stack(np.meshgrid(columns, lines), axis=-1).reshape(-1, 2)
        part = slice(top * size.width_px, top * size.width_px + len(uvs))
        rows[part, : RAY_Y + 1] = np.nan_to_num(camera.undistort(uvs), nan=1e6)
    reflectances = np.array([scene.table, scene.line, scene.floor, scene.wall, scene.net, scene.net_cover])
    _cast(rows, camera.T_world_camera, 1.0 / np.diag(camera.K)[:2], reflectances)
    return rows


@njit
def _cast(rows, T, pixel, reflectances):
    share = 1.0 / (SAMPLES * SAMPLES)
    for index in range(len(rows)):
        light = net_light = net_cover = 0.0
        for sub in range(SAMPLES * SAMPLES):
            x = rows[index, RAY_X] + ((sub % SAMPLES + 0.5) / SAMPLES - 0.5) * pixel[0]
            y = rows[index, RAY_Y] + ((sub // SAMPLES + 0.5) / SAMPLES - 0.5) * pixel[1]
            dx = T[0, 0] * x + T[0, 1] * y + T[0, 2]
            dy = T[1, 0] * x + T[1, 1] * y + T[1, 2]
            dz = T[2, 0] * x + T[2, 1] * y + T[2, 2]
            distance, seen = _room(T[0, 3], T[1, 3], T[2, 3], dx, dy, dz, reflectances)
            meets, tape = _net(T[0, 3], T[1, 3], T[2, 3], dx, dy, dz, distance)
            light += seen * share
            if meets:
                cover = 1.0 if tape else reflectances[5]
                net_light += cover * share * (reflectances[1] if tape else reflectances[4])
                net_cover += cover * share
            if sub == SAMPLES * SAMPLES // 2:
                rows[index, DEPTH_M] = distance
        rows[index, LIGHT], rows[index, NET_LIGHT], rows[index, NET_COVER] = light, net_light, net_cover
        rows[index, LOG_LIGHT] = math.log(net_light + (1.0 - net_cover) * light)


@njit
def _room(px, py, pz, dx, dy, dz, reflectances):
    """Distance along a ray (in units of its direction) to table, floor or wall, and the light from there."""
    if dz * pz < 0.0:
        distance = -pz / dz
        x, y = abs(px + distance * dx), abs(py + distance * dy)
        if x <= HALF_LENGTH and y <= HALF_WIDTH:
            edge = x > HALF_LENGTH - LINE_WIDTH_M or y > HALF_WIDTH - LINE_WIDTH_M
            return distance, reflectances[1 if edge or y < CENTRE_LINE_WIDTH_M / 2 else 0]
    to_x = ((ROOM_X if dx > 0 else -ROOM_X) - px) / dx if dx != 0.0 else np.inf
    to_y = ((ROOM_Y if dy > 0 else -ROOM_Y) - py) / dy if dy != 0.0 else np.inf
    wall = min(to_x, to_y)
    floor = (-TABLE_HEIGHT_M - pz) / dz if dz < 0.0 else np.inf
    if floor < wall:
        return floor, reflectances[2]
    return wall, reflectances[3]


@njit
def _net(px, py, pz, dx, dy, dz, beyond):
    """Whether a ray meets the net before `beyond`, and whether in its white tape."""
    if dx * px >= 0.0:
        return False, False
    distance = -px / dx
    z = pz + distance * dz
    if distance >= beyond or abs(py + distance * dy) > HALF_NET or z < 0.0 or z > NET_HEIGHT_M:
        return False, False
    return True, z > NET_HEIGHT_M - NET_TAPE_M
