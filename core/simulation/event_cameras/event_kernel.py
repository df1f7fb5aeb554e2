"""Walk through the substeps of a block and touch only pixels that ball, shadow, racket and bodies sweep over.

Neighbouring pixels that see nothing but the ball, its shadow or the racket before the static picture are done several
in one instruction, with the arithmetic of `core.simulation.scenes.shading`: their numbers lie in one array at fixed
distances, so that the compiler sees that what is written is never what is read, and no branch depends on a pixel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.simulation.bodies.shading import (
    FAR_COVER,
    LOG_TOTAL,
    NEAR_COVER,
    PosedBodies,
    light_and_rest,
    posed_bodies,
)
from core.simulation.bodies.tile_updates import REST_PX, UPDATE_PX, mark_moved, pose_at, update_tiles
from core.simulation.scenes.background import DEPTH_M, LIGHT, LOG_LIGHT, NET_COVER, RAY_X, RAY_Y
from core.simulation.scenes.ball_view import NO_RIM, ball_rim_between, rim_columns
from core.simulation.scenes.block_view import (
    BALL,
    RACKET,
    SHADOW,
    boxes_meet,
    flicker_all_pixels,
    is_looked_at,
    moving_at,
    union_box,
)
from core.simulation.scenes.racket_view import outline_spans, rows_for_spans, unchanged_columns
from core.simulation.scenes.scene import LIGHT_SIZE
from core.simulation.scenes.shading import (
    INNER_STRIDE,
    UNTOUCHED,
    deep_inside,
    pixel_light,
    pixel_seen,
    smooth_step_in_lanes,
)
from core.simulation.sensor.pixels import (
    EVENTS_PER_PIXEL,
    follow_pixel,
    receptor_decay,
    rest_pixel,
    uncounted,
    wake_pixel,
)
from core.simulation.sensor.sensor import RECEPTOR, REFERENCE, TARGET, TIME_US
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
        # The quadratic of a ray along the cone's side has one root.
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


class Observation(NamedTuple):
    """One look at a part of the picture."""

    swing: float
    """Logarithm of the factor on all light at that time (flicker)."""
    before_us: float
    """The look before it."""
    recent_us: float
    """The look before it of the inner part of the ball, which is looked at less often."""
    now_us: float
    decay: float
    recent_decay: float
    """Decay of the receptor since `before_us` and `recent_us`."""
    skip_deep: bool
    """That inner part is not looked at now."""


class Scratch(NamedTuple):
    """Room that the substeps of a block work in."""

    posed: PosedBodies
    spans_before: NDArray[np.float64]
    """The racket's outline at the last look at it, see `rows_for_spans`."""
    spans_now: NDArray[np.float64]
    row: NDArray[np.float64]
    """(ROW_NUMBERS,) see `core.simulation.event_cameras.event_kernel`."""


@njit(error_model="numpy")
def event_kernel_block(pixels, scene, steps, probes, updates, timing, events, done):
    """Run substeps `done + 1` to the last with the bodies at the block's `probes`; returns the last one done.

    Stops early when the buffer might overflow in the next substep; call again with a larger one.
    """
    posed = posed_bodies(np.empty((len(scene.parts), 2, 3)), np.empty((len(scene.parts), 2, 3)))
    spans_before, spans_now = rows_for_spans(steps.boxes[:, RACKET]), rows_for_spans(steps.boxes[:, RACKET])
    scratch = Scratch(posed, spans_before, spans_now, np.empty(ROW_NUMBERS))
    return _substeps(pixels, scene, steps, (probes, updates), scratch, timing, events, done)


@njit(error_model="numpy")
def _substeps(pixels, scene, steps, bodies, scratch, timing, events, done):
    pixels, scene, steps, scratch = uncounted(pixels), uncounted(scene), uncounted(steps), uncounted(scratch)
    (probes, updates), events = uncounted(bodies), uncounted(events)
    last, swing, posed, stride = len(steps.t_us) - 1, steps.swing, scratch.posed, steps.strides[RACKET]
    if stride:
        outline_spans(steps.outlines[done // stride * stride], scratch.spans_before)
    for step in range(done + 1, last + 1):
        if not has_room(steps, step, events):
            return step - 1
        if len(scene.parts):
            pose_at(probes.ends, step / last, posed.ends)
            pose_at(probes.circles, step / last, posed.circles)
            mark_moved(posed.circles, UPDATE_PX if step < last else REST_PX, updates)
            finished = update_tiles(pixels, scene, steps, step, posed, updates, timing, events)
            if not finished or not has_room(steps, step, events):
                return step - 1
        event_kernel_step(pixels, scene, steps, step, scratch, timing, events)
        updates_all = len(swing.log_light) and (step % swing.stride == 0 or step == last)
        if updates_all and not flicker_all_pixels(pixels, scene.width_px, steps, step, timing, events):
            return step - 1
    return last


@njit(error_model="numpy")
def has_room(steps, step, events):
    """Whether the buffer holds the most events that ball, shadow and racket may make in a substep."""
    most, boxes = 0, steps.boxes
    for part in range(boxes.shape[1]):
        if is_looked_at(steps, step, part):
            stride = steps.strides[part]
            x0, y0, x1, y1 = union_box(boxes[(step - 1) // stride * stride, part], boxes[step, part])
            most += (x1 - x0) * (y1 - y0)
    return events.filled[0] + most * EVENTS_PER_PIXEL <= len(events.rows)


@njit(error_model="numpy")
def event_kernel_step(pixels, scene, steps, step, scratch, timing, events):
    """One substep of ball, shadow and racket."""
    # Out of the tuples once: numba counts references to an array each time that it is taken from one.
    event_rows, maps = events.rows, scene.maps
    t_us, boxes, last = steps.t_us, steps.boxes, len(steps.t_us) - 1
    now_us, count = t_us[step], events.filled[0]
    still = len(steps.swing.log_light) == 0  # otherwise all pixels of a box change
    swing = 0.0 if still else steps.swing.log_light[step]
    row, spans_before, spans_now = scratch.row, scratch.spans_before, scratch.spans_now
    for part in range(boxes.shape[1]):
        if not is_looked_at(steps, step, part):
            continue
        before = (step - 1) // steps.strides[part] * steps.strides[part]
        swept = (
            union_box(boxes[before, BALL], boxes[step, BALL]),
            union_box(boxes[before, SHADOW], boxes[step, SHADOW]),
            union_box(boxes[before, RACKET], boxes[step, RACKET]),
        )
        x0, y0, x1, y1 = swept[part]
        before_us, recent_us = t_us[before], t_us[max(step - INNER_STRIDE, 0)]
        if part == RACKET:
            see_ball, see_shadow = boxes_meet(swept[BALL], swept[RACKET]), boxes_meet(swept[SHADOW], swept[RACKET])
            see_racket = True
            outline_spans(steps.outlines[step], spans_now)
        else:
            overlap = boxes_meet(boxes[step, BALL], union_box(boxes[step, SHADOW], boxes[step, SHADOW]))
            see_ball, see_shadow = part == BALL or overlap, part == SHADOW or overlap
            see_racket = boxes_meet(swept[part], swept[RACKET])
        moving = moving_at(steps, step, see_ball, see_shadow, see_racket)
        in_rows = not see_racket or not (see_ball or see_shadow)
        skip_deep = step % INNER_STRIDE != 0 and step != last
        decays = receptor_decay(before_us, now_us, timing), receptor_decay(recent_us, now_us, timing)
        rims = part == BALL and not see_racket and still and x1 > x0
        rim = NO_RIM
        if rims:
            rim = ball_rim_between(maps, scene.width_px, swept[BALL], steps.rows[before], moving.ball, skip_deep)
        look = Observation(swing, before_us, recent_us, now_us, decays[0], decays[1], skip_deep)
        for y in range(y0, y1):
            line, left, right, first, end = y * scene.width_px, x1, x1, x0, x1
            if part == RACKET:  # only where its outline passes
                first, left, right, end = unchanged_columns(spans_before, spans_now, y, x0, x1)
            elif rims:
                first, left, right, end = rim_columns(maps, line, x0, x1, rim)
                if see_shadow:
                    first, end = x0, x1
                count = see_room(pixels, scene, line + x0, line + first, look, timing, event_rows, count)
            for start, stop in ((line + first, line + left), (line + right, line + end)):
                shown = start, stop, part, in_rows
                count = see_segment(pixels, scene, row, shown, (moving, look), timing, event_rows, count)
            if rims:
                count = see_room(pixels, scene, line + end, line + x1, look, timing, event_rows, count)
        if part == RACKET:
            spans_before[:] = spans_now
    events.filled[0] = count


@njit(inline="always", error_model="numpy")
def see_segment(pixels, scene, row, shown, view, timing, event_rows, count):
    """Let neighbouring pixels see what moves; returns the new event count.

    `shown` are the first pixel, one past the last, the part that is looked at, and whether rows may be lit at once.
    """
    rows, active, maps, layers = pixels.rows, pixels.active, scene.maps, scene.layers
    (start, stop, part, in_rows), (moving, look) = shown, view
    while in_rows and start < stop:
        wide = min(ROW, stop - start)
        if not read_row(maps, layers, start, wide, row):
            break  # the rest one by one
        light_row(scene.numbers, moving, part, wide, row)
        count = follow_row(pixels, start, wide, row, look, timing, event_rows, count)
        start += wide
    for pixel in range(start, stop):
        if rows[pixel, TIME_US] >= look.now_us:
            continue  # parts overlap here
        seen = pixel_seen(maps, pixel)
        deep = part == BALL and not moving.see_racket and deep_inside(seen, moving.ball)
        if deep and look.skip_deep:
            continue
        light, rest = light_and_rest(seen, layers, pixel, scene.numbers, moving)
        goal = look.swing + (rest if light == UNTOUCHED else math.log(light))
        if goal == rows[pixel, TARGET]:
            continue  # at rest, which is caught up with in closed form when it ends
        if not active[pixel]:
            wake_pixel(pixels, pixel)
        count = see(rows, pixel, goal, deep, look, timing, event_rows, count)
    return count


@njit(error_model="numpy")
def follow_row(pixels, first, wide, row, look, timing, event_rows, count):
    """Let neighbouring pixels see what is written in a row of `row_light`; returns the new event count."""
    rows, active = pixels.rows, pixels.active
    for index in range(wide):
        pixel, deep = first + index, row[DEEP + index] == 1.0
        if deep and look.skip_deep:
            continue
        goal = look.swing + row[GOAL + index]
        if goal == rows[pixel, TARGET] or rows[pixel, TIME_US] >= look.now_us:
            continue
        if not active[pixel]:
            wake_pixel(pixels, pixel)
        count = see(rows, pixel, goal, deep, look, timing, event_rows, count)
    return count


@njit(error_model="numpy")
def see_room(pixels, scene, first, end, look, timing, event_rows, count):
    """Let pixels see the picture without ball and robot's racket; returns the new event count."""
    rows, maps, layers = pixels.rows, scene.maps, scene.layers
    for pixel in range(first, end):
        goal = float(maps[pixel, LOG_LIGHT])
        if len(layers) and (layers[pixel, NEAR_COVER] > 0.0 or layers[pixel, FAR_COVER] > 0.0):
            goal = float(layers[pixel, LOG_TOTAL])
        if goal == rows[pixel, TARGET] or rows[pixel, TIME_US] >= look.now_us:
            continue
        if not pixels.active[pixel]:
            wake_pixel(pixels, pixel)
        count = see(rows, pixel, goal, False, look, timing, event_rows, count)
    return count


@njit(inline="always", error_model="numpy")
def see(rows, pixel, goal, deep, look, timing, event_rows, count):
    """Let a pixel that is awake see a log intensity; returns the new event count."""
    start_us = rows[pixel, TIME_US]
    if start_us < (look.recent_us if deep else look.before_us):
        count = rest_pixel(rows, pixel, look.before_us, timing, event_rows, count)
        start_us = look.before_us
    if start_us == look.before_us:
        fall = look.decay
    elif start_us == look.recent_us:
        fall = look.recent_decay
    else:
        fall = receptor_decay(start_us, look.now_us, timing)
    return follow_pixel(rows, pixel, goal, look.now_us, fall, timing, event_rows, count)


@njit(error_model="numpy")
def update_spans(pixels, scene, steps, probes, updates, timing, events):
    """Let pixels have looked at what is there for long: how a recording begins."""
    boxes, start = steps.boxes, np.int64(0)  # a literal would have kernels compiled twice
    see_ball, see_shadow, see_racket = boxes[0, BALL].any(), boxes[0, SHADOW].any(), boxes[0, RACKET].any()
    moving = moving_at(steps, start, see_ball, see_shadow, see_racket)
    for part in range(boxes.shape[1]):
        for y in range(boxes[0, part, 1], boxes[0, part, 3]):
            for x in range(boxes[0, part, 0], boxes[0, part, 2]):
                pixel = y * scene.width_px + x
                seen = pixel_seen(scene.maps, pixel)
                light = pixel_light(seen, scene.numbers, moving)
                goal = seen[LOG_LIGHT] if light == UNTOUCHED else math.log(light)
                pixels.rows[pixel, TARGET] = pixels.rows[pixel, RECEPTOR] = pixels.rows[pixel, REFERENCE] = goal
    if len(scene.parts):
        mark_moved(probes.circles[0], 0.0, updates)
        posed = posed_bodies(probes.ends[0], probes.circles[0])
        update_tiles(pixels, scene, steps, start, posed, updates, timing, events)
