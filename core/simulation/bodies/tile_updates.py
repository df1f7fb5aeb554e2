"""Looks at moving bodies: only tiles of the picture that a part may have changed since its last look are drawn again.

Each part is looked at as often as it moves itself, a racket's blade every few 100 us, a trunk that sways every few
milliseconds; at the end of a block all that moved at all.
"""

from __future__ import annotations

import math

import numpy as np

from core.jit import njit
from core.simulation.bodies.shading import (
    LOG_TOTAL,
    PARTS_IN_PIXEL,
    POSED_COLUMNS,
    draw_layers,
    light_among,
    posed_parts,
)
from core.simulation.scenes.shading import UNTOUCHED, pixel_seen
from core.simulation.sensor.pixels import follow_pixel, rest_pixel
from core.simulation.sensor.sensor import RECEPTOR, REFERENCE, TARGET, TIME_US

TILE_PX = 8
UPDATE_PX = 0.8
"""A part is looked at again when it has moved this far in the picture, half an edge, like the robot's racket."""
REST_PX = 0.02
"""A part that has moved less in a block is at rest."""
MARGIN_PX = 2.0
"""Half an edge and the lens's distortion within a part."""
EVENTS_PER_PIXEL = 128
"""Room kept free in the buffer per pixel of a tile, as for the ball."""


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
def mark_moved(circles, looked, least_px, shape, marks, tiles, listed):
    """List the tiles near parts that moved by `least_px`, where they were and where they are now.

    `looked` has the circles of each part's last look, `marks` says which tiles are in `tiles[:listed[0]]`.
    """
    wide, high = (shape[0] + TILE_PX - 1) // TILE_PX, (shape[1] + TILE_PX - 1) // TILE_PX
    for index in range(len(circles)):
        moved = 0.0
        for end in range(2):
            for axis in range(3):
                moved = max(moved, abs(circles[index, end, axis] - looked[index, end, axis]))
        if moved < least_px:
            continue
        _mark(looked[index], wide, high, marks, tiles, listed)
        _mark(circles[index], wide, high, marks, tiles, listed)
        looked[index] = circles[index]


@njit(error_model="numpy")
def _mark(part, wide, high, marks, tiles, listed):
    if part[0, 2] < 0.0 or part[1, 2] < 0.0:
        return
    reach = max(part[0, 2], part[1, 2]) + MARGIN_PX
    x0 = int(max((min(part[0, 0], part[1, 0]) - reach) // TILE_PX, 0))
    x1 = int(min((max(part[0, 0], part[1, 0]) + reach) // TILE_PX, wide - 1))
    y0 = int(max((min(part[0, 1], part[1, 1]) - reach) // TILE_PX, 0))
    y1 = int(min((max(part[0, 1], part[1, 1]) + reach) // TILE_PX, high - 1))
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            if not marks[y * wide + x] and near_tile(part, x, y):
                marks[y * wide + x] = True
                tiles[listed[0]] = y * wide + x
                listed[0] += 1


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
def draw_tile(tile, shape, maps, layers, posed, circles, here, found, scene, ball_m, view):
    """Write the layers of a tile's pixels; returns its pixels as (first column, first row, end column, end row)."""
    width, height = shape
    wide = (width + TILE_PX - 1) // TILE_PX
    row, column = tile // wide, tile % wide
    count = 0
    for index in range(len(posed)):
        if near_tile(circles[index], column, row):
            here[count] = index
            count += 1
    x0, y0 = column * TILE_PX, row * TILE_PX
    x1, y1 = min(x0 + TILE_PX, width), min(y0 + TILE_PX, height)
    for y in range(y0, y1):
        for x in range(x0, x1):
            draw_layers(maps, layers, y * width + x, posed, here, count, found, scene, ball_m, view)
    return x0, y0, x1, y1


@njit(error_model="numpy")
def update_tiles(
    pixels, active, active_list, active_count, shape, maps, layers, view, ends, circles, parts, scene, looks,
    now_us, first_us, ball, racket, box_ball, box_shadow, box_racket, swing, sensor, events, count,
):  # fmt: skip
    """Draw the listed tiles again and tell their pixels; returns (event count, awake count, finished).

    `looks` is (marks, tiles, listed, time of each tile's last look); a tile at rest since before `first_us` began to
    move then. `swing` is added to the logarithm of all light. Not finished if the buffer might overflow: call again
    with a larger one.
    """
    marks, tiles, listed, tile_us = looks
    tau_us, refractory_us, width = sensor[0], sensor[1], shape[0]
    if listed[0] == 0:
        return count, active_count, True
    here, found = np.empty(len(parts), np.int64), np.empty((PARTS_IN_PIXEL, 3))
    posed = np.empty((len(parts), POSED_COLUMNS))
    posed_parts(ends, parts, scene[0], posed)
    ball_m = ball[2] if ball[2] > 0.0 else math.inf
    while listed[0] > 0:
        if count + TILE_PX * TILE_PX * EVENTS_PER_PIXEL > len(events):
            return count, active_count, False
        listed[0] -= 1
        tile = tiles[listed[0]]
        marks[tile] = False
        x0, y0, x1, y1 = draw_tile(
            tile, shape, maps, layers, posed, circles, here, found, scene, ball_m, view
        )  # fmt: skip
        see_ball, see_shadow = _meets(box_ball, x0, y0, x1, y1), _meets(box_shadow, x0, y0, x1, y1)
        see_racket = _meets(box_racket, x0, y0, x1, y1)
        before_us, tile_us[tile] = max(tile_us[tile], first_us), now_us
        decay = math.exp((before_us - now_us) / tau_us) if tau_us > 0.0 else 0.0
        for y in range(y0, y1):
            for x in range(x0, x1):
                pixel = y * width + x
                goal = swing + layers[pixel, LOG_TOTAL]
                if see_ball or see_shadow or see_racket:
                    seen = pixel_seen(maps, pixel)
                    light = light_among(seen, layers, pixel, view, ball, racket, see_ball, see_shadow, see_racket)
                    goal = goal if light == UNTOUCHED else swing + math.log(light)
                if goal == pixels[pixel, TARGET]:
                    continue
                if now_us <= 0.0:  # how a recording begins: it has been there for long
                    pixels[pixel, TARGET] = pixels[pixel, RECEPTOR] = pixels[pixel, REFERENCE] = goal
                    continue
                if not active[pixel]:
                    active[pixel] = True
                    active_list[active_count] = pixel
                    active_count += 1
                if pixels[pixel, TIME_US] < before_us:
                    count = rest_pixel(pixels, pixel, before_us, tau_us, refractory_us, events, count)
                start_us = pixels[pixel, TIME_US]
                fall = (
                    decay if start_us == before_us else math.exp((start_us - now_us) / tau_us) if tau_us > 0.0 else 0.0
                )
                count = follow_pixel(pixels, pixel, goal, start_us, now_us, fall, tau_us, refractory_us, events, count)
    return count, active_count, True


@njit(error_model="numpy")
def _meets(box, x0, y0, x1, y1):
    return box[0] < x1 and box[2] > x0 and box[1] < y1 and box[3] > y0
