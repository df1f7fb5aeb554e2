"""One part of a body in many pixels at once: the same arithmetic for all of them, so that the processor does several in
one instruction.

The numbers lie in one array at fixed distances from one another, so the compiler sees that what is written is never
what is read. No branch depends on a pixel.
"""

from __future__ import annotations

import math

import numpy as np

from core.jit import njit
from core.simulation.bodies.parts import BLADE
from core.simulation.scenes.racket_shape import racket_gap
from core.simulation.scenes.shading import smooth_step, smooth_step_in_lanes

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
