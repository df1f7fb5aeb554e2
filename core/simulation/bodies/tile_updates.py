"""Looks at moving bodies: only tiles of the picture that a part may have changed since its last look are drawn again.

Each part is looked at as often as it moves itself, a racket's blade every few 100 us, a trunk that sways every few
milliseconds; at the end of a block all that moved at all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.simulation.bodies.shading import (
    LOG_TOTAL,
    draw_layers,
    light_among,
    posed_parts,
)
from core.simulation.scenes.block_view import BALL, RACKET, SHADOW, boxes_meet, moving_at
from core.simulation.scenes.shading import UNTOUCHED, pixel_seen
from core.simulation.sensor.pixels import (
    EVENTS_PER_PIXEL,
    follow_pixel,
    prefetch,
    receptor_decay,
    rest_pixel,
    wake_pixel,
)
from core.simulation.sensor.sensor import RECEPTOR, REFERENCE, TARGET, TIME_US

TILE_PX = 8
UPDATE_PX = 0.8
"""A part is looked at again when it has moved this far in the picture, half an edge, like the robot's racket."""
REST_PX = 0.02
"""A part that has moved less in a block is at rest."""
MARGIN_PX = 2.0
"""Half an edge and the lens's distortion within a part."""
NOWHERE = -1e6
"""A circle that no part was ever at."""


class TileUpdates(NamedTuple):
    """Which tiles of a picture have to be drawn again; changed in place."""

    columns: int
    """Tiles beside each other."""
    rows: int
    looked: NDArray[np.float64]
    """(P, 2, 3) circles of every part at its last look."""
    marks: NDArray[np.bool_]
    """(tiles,) whether one is listed."""
    tiles: NDArray[np.int64]
    """(tiles,) room for the numbers of those that are listed."""
    listed: NDArray[np.int64]
    """(1,) how many are."""
    looked_us: NDArray[np.float64]
    """(tiles,) when each was last drawn for an event camera."""

    @staticmethod
    def none_yet(width_px: int, height_px: int, parts: int) -> TileUpdates:
        """Nothing was ever looked at in a picture of that size."""
        columns, rows = -(-width_px // TILE_PX), -(-height_px // TILE_PX)
        looked, marks = np.full((parts, 2, 3), NOWHERE), np.zeros(columns * rows, np.bool_)
        looked[:, :, 2] = -1.0
        tiles, looked_us = np.zeros(len(marks), np.int64), np.full(len(marks), -1.0)
        return TileUpdates(columns, rows, looked, marks, tiles, np.zeros(1, np.int64), looked_us)


@njit(error_model="numpy")
def pose_at(probes, share, out):
    """The (P, 2, 3) numbers at a share 0..1 of the block, evenly between probes; a -1 in the last column stays one."""
    at = share * (len(probes) - 1)
    low = min(int(at), len(probes) - 2)
    rest = at - low
    for index in range(len(out)):
        for end in range(2):
            for axis in range(3):
                a, b = probes[low, index, end, axis], probes[low + 1, index, end, axis]
                out[index, end, axis] = -1.0 if axis == 2 and min(a, b) == -1.0 else a + rest * (b - a)


@njit(error_model="numpy")
def mark_moved(circles, least_px, updates):
    """List the tiles near parts that moved by `least_px`, where they were and where they are now."""
    looked = updates.looked
    for index in range(len(circles)):
        moved = 0.0
        for end in range(2):
            for axis in range(3):
                moved = max(moved, abs(circles[index, end, axis] - looked[index, end, axis]))
        if moved < least_px:
            continue
        _mark(looked[index], updates)
        _mark(circles[index], updates)
        for end in range(2):
            for axis in range(3):
                looked[index, end, axis] = circles[index, end, axis]


@njit(error_model="numpy")
def _mark(part, updates):
    if part[0, 2] < 0.0 or part[1, 2] < 0.0:
        return
    reach = max(part[0, 2], part[1, 2]) + MARGIN_PX
    x0 = int(max((min(part[0, 0], part[1, 0]) - reach) // TILE_PX, 0))
    x1 = int(min((max(part[0, 0], part[1, 0]) + reach) // TILE_PX, updates.columns - 1))
    y0 = int(max((min(part[0, 1], part[1, 1]) - reach) // TILE_PX, 0))
    y1 = int(min((max(part[0, 1], part[1, 1]) + reach) // TILE_PX, updates.rows - 1))
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            tile = y * updates.columns + x
            if not updates.marks[tile] and near_tile(part, x, y):
                updates.marks[tile] = True
                updates.tiles[updates.listed[0]] = tile
                updates.listed[0] += 1


@njit(error_model="numpy")
def near_tile(part, column, row):
    """Whether a part's outline may reach into a tile."""
    if part[0, 2] < 0.0 or part[1, 2] < 0.0:
        return False
    x, y = (column + 0.5) * TILE_PX - 0.5 - part[0, 0], (row + 0.5) * TILE_PX - 0.5 - part[0, 1]
    dx, dy = part[1, 0] - part[0, 0], part[1, 1] - part[0, 1]
    length2 = dx * dx + dy * dy
    share = min(max((x * dx + y * dy) / length2, 0.0), 1.0) if length2 > 1e-9 else 0.0
    x, y = x - share * dx, y - share * dy
    reach = max(part[0, 2], part[1, 2]) + MARGIN_PX + 0.7072 * TILE_PX
    return x * x + y * y < reach * reach


@njit(error_model="numpy")
def draw_tile(tile, scene, posed, ball_m):
    """Write the layers of a tile's pixels; returns its pixels as (first column, first row, end column, end row)."""
    width, height = scene.width_px, scene.height_px
    wide = (width + TILE_PX - 1) // TILE_PX
    row, column = tile // wide, tile % wide
    count = np.int64(0)  # as a literal it would have `draw_layers` compiled twice
    for index in range(len(posed.circles)):
        if near_tile(posed.circles[index], column, row):
            posed.here[count] = index
            count += 1
    x0, y0 = column * TILE_PX, row * TILE_PX
    box = x0, y0, min(x0 + TILE_PX, width), min(y0 + TILE_PX, height)
    draw_layers(scene, box, posed, count, ball_m)
    return box


@njit(error_model="numpy")
def ask_for_tile(tile, scene, rows):
    """Have a tile's pixels at hand soon."""
    wide = (scene.width_px + TILE_PX - 1) // TILE_PX
    first = tile // wide * TILE_PX * scene.width_px + tile % wide * TILE_PX
    for y in range(TILE_PX):
        for x in range(TILE_PX):
            pixel = min(first + y * scene.width_px + x, len(rows) - 1)
            prefetch(rows, pixel)
            if x % 2 == 0:  # two to a line
                prefetch(scene.maps, pixel)
                prefetch(scene.layers, pixel)


@njit(error_model="numpy")
def update_tiles(pixels, scene, steps, step, posed, updates, timing, events):
    """Draw the listed tiles again and tell their pixels.

    A tile at rest since before the block began to move then. Step 0 is how a recording begins: what is there has been
    there for long. Returns false if the buffer might overflow: call again with a larger one.
    """
    if updates.listed[0] == 0:
        return True
    # Out of the tuples once: numba counts references to an array each time that it is taken from one.
    rows, active, event_rows, maps, layers = pixels.rows, pixels.active, events.rows, scene.maps, scene.layers
    now_us = steps.t_us[step]
    swing = steps.swing.log_light[step] if step > 0 and len(steps.swing.log_light) else 0.0
    posed_parts(scene, posed)
    ball_m = steps.rows[step, 2] if steps.rows[step, 2] > 0.0 else math.inf
    while updates.listed[0] > 0:
        count = events.filled[0]
        if count + TILE_PX * TILE_PX * EVENTS_PER_PIXEL > len(event_rows):
            return False
        updates.listed[0] -= 1
        tile = updates.tiles[updates.listed[0]]
        updates.marks[tile] = False
        if updates.listed[0] > 0:
            ask_for_tile(updates.tiles[updates.listed[0] - 1], scene, rows)
        box = draw_tile(tile, scene, posed, ball_m)
        see_ball, see_shadow = boxes_meet(steps.boxes[step, BALL], box), boxes_meet(steps.boxes[step, SHADOW], box)
        see_racket = boxes_meet(steps.boxes[step, RACKET], box)
        moving = moving_at(steps, step, see_ball, see_shadow, see_racket)
        before_us, updates.looked_us[tile] = max(updates.looked_us[tile], steps.t_us[0]), now_us
        decay = receptor_decay(before_us, now_us, timing)
        for y in range(box[1], box[3]):
            for x in range(box[0], box[2]):
                pixel = y * scene.width_px + x
                goal = swing + layers[pixel, LOG_TOTAL]
                if see_ball or see_shadow or see_racket:
                    light = light_among(pixel_seen(maps, pixel), layers, pixel, scene.numbers, moving)
                    goal = goal if light == UNTOUCHED else swing + math.log(light)
                if goal == rows[pixel, TARGET]:
                    continue
                if step == 0:
                    rows[pixel, TARGET] = rows[pixel, RECEPTOR] = rows[pixel, REFERENCE] = goal
                    continue
                if not active[pixel]:
                    wake_pixel(pixels, pixel)
                if rows[pixel, TIME_US] < before_us:
                    count = rest_pixel(rows, pixel, before_us, timing, event_rows, count)
                start_us = rows[pixel, TIME_US]
                fall = decay if start_us == before_us else receptor_decay(start_us, now_us, timing)
                count = follow_pixel(rows, pixel, goal, now_us, fall, timing, event_rows, count)
        events.filled[0] = count
    return True
