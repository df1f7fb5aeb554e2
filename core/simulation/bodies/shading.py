"""The light of bodies in a pixel, and how ball, net and robot's racket lie before, between and behind them.

Each pixel with bodies has two layers over the room of `core.simulation.scenes.background`: what is nearer to the camera
than the ball, and what is farther. So a ball passes behind an arm and before a trunk in one pixel, edges included.

One part is drawn in many pixels at once, so that the processor does several in one instruction: the numbers lie in one
array at fixed distances, so the compiler sees that what is written is never what is read, and no branch depends on a
pixel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.simulation.bodies.parts import BANDS, BLADE, KIND, RADIUS_A, RADIUS_B, REFLECTANCE, STRIPES_PER_M, TEXTURE
from core.simulation.scenes.background import DEPTH_M, LIGHT, LOG_LIGHT, NET_COVER, NET_LIGHT, RAY_X, RAY_Y
from core.simulation.scenes.racket_view import racket_gap
from core.simulation.scenes.shading import (
    UNTOUCHED,
    Moving,
    ball_cover,
    pixel_light,
    racket_cover,
    smooth_step,
    smooth_step_in_lanes,
)

SHEET = 64
"""Pixels at once. A sheet is an array of 6 SHEET numbers, of each pixel x / z and y / z of its ray and the squared
length x^2 + y^2 + 1; then the share of it that a part covers, the part's light there, and its camera z."""


@njit(error_model="numpy")
def draw_sheet(row, sheet, edge, ambient, view):
    """Write the second half of a sheet for a part, a row of `posed_parts`; returns whether it is seen at all."""
    if row[11] == BLADE:
        _draw_blade(row, sheet)
    else:
        _draw_rod(row, sheet, edge, ambient, view)
        if row[12] > 0.0:
            _weave(row, sheet, view)
    most = 0.0
    for index in range(SHEET):
        most = max(most, sheet[3 * SHEET + index])
    return most > 0.0


@njit(error_model="numpy")
def _draw_blade(row, sheet):
    face, body = (row[0], row[1], row[2], row[3], row[4], row[5]), (row[12], row[13], row[14], row[15])
    racket = (*face, 0.0, row[6], row[7], row[8], *body)
    for index in range(SHEET):
        # As the maps have them: the robot's racket is asked for the gap in the same precision.
        gap, z = racket_gap(racket, np.float32(sheet[index]), np.float32(sheet[SHEET + index]))
        sheet[3 * SHEET + index] = smooth_step(0.5 - gap / row[6])
        sheet[4 * SHEET + index], sheet[5 * SHEET + index] = row[10], z


@njit(error_model="numpy")
def _draw_rod(row, sheet, edge, ambient, view):
    ax, ay, az, dx, dy, dz, dd, ad = row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]
    radius_a, widening, reflectance = row[8], row[9], row[10]
    to_light_x, to_light_y, to_light_z = view[12], view[13], view[14]
    for index in range(SHEET):
        x, y, length2 = sheet[index], sheet[SHEET + index], sheet[2 * SHEET + index]
        inverse = 1.0 / length2
        ar, dr = ax * x + ay * y + az, dx * x + dy * y + dz
        share = _nearest(ar, dr, dd, ad, inverse)
        cx, cy, cz = ax + share * dx, ay + share * dy, az + share * dz
        along = (ar + share * dr) * inverse
        gap2 = cx * cx + cy * cy + cz * cz - along * along * length2
        radius, width = radius_a + share * widening, edge * cz
        reach = radius + 0.5 * width
        inner = radius - 0.5 * width
        inner2 = inner * inner if inner > 0.0 else -1.0
        cover = smooth_step_in_lanes((radius - math.sqrt(gap2 if gap2 > 0.0 else 0.0)) / width + 0.5)
        # Selections, no branches: then the compiler works on several pixels at once.
        cover = 1.0 if gap2 <= inner2 else cover
        cover = cover if gap2 < reach * reach else 0.0
        depth2 = radius * radius - gap2
        z = along - math.sqrt((depth2 if depth2 > 0.0 else 0.0) * inverse)
        nx, ny, nz = z * x - cx, z * y - cy, z - cz
        facing = (nx * to_light_x + ny * to_light_y + nz * to_light_z) * (1.0 / radius)
        sheet[3 * SHEET + index] = cover
        sheet[4 * SHEET + index] = reflectance * (ambient + (1.0 - ambient) * 0.5 * (1.0 + facing))
        sheet[5 * SHEET + index] = z


@njit(error_model="numpy")
def _weave(row, sheet, view):
    """The pattern of the cloth, on the light that is there."""
    ax, ay, az, dx, dy, dz, dd, ad = row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]
    radius_a, widening, depth, stripes, bands = row[8], row[9], row[12], row[13], row[14]
    up_x, up_y, up_z = view[3], view[4], view[5]
    for index in range(SHEET):
        x, y, length2, z = sheet[index], sheet[SHEET + index], sheet[2 * SHEET + index], sheet[5 * SHEET + index]
        share = _nearest(ax * x + ay * y + az, dx * x + dy * y + dz, dd, ad, 1.0 / length2)
        nx, ny, nz = z * x - (ax + share * dx), z * y - (ay + share * dy), z - (az + share * dz)
        across_wave = (up_x * nx + up_y * ny + up_z * nz) * (1.0 / (radius_a + share * widening))
        waves = _wave(share * stripes + 0.13) + _wave(across_wave * bands + 0.37)
        sheet[4 * SHEET + index] *= 1.0 + 0.5 * depth * waves


@njit(inline="always", error_model="numpy")
def _nearest(ar, dr, dd, ad, inverse):
    """How far along a rod, as a share of it, its axis comes nearest to a ray."""
    across = dd - dr * dr * inverse
    share = (ar * dr * inverse - ad) / across
    share = share if share > 0.0 else 0.0
    share = share if share < 1.0 else 1.0
    return share if across > 1e-12 else 0.0


@njit(inline="always", error_model="numpy")
def _wave(phase):
    """Between -1 and 1, once up and down per unit; close to a sine and much quicker."""
    u = 2.0 * (phase - math.floor(phase))
    rising, falling = 4.0 * u * (1.0 - u), 4.0 * (u - 1.0) * (u - 2.0)
    return rising if u < 1.0 else falling


NEAR_COVER, NEAR_LIGHT, NEAR_M, FAR_COVER, FAR_LIGHT, FAR_M, BEFORE_NET, LOG_TOTAL = range(8)
"""Columns of a pixel's layers: cover, light weighted by the cover, and camera z of the bodies before the ball; the same
of those behind it; 1 if the near ones are on the camera's side of the net; logarithm of the whole picture without ball
and robot's racket. Both covers are 0 where there is no body."""
POSED_COLUMNS = 16
PARTS_IN_PIXEL = 6
"""Parts that can be seen through one another's edges in one pixel; farther ones are left out."""


class SceneView(NamedTuple):
    """A scene to one camera: all of the picture but ball and robot's racket."""

    width_px: int
    height_px: int
    maps: NDArray[np.float32]
    """(pixels, 8) the empty room, see `core.simulation.scenes.background`."""
    layers: NDArray[np.float32]
    """(pixels, 8) the bodies before and behind the ball; (0, 8) without bodies."""
    numbers: tuple[float, ...]
    """VIEW_NUMBERS that describe the camera."""
    parts: NDArray[np.float64]
    """(P, PART_COLUMNS) of the bodies."""
    edge_per_m: float
    """Width of an edge in metres per metre of camera z."""
    ambient: float
    """Ambient share of the light."""


class PosedBodies(NamedTuple):
    """The bodies at one instant to one camera, and room to draw them."""

    ends: NDArray[np.float64]
    """(P, 2, 3) in the camera's frame."""
    circles: NDArray[np.float64]
    """(P, 2, 3) pixel and radius in pixels of a circle round each end; radius -1 for a part that is left out."""
    rows: NDArray[np.float64]
    """(P, POSED_COLUMNS), see `posed_parts`."""
    here: NDArray[np.int64]
    """(P,) the parts that may be seen in a tile."""
    found: NDArray[np.float64]
    """(PARTS_IN_PIXEL, 3) cover, light and camera z of the parts in a pixel, from near to far."""
    sheet: NDArray[np.float64]
    """(6 SHEET,) see `core.simulation.bodies.shading`."""
    sheets: NDArray[np.float64]
    """(P, 3 SHEET) the second half of it, for every part that is seen."""


@njit(error_model="numpy")
def posed_bodies(ends, circles):
    """Bodies with ends and circles (P, 2, 3) and room for the rest."""
    rows, here = np.empty((len(ends), POSED_COLUMNS)), np.empty(len(ends), np.int64)
    found, sheet, sheets = np.empty((PARTS_IN_PIXEL, 3)), np.empty(6 * SHEET), np.empty((len(ends), 3 * SHEET))
    return PosedBodies(ends, circles, rows, here, found, sheet, sheets)


@njit(error_model="numpy")
def posed_parts(scene, posed):
    """Write `POSED_COLUMNS` numbers of every part at one instant: what its pixels have in common."""
    ends, parts, edge, rows = posed.ends, scene.parts, scene.edge_per_m, posed.rows
    for index in range(len(parts)):
        ax, ay, az = ends[index, 0, 0], ends[index, 0, 1], ends[index, 0, 2]
        dx, dy, dz = ends[index, 1, 0] - ax, ends[index, 1, 1] - ay, ends[index, 1, 2] - az
        dd, radius, row = dx * dx + dy * dy + dz * dz, parts[index, RADIUS_A], rows[index]
        length = math.sqrt(dd)
        row[0], row[1], row[2], row[10], row[11] = ax, ay, az, parts[index, REFLECTANCE], parts[index, KIND]
        if parts[index, KIND] == BLADE:
            mx, my, mz, s = ax + 0.5 * dx, ay + 0.5 * dy, az + 0.5 * dz, -1.0 / length
            reach = math.sqrt(radius * radius + 0.25 * dd) + edge * mz
            row[3], row[4], row[5], row[6], row[7] = s * dx, s * dy, s * dz, edge * mz, radius
            row[8], row[9], row[12], row[13], row[14] = length, 0.0, mx, my, mz
            row[15] = mx * mx + my * my + mz * mz - reach * reach
        else:
            row[3], row[4], row[5], row[6], row[7] = dx, dy, dz, dd, ax * dx + ay * dy + az * dz
            row[8], row[9] = radius, parts[index, RADIUS_B] - radius
            row[12], row[13] = parts[index, TEXTURE], length * parts[index, STRIPES_PER_M]
            row[14], row[15] = parts[index, BANDS], 0.0


@njit(error_model="numpy")
def draw_layers(scene, box, posed, count, ball_m):
    """Write the layers of the pixels in a box where the parts `posed.here[:count]` may be seen.

    The box is (first column, first row, end column, end row), of `SHEET` pixels at most; bodies beyond camera z
    `ball_m` are far.
    """
    # Out of the tuples once: numba counts references to an array each time that it is taken from one.
    maps, layers, view, edge, ambient = scene.maps, scene.layers, scene.numbers, scene.edge_per_m, scene.ambient
    rows, here, found, sheet, sheets = posed.rows, posed.here, posed.found, posed.sheet, posed.sheets
    wide, size = box[2] - box[0], (box[2] - box[0]) * (box[3] - box[1])
    for index in range(SHEET):
        at = min(index, size - 1)
        pixel = (box[1] + at // wide) * scene.width_px + box[0] + at % wide
        x, y = maps[pixel, RAY_X], maps[pixel, RAY_Y]
        sheet[index], sheet[SHEET + index], sheet[2 * SHEET + index] = x, y, x * x + y * y + 1.0
    there = 0
    for place in range(count):
        if draw_sheet(rows[here[place]], sheet, edge, ambient, view):
            sheets[there] = sheet[3 * SHEET :]
            there += 1
    for index in range(size):
        pixel = (box[1] + index // wide) * scene.width_px + box[0] + index % wide
        x, y, depth_m = maps[pixel, RAY_X], maps[pixel, RAY_Y], maps[pixel, DEPTH_M]
        seen = 0
        for place in range(there):
            cover, z = sheets[place, index], sheets[place, 2 * SHEET + index]
            if cover <= 0.0 or z >= depth_m:
                continue
            at = seen  # near to far
            while at > 0 and found[at - 1, 2] > z:
                at -= 1
            if at == PARTS_IN_PIXEL:
                continue
            seen = min(seen + 1, PARTS_IN_PIXEL)
            for later in range(seen - 1, at, -1):
                for column in range(3):
                    found[later, column] = found[later - 1, column]
            found[at, 0], found[at, 1], found[at, 2] = cover, sheets[place, SHEET + index], z
        near_cover = near_light = far_cover = far_light = 0.0
        near_m = far_m = before_net = 0.0
        net, net_light = maps[pixel, NET_COVER], maps[pixel, NET_LIGHT]
        slope, behind_m = view[0] * x + view[1] * y + view[2], math.inf
        for place in range(seen - 1, -1, -1):
            cover, light, z = found[place, 0], found[place, 1], found[place, 2]
            # Where two parts run into each other their seam is an edge too, as wide as all edges where they meet at 45
            # degrees.
            cover *= smooth_step(0.5 + 0.5 * (behind_m - z) / (edge * z))
            behind_m = z
            before = (z * slope + view[9]) * view[9] > 0.0
            if z > ball_m and not (before and net > 0.0):
                far_light += cover * (light - far_light)
                far_cover += cover * (1.0 - far_cover)
                far_m = z
            else:
                near_light += cover * (light - near_light)
                near_cover += cover * (1.0 - near_cover)
                near_m, before_net = z, 1.0 if before else 0.0
        layers[pixel, NEAR_COVER], layers[pixel, NEAR_LIGHT], layers[pixel, NEAR_M] = near_cover, near_light, near_m
        layers[pixel, FAR_COVER], layers[pixel, FAR_LIGHT], layers[pixel, FAR_M] = far_cover, far_light, far_m
        layers[pixel, BEFORE_NET] = before_net
        light = far_light + (1.0 - far_cover) * maps[pixel, LIGHT]
        if before_net == 1.0:
            light = near_light + (1.0 - near_cover) * (net_light + (1.0 - net) * light)
        else:
            light = net_light + (1.0 - net) * (near_light + (1.0 - near_cover) * light)
        layers[pixel, LOG_TOTAL] = math.log(light) if seen else maps[pixel, LOG_LIGHT]


@njit(error_model="numpy")
def light_among(seen, layers, pixel, view, moving):
    """Like `pixel_light`, for a pixel with bodies: ball and robot's racket among its two layers."""
    x, y, depth_m, log_light = seen[RAY_X], seen[RAY_Y], seen[DEPTH_M], seen[LOG_LIGHT]
    cover, near, near_m = layers[pixel, NEAR_COVER], layers[pixel, NEAR_LIGHT], layers[pixel, NEAR_M]
    far_cover = layers[pixel, FAR_COVER]
    behind = layers[pixel, FAR_LIGHT] + (1.0 - far_cover) * seen[LIGHT]
    depth_m = layers[pixel, FAR_M] if far_cover >= 0.5 else depth_m
    net_light, net = seen[NET_LIGHT], seen[NET_COVER]
    room = (x, y, behind, depth_m, net_light, net, log_light)
    if cover == 0.0:
        return pixel_light(room, view, moving)
    moving_m = math.inf
    if moving.see_ball:
        ball = ball_cover(view, moving.ball, x, y, depth_m)
        moving_m = ball.depth_m if ball.cover > 0.0 else moving_m
    if moving.see_racket:
        racket = racket_cover(moving.racket, x, y, depth_m)
        moving_m = min(racket.depth_m, moving_m) if racket.cover > 0.0 else moving_m
    before_net = layers[pixel, BEFORE_NET] == 1.0
    # Painted from back to front: what moves is before the near body, or behind it with the net before or behind both.
    if moving_m < near_m:
        depth_m = near_m if cover >= 0.5 else depth_m
        if before_net:
            behind, net_light, net = net_light + (1.0 - net) * behind, 0.0, 0.0
        behind = near + (1.0 - cover) * behind
        room = (x, y, behind, depth_m, net_light, net, log_light)
        return pixel_light(room, view, Moving(moving.ball, moving.racket, moving.see_ball, False, moving.see_racket))
    if cover >= 1.0:
        return UNTOUCHED
    if before_net:
        light = pixel_light(room, view, moving)
        return UNTOUCHED if light == UNTOUCHED else near + (1.0 - cover) * light
    room = (x, y, behind, depth_m, 0.0, 0.0, log_light)
    light = pixel_light(room, view, moving)
    return UNTOUCHED if light == UNTOUCHED else net_light + (1.0 - net) * (near + (1.0 - cover) * light)


@njit(inline="always", error_model="numpy")
def light_and_rest(seen, layers, pixel, view, moving):
    """Intensity at any pixel, or UNTOUCHED, and the logarithm of the picture there without ball and robot's racket."""
    if len(layers) > 0 and (layers[pixel, NEAR_COVER] > 0.0 or layers[pixel, FAR_COVER] > 0.0):
        return light_among(seen, layers, pixel, view, moving), float(layers[pixel, LOG_TOTAL])
    return pixel_light(seen, view, moving), seen[LOG_LIGHT]
