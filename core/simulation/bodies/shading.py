"""The light of bodies in a pixel, and how ball, net and robot's racket lie before, between and behind them.

Each pixel with bodies has two layers over the room of `core.simulation.scenes.background`: what is nearer to the camera
than the ball, and what is farther. So a ball passes behind an arm and before a trunk in one pixel, edges included.
"""

from __future__ import annotations

import math

from core.jit import njit
from core.simulation.bodies.parts import BANDS, BLADE, KIND, RADIUS_A, RADIUS_B, REFLECTANCE, STRIPES_PER_M, TEXTURE
from core.simulation.scenes.background import DEPTH_M, LIGHT, LOG_LIGHT, NET_COVER, NET_LIGHT, RAY_X, RAY_Y
from core.simulation.scenes.racket_shape import racket_gap
from core.simulation.scenes.shading import UNTOUCHED, ball_cover, pixel_light, racket_cover, smooth_step

NEAR_COVER, NEAR_LIGHT, NEAR_M, FAR_COVER, FAR_LIGHT, FAR_M, BEFORE_NET, LOG_TOTAL = range(8)
"""Columns of a pixel's layers: cover, light weighted by the cover, and camera z of the bodies before the ball; the same
of those behind it; 1 if the near ones are on the camera's side of the net; logarithm of the whole picture without ball
and robot's racket. Both covers are 0 where there is no body."""
POSED_COLUMNS = 16
PARTS_IN_PIXEL = 6
"""Parts that can be seen through one another's edges in one pixel; farther ones are left out."""


@njit(error_model="numpy")
def posed_parts(ends, parts, edge, rows):
    """Write `POSED_COLUMNS` numbers of every part at one instant: what its pixels have in common.

    An edge is `edge` wide per metre of camera z.
    """
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
def part_light(rows, index, x, y, length2, edge, ambient, view):
    """(share of the pixel that a part covers, light there, camera z); `length2` is x^2 + y^2 + 1."""
    row = rows[index]
    ax, ay, az, dx, dy, dz = row[0], row[1], row[2], row[3], row[4], row[5]
    if row[11] == BLADE:
        racket = (ax, ay, az, dx, dy, dz, 0.0, row[6], row[7], row[8], row[12], row[13], row[14], row[15])
        gap, z = racket_gap(racket, x, y)
        return smooth_step(0.5 - gap / row[6]), row[10], z
    inverse = 1.0 / length2
    ar, dr, dd = ax * x + ay * y + az, dx * x + dy * y + dz, row[6]
    across = dd - dr * dr * inverse
    share = min(max((ar * dr * inverse - row[7]) / across, 0.0), 1.0) if across > 1e-12 else 0.0
    cx, cy, cz = ax + share * dx, ay + share * dy, az + share * dz
    along = (ar + share * dr) * inverse
    gap2 = cx * cx + cy * cy + cz * cz - along * along * length2
    radius, width = row[8] + share * row[9], edge * cz
    reach = radius + 0.5 * width
    if gap2 >= reach * reach:
        return 0.0, 0.0, 0.0
    inner = radius - 0.5 * width
    cover = 1.0 if inner > 0.0 and gap2 <= inner * inner else smooth_step((radius - math.sqrt(gap2)) / width + 0.5)
    z = along - math.sqrt(max(radius * radius - gap2, 0.0) * inverse)
    nx, ny, nz = z * x - cx, z * y - cy, z - cz
    scale = 1.0 / radius
    facing = (nx * view[12] + ny * view[13] + nz * view[14]) * scale
    light = row[10] * (ambient + (1.0 - ambient) * 0.5 * (1.0 + facing))
    if row[12] > 0.0:
        wy = (view[3] * nx + view[4] * ny + view[5] * nz) * scale
        light *= 1.0 + 0.5 * row[12] * (_wave(share * row[13] + 0.13) + _wave(wy * row[14] + 0.37))
    return cover, light, z


@njit(error_model="numpy")
def _wave(phase):
    """Between -1 and 1, once up and down per unit; close to a sine and much quicker."""
    u = 2.0 * (phase - math.floor(phase))
    return 4.0 * u * (1.0 - u) if u < 1.0 else 4.0 * (u - 1.0) * (u - 2.0)


@njit(error_model="numpy")
def draw_layers(maps, layers, pixel, posed, here, count, found, scene, ball_m, view):
    """Write the layers of a pixel; `here[:count]` are the parts that may be seen there, `found` is room to sort them.

    `posed` are the rows of `posed_parts`, `scene` is (width of an edge per metre of camera z, ambient share); bodies
    beyond camera z `ball_m` are far.
    """
    x, y, depth_m = float(maps[pixel, RAY_X]), float(maps[pixel, RAY_Y]), float(maps[pixel, DEPTH_M])
    seen, length2 = 0, x * x + y * y + 1.0
    for place in range(count):
        cover, light, z = part_light(posed, here[place], x, y, length2, scene[0], scene[1], view)
        if cover <= 0.0 or z >= depth_m:
            continue
        at = seen  # near to far
        while at > 0 and found[at - 1, 2] > z:
            at -= 1
        if at == PARTS_IN_PIXEL:
            continue
        seen = min(seen + 1, PARTS_IN_PIXEL)
        for later in range(seen - 1, at, -1):
            found[later] = found[later - 1]
        found[at, 0], found[at, 1], found[at, 2] = cover, light, z
    near_cover = near_light = far_cover = far_light = 0.0
    near_m = far_m = before_net = 0.0
    net, net_light = float(maps[pixel, NET_COVER]), float(maps[pixel, NET_LIGHT])
    slope, behind_m = view[0] * x + view[1] * y + view[2], math.inf
    for place in range(seen - 1, -1, -1):
        cover, light, z = found[place, 0], found[place, 1], found[place, 2]
        # Where two parts run into each other their seam is an edge too, as wide as all edges where they meet at 45 deg.
        cover *= smooth_step(0.5 + 0.5 * (behind_m - z) / (scene[0] * z))
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
    light = far_light + (1.0 - far_cover) * float(maps[pixel, LIGHT])
    if before_net == 1.0:
        light = near_light + (1.0 - near_cover) * (net_light + (1.0 - net) * light)
    else:
        light = net_light + (1.0 - net) * (near_light + (1.0 - near_cover) * light)
    layers[pixel, LOG_TOTAL] = math.log(light) if seen else maps[pixel, LOG_LIGHT]


@njit(error_model="numpy")
def light_among(seen, layers, pixel, view, ball, racket, see_ball, see_shadow, see_racket):
    """Like `pixel_light`, for a pixel with bodies: ball and robot's racket among its two layers."""
    x, y, depth_m, log_light = seen[RAY_X], seen[RAY_Y], seen[DEPTH_M], seen[LOG_LIGHT]
    cover, near, near_m = layers[pixel, NEAR_COVER], layers[pixel, NEAR_LIGHT], layers[pixel, NEAR_M]
    far_cover = layers[pixel, FAR_COVER]
    behind = layers[pixel, FAR_LIGHT] + (1.0 - far_cover) * seen[LIGHT]
    depth_m = layers[pixel, FAR_M] if far_cover >= 0.5 else depth_m
    net_light, net = seen[NET_LIGHT], seen[NET_COVER]
    room = (x, y, behind, depth_m, net_light, net, log_light)
    if cover == 0.0:
        return pixel_light(room, view, ball, racket, see_ball, see_shadow, see_racket)
    moving_m = math.inf
    if see_ball:
        share, _, at_m = ball_cover(view, ball, x, y, depth_m)
        moving_m = at_m if share > 0.0 else moving_m
    if see_racket:
        share, at_m = racket_cover(racket, x, y, depth_m)
        moving_m = min(at_m, moving_m) if share > 0.0 else moving_m
    before_net = layers[pixel, BEFORE_NET] == 1.0
    if moving_m < near_m:
        depth_m = near_m if cover >= 0.5 else depth_m
        if before_net:
            behind, net_light, net = net_light + (1.0 - net) * behind, 0.0, 0.0
        behind = near + (1.0 - cover) * behind
        room = (x, y, behind, depth_m, net_light, net, log_light)
        return pixel_light(room, view, ball, racket, see_ball, False, see_racket)
    if cover >= 1.0:
        return UNTOUCHED
    if before_net:
        light = pixel_light(room, view, ball, racket, see_ball, see_shadow, see_racket)
        return UNTOUCHED if light == UNTOUCHED else near + (1.0 - cover) * light
    room = (x, y, behind, depth_m, 0.0, 0.0, log_light)
    light = pixel_light(room, view, ball, racket, see_ball, see_shadow, see_racket)
    return UNTOUCHED if light == UNTOUCHED else net_light + (1.0 - net) * (near + (1.0 - cover) * light)
