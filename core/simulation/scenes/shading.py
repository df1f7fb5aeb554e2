"""The light that a pixel sees: the ball, its shadow, the racket, the net before or behind them.

A pixel's ray is tested against the sphere itself, so perspective and lens distortion are exact. The ball covers half of
a pixel exactly where its outline passes through the pixel's centre; the cover rises smoothly over `edge_px` round that.

The functions for one pixel take numbers and tuples of numbers, never arrays: numba counts references to every array at
every call, which cost several times the arithmetic (37 instead of 8 ns for a pixel that the ball does not touch).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from core.jit import njit
from core.simulation.scenes.background import DEPTH_M, LIGHT, LOG_LIGHT, NET_COVER, NET_LIGHT, RAY_X, RAY_Y
from core.simulation.scenes.racket_view import racket_gap
from core.simulation.scenes.scene import LIGHT_SIZE
from core.table import BALL_RADIUS_M

UNTOUCHED = -1.0
"""Instead of an intensity: nothing that moves is here, the pixel sees the static picture."""

INNER_STRIDE = 4
"""Substeps from one look at the inner part of the ball to the next: its shading changes by 0.01 in a substep."""
BALL_COLUMNS = 17
"""A row that describes the ball at one instant to one camera:
0-2 centre in the camera's frame, 3 squared length of a tangent to it, 4 width of an edge at it in metres,
5-7 normal and 8 offset of the portal in the camera's frame, 9-11 centre in the world,
12 darkness of its shadow, 13 light of the fully lit ball, 14 ambient share,
15 squared length of a tangent to the sphere that an edge of that width reaches, 16 the same of the sphere inside which
nothing but the smooth shading changes for some substeps."""
VIEW_NUMBERS = 18
"""A camera: 0-8 rotation to the world by rows, 9-11 position, 12-14 direction to the light in the camera's frame, 15-17
the same in the world."""


class Moving(NamedTuple):
    """Ball and robot's racket at one instant to one camera, and which of them can be at the pixels in question."""

    ball: tuple[float, ...]
    """BALL_COLUMNS numbers."""
    racket: tuple[float, ...]
    """RACKET_COLUMNS numbers."""
    see_ball: bool
    see_shadow: bool
    see_racket: bool


class Fragment(NamedTuple):
    """What a body adds to a pixel."""

    cover: float
    """Share of the pixel that it covers."""
    light: float
    """Its intensity there."""
    depth_m: float
    """Camera z of the point that is seen."""


NOTHING = Fragment(0.0, 0.0, 0.0)


@njit(error_model="numpy")
def smooth_step(share):
    """0 below 0, 1 above 1, smooth between; symmetric round 1/2."""
    if share <= 0.0:
        return 0.0
    if share >= 1.0:
        return 1.0
    return share * share * (3.0 - 2.0 * share)


@njit(inline="always", error_model="numpy")
def smooth_step_in_lanes(share):
    """`smooth_step` without a branch, for loops over several pixels in one instruction."""
    share = share if share > 0.0 else 0.0
    share = share if share < 1.0 else 1.0
    return share * share * (3.0 - 2.0 * share)


@njit(error_model="numpy")
def pixel_light(seen, view, moving):
    """Intensity at a pixel whose static picture is `seen`, or UNTOUCHED."""
    x, y, behind, depth_m = seen[RAY_X], seen[RAY_Y], seen[LIGHT], seen[DEPTH_M]
    ball = ball_cover(view, moving.ball, x, y, depth_m) if moving.see_ball else NOTHING
    if moving.see_racket:
        racket = racket_cover(moving.racket, x, y, depth_m)
        if racket.cover == 1.0 and seen[NET_COVER] == 0.0 and (ball.cover == 0.0 or ball.depth_m > racket.depth_m):
            return racket.light
        if racket.cover > 0.0:
            shaded = moving.see_shadow and racket.cover < 1.0
            darkness = shadow_darkness(view, moving.ball, x, y, depth_m) if shaded else 0.0
            return _with_racket(seen, view, (1.0 - darkness) * behind, racket, ball)
    cover, shade, hit = ball
    darkness = shadow_darkness(view, moving.ball, x, y, depth_m) if moving.see_shadow and cover < 1.0 else 0.0
    if darkness == 0.0 and cover == 0.0:
        return UNTOUCHED
    behind *= 1.0 - darkness
    net = seen[NET_COVER]
    if net == 0.0:
        return behind + cover * (shade - behind)
    # The point of the ball that is seen lies on one side of the net's plane x = 0; is it the camera's?
    x_world = hit * (view[0] * x + view[1] * y + view[2]) + view[9]
    if x_world * view[9] > 0.0:
        behind = seen[NET_LIGHT] + (1.0 - net) * behind
        return behind + cover * (shade - behind)
    return seen[NET_LIGHT] + (1.0 - net) * (behind + cover * (shade - behind))


@njit(error_model="numpy")
def racket_cover(racket, x, y, depth_m):
    """The racket in a pixel whose static picture is `depth_m` away; its numbers are named at RACKET_COLUMNS."""
    gap, where = racket_gap(racket, x, y)
    cover = smooth_step(0.5 - gap / racket[7])
    return Fragment(0.0 if where >= depth_m else cover, racket[6], where)


@njit(error_model="numpy")
def _with_racket(seen, view, light, racket, ball):
    """The light behind, the racket and the ball, laid over one another from far to near, with the net in its place."""
    far, near = (ball, racket) if ball.depth_m > racket.depth_m else (racket, ball)
    net, x = seen[NET_COVER], view[0] * seen[RAY_X] + view[1] * seen[RAY_Y] + view[2]
    far_before_net = (far.depth_m * x + view[9]) * view[9] > 0.0
    near_before_net = (near.depth_m * x + view[9]) * view[9] > 0.0
    if net > 0.0 and far_before_net:
        light, net = seen[NET_LIGHT] + (1.0 - net) * light, 0.0
    light += far.cover * (far.light - light)
    if net > 0.0 and near_before_net:
        light, net = seen[NET_LIGHT] + (1.0 - net) * light, 0.0
    light += near.cover * (near.light - light)
    return seen[NET_LIGHT] + (1.0 - net) * light if net > 0.0 else light


@njit(error_model="numpy")
def ball_cover(view, ball, x, y, depth_m):
    """The ball in a pixel whose static picture is `depth_m` away; numbers as at VIEW_NUMBERS and BALL_COLUMNS."""
    length2 = x * x + y * y + 1.0
    along = x * ball[0] + y * ball[1] + ball[2]
    if along <= 0.0 or along * along <= ball[15] * length2:
        return NOTHING
    inside = along * along / length2 - ball[3]  # squared radius minus squared distance of the centre from the ray
    gap = math.sqrt(max(BALL_RADIUS_M * BALL_RADIUS_M - inside, 0.0))
    cover = smooth_step((BALL_RADIUS_M - gap) / ball[4] + 0.5)
    near = (along - math.sqrt(max(inside * length2, 0.0))) / length2
    if near >= depth_m:
        return NOTHING
    px, py, pz = near * x, near * y, near
    beyond_m = ball[5] * px + ball[6] * py + ball[7] * pz - ball[8]
    if beyond_m < ball[4]:
        cover *= smooth_step(beyond_m / ball[4])
    facing = ((px - ball[0]) * view[12] + (py - ball[1]) * view[13] + (pz - ball[2]) * view[14]) / BALL_RADIUS_M
    lit = ball[14] + (1.0 - ball[14]) * 0.5 * (1.0 + facing)
    return Fragment(cover, ball[13] * lit, near)


@njit(error_model="numpy")
def deep_inside(seen, ball):
    """Whether a pixel looks at the inner part of the ball, where the light changes slowly."""
    x, y = seen[RAY_X], seen[RAY_Y]
    along = x * ball[0] + y * ball[1] + ball[2]
    return along > 0.0 and along * along > ball[16] * (x * x + y * y + 1.0)


@njit(error_model="numpy")
def shadow_darkness(view, ball, x, y, depth_m):
    """How much of the light the ball takes from the surface behind a pixel, 0..1."""
    sx = depth_m * (view[0] * x + view[1] * y + view[2]) + view[9] - ball[9]
    sy = depth_m * (view[3] * x + view[4] * y + view[5]) + view[10] - ball[10]
    sz = depth_m * (view[6] * x + view[7] * y + view[8]) + view[11] - ball[11]
    toward = -(sx * view[15] + sy * view[16] + sz * view[17])
    if toward <= 0.0:
        return 0.0
    width = LIGHT_SIZE * toward + ball[4]
    reach = BALL_RADIUS_M + 0.5 * width
    gap2 = sx * sx + sy * sy + sz * sz - toward * toward
    if gap2 >= reach * reach:
        return 0.0
    cover = smooth_step((BALL_RADIUS_M - math.sqrt(max(gap2, 0.0))) / width + 0.5)
    # Where the lights look larger than the ball, it hides only a part of them even in the middle.
    hidden = 2.0 * BALL_RADIUS_M / (LIGHT_SIZE * toward) if LIGHT_SIZE * toward > 2.0 * BALL_RADIUS_M else 1.0
    return ball[12] * cover * hidden * hidden


@njit(error_model="numpy")
def pixel_seen(maps, pixel):
    """The row of the background's maps as a tuple of numbers, of the types that it also has among bodies."""
    light, net_light, net_cover = maps[pixel, LIGHT], maps[pixel, NET_LIGHT], maps[pixel, NET_COVER]
    lights = np.float64(light), maps[pixel, DEPTH_M], np.float64(net_light), np.float64(net_cover)
    return maps[pixel, RAY_X], maps[pixel, RAY_Y], *lights, maps[pixel, LOG_LIGHT]
