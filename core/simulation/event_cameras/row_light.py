"""The light of neighbouring pixels that see nothing but the ball, its shadow or the racket, before the static picture.

The arithmetic is that of `core.simulation.scenes.shading`, for several pixels in one instruction: their numbers lie in
one array at fixed distances, so that the compiler sees that what is written is never what is read, and no branch
depends on a pixel.
"""

from __future__ import annotations

import math

import numpy as np

from core.jit import njit
from core.simulation.bodies.shading import FAR_COVER, NEAR_COVER
from core.simulation.scenes.background import DEPTH_M, LIGHT, LOG_LIGHT, NET_COVER, RAY_X, RAY_Y
from core.simulation.scenes.scene import LIGHT_SIZE
from core.simulation.scenes.shading import smooth_step_in_lanes
from core.simulation.scenes.steps import RACKET, SHADOW
from core.table import BALL_RADIUS_M

ROW = 32
"""Pixels at once."""
X, Y, LENGTH2, BEHIND, DEPTH, STATIC, GOAL, DEEP = (ROW * column for column in range(8))
"""Where the columns of a row begin: the pixels' rays and their squared length, the light and camera z of what is behind
and the logarithm of that light; then, once it is lit, the logarithm of what is seen, and whether that lies deep inside
the ball (1 or 0)."""
ROW_NUMBERS = 8 * ROW
LANES = 8
"""A row is done in groups of so many."""
LN_2 = math.log(2.0)
ROOT_HALF_BITS = int(np.float64(math.sqrt(0.5)).view(np.int64))


@njit(error_model="numpy")
def read_row(maps, layers, first, count, row):
    """Fill a row from the maps; returns whether its pixels show neither the net nor a body."""
    hidden = 0.0
    for index in range(count):
        x, y = maps[first + index, RAY_X], maps[first + index, RAY_Y]
        row[X + index], row[Y + index], row[LENGTH2 + index] = x, y, x * x + y * y + 1.0
        row[BEHIND + index], row[DEPTH + index] = maps[first + index, LIGHT], maps[first + index, DEPTH_M]
        row[STATIC + index] = maps[first + index, LOG_LIGHT]
        hidden += maps[first + index, NET_COVER]
    if len(layers):
        for index in range(count):
            hidden += layers[first + index, NEAR_COVER] + layers[first + index, FAR_COVER]
    return hidden == 0.0


@njit(error_model="numpy")
def light_row(view, moving, part, count, row):
    """Write what is seen of `count` pixels that see no part that moves but this one, or the ball and its shadow."""
    count = (count + LANES - 1) // LANES * LANES  # what is left over would be done one by one
    if part == RACKET:
        _light_racket(moving.racket, count, row)
        return
    if moving.see_shadow:
        _light_shadow(view, moving.ball, count, row)
    if moving.see_ball:
        _light_ball(view, moving.ball, count, row)
    if part == SHADOW:
        for index in range(count):
            row[DEEP + index] = 0.0


@njit(error_model="numpy")
def _light_ball(view, ball, count, row):
    """See `ball_cover`."""
    radius2, edge = BALL_RADIUS_M * BALL_RADIUS_M, ball[4]
    for index in range(count):
        x, y, length2 = row[X + index], row[Y + index], row[LENGTH2 + index]
        along = x * ball[0] + y * ball[1] + ball[2]
        met2 = along * along if along > 0.0 else 0.0
        row[DEEP + index] = 1.0 if met2 > ball[16] * length2 else 0.0
        inside = along * along / length2 - ball[3]
        gap2 = radius2 - inside
        cover = smooth_step_in_lanes((BALL_RADIUS_M - math.sqrt(gap2 if gap2 > 0.0 else 0.0)) / edge + 0.5)
        half2 = inside * length2
        near = (along - math.sqrt(half2 if half2 > 0.0 else 0.0)) / length2
        px, py, pz = near * x, near * y, near
        cover *= smooth_step_in_lanes((ball[5] * px + ball[6] * py + ball[7] * pz - ball[8]) / edge)
        cover = cover if met2 > ball[15] * length2 else 0.0
        cover = cover if near < row[DEPTH + index] else 0.0
        facing = ((px - ball[0]) * view[12] + (py - ball[1]) * view[13] + (pz - ball[2]) * view[14]) / BALL_RADIUS_M
        shade = ball[13] * (ball[14] + (1.0 - ball[14]) * 0.5 * (1.0 + facing))
        behind = row[BEHIND + index]
        light = _log(behind + cover * (shade - behind))
        row[GOAL + index] = light if cover > 0.0 else row[STATIC + index]


@njit(error_model="numpy")
def _light_shadow(view, ball, count, row):
    """See `shadow_darkness`; the ball has this behind it."""
    for index in range(count):
        x, y, depth = row[X + index], row[Y + index], row[DEPTH + index]
        sx = depth * (view[0] * x + view[1] * y + view[2]) + view[9] - ball[9]
        sy = depth * (view[3] * x + view[4] * y + view[5]) + view[10] - ball[10]
        sz = depth * (view[6] * x + view[7] * y + view[8]) + view[11] - ball[11]
        toward = -(sx * view[15] + sy * view[16] + sz * view[17])
        lights = LIGHT_SIZE * toward
        width = lights + ball[4]
        reach = BALL_RADIUS_M + 0.5 * width
        gap2 = sx * sx + sy * sy + sz * sz - toward * toward
        cover = smooth_step_in_lanes((BALL_RADIUS_M - math.sqrt(gap2 if gap2 > 0.0 else 0.0)) / width + 0.5)
        hidden = 2.0 * BALL_RADIUS_M / lights
        hidden = hidden if lights > 2.0 * BALL_RADIUS_M else 1.0
        darkness = ball[12] * cover * hidden * hidden
        darkness = darkness if toward > 0.0 else 0.0
        darkness = darkness if gap2 < reach * reach else 0.0
        behind = (1.0 - darkness) * row[BEHIND + index]
        light = _log(behind)
        light = light if darkness > 0.0 else row[STATIC + index]
        row[BEHIND + index], row[STATIC + index], row[GOAL + index] = behind, light, light


@njit(error_model="numpy")
def _light_racket(racket, count, row):
    """See `racket_cover` and `racket_gap`; both sides of each of their branches are worked out."""
    radius, thickness, edge, dark = racket[8], racket[9], racket[7], racket[6]
    nc = racket[3] * racket[0] + racket[4] * racket[1] + racket[5] * racket[2]
    cc = racket[0] * racket[0] + racket[1] * racket[1] + racket[2] * racket[2]
    C = max(cc - nc * nc, 0.0)
    log_dark = math.log(dark)
    for index in range(count):
        x, y, length2 = row[X + index], row[Y + index], row[LENGTH2 + index]
        along = x * racket[10] + y * racket[11] + racket[12]
        nd = racket[3] * x + racket[4] * y + racket[5]
        dc = x * racket[0] + y * racket[1] + racket[2]
        A, B = length2 - nd * nd, dc - nd * nc
        A = A if A > 1e-12 else 1e-12
        t = B / A
        height = t * nd - nc
        gap2 = C - B * B / A
        gap = math.sqrt(gap2 if gap2 > 0.0 else 0.0) - radius
        faces = height >= -thickness - height
        beyond = height if faces else -thickness - height
        slope, start = nd if faces else -nd, -nc if faces else nc - thickness
        k = radius + start
        a, b, c = A - slope * slope, B + k * slope, C - k * k
        root2 = b * b - a * c
        root = math.sqrt(root2 if root2 > 0.0 else 0.0)
        one, other = (b - root) / a, (b + root) / a
        low, high = one if one < other else other, other if one < other else one
        before, after = high if high <= t else low, low if low >= t else high
        met = before if slope > 0.0 else after
        only = c / (2.0 * b) if b != 0.0 else t
        met = only if abs(a) < 1e-12 else met
        met_gap = start + slope * met
        level = abs(slope) < 1e-9
        met_gap, met = beyond if level else met_gap, t if level else met
        met_gap = met_gap if met_gap > -0.5 * thickness else -0.5 * thickness
        t = met if beyond > gap else t
        gap = met_gap if beyond > gap else gap
        enter2 = B * B - A * (C - radius * radius)
        enter = (B - math.sqrt(enter2 if enter2 > 0.0 else 0.0)) / A
        through = (nc if nd < 0.0 else nc - thickness) / nd
        through = through if abs(nd) > 1e-9 else enter
        enter = through if through > enter else enter
        t = enter if gap < 0.0 else t
        cover = smooth_step_in_lanes(0.5 - gap / edge)
        met2 = along * along if along > 0.0 else 0.0
        cover = cover if met2 > racket[13] * length2 else 0.0
        cover = cover if t < row[DEPTH + index] else 0.0
        behind = row[BEHIND + index]
        light = _log(behind + cover * (dark - behind))
        light = light if cover < 1.0 else log_dark
        row[GOAL + index] = light if cover > 0.0 else row[STATIC + index]
        row[DEEP + index] = 0.0


@njit(inline="always", error_model="numpy")
def _log(value):
    """Logarithm of a positive number to 1e-15 without a call: 2 atanh((m - 1) / (m + 1)) of its mantissa m."""
    bits = np.float64(value).view(np.int64)
    exponent = (bits - ROOT_HALF_BITS) >> 52
    mantissa = np.int64(bits - (exponent << 52)).view(np.float64)  # from sqrt(1/2) to sqrt(2)
    z = (mantissa - 1.0) / (mantissa + 1.0)
    w = z * z
    tail = 1 / 9 + w * (1 / 11 + w * (1 / 13 + w * (1 / 15 + w / 17)))
    return 2.0 * z * (1.0 + w * (1 / 3 + w * (1 / 5 + w * (1 / 7 + w * tail)))) + exponent * LN_2
