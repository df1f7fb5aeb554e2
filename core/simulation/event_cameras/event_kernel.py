"""Walk through the substeps of a block and touch only pixels that ball, shadow, racket and bodies sweep over."""

from __future__ import annotations

import math

import numpy as np

from core.jit import njit
from core.simulation.bodies.shading import FAR_COVER, LOG_TOTAL, NEAR_COVER, light_among
from core.simulation.bodies.tile_updates import REST_PX, UPDATE_PX, mark_moved, pose_at, update_tiles
from core.simulation.scenes.background import LOG_LIGHT
from core.simulation.scenes.flicker import flicker_all_pixels
from core.simulation.scenes.racket_outline import outline_spans, rows_for_spans, unchanged_columns
from core.simulation.scenes.shading import INNER_STRIDE, UNTOUCHED, deep_inside, pixel_light, pixel_seen
from core.simulation.sensor.pixels import follow_pixel, rest_pixel, settle_active
from core.simulation.sensor.sensor import RECEPTOR, REFERENCE, TARGET, TIME_US

BALL, SHADOW, RACKET = range(3)
"""Parts of the picture that move, in the order in which they are looked at."""
EVENTS_PER_PIXEL = 128
"""Room kept free in the buffers for each pixel of a substep; contrast 5 at the lowest threshold is 250 in a step, but
only of the few pixels of an edge."""


@njit(error_model="numpy")
def event_kernel_block(
    pixels,
    active,
    active_list,
    active_count,
    shape,
    maps,
    layers,
    view,
    t_us,
    rows,
    rackets,
    outlines,
    boxes,
    strides,
    swings,
    swing_stride,
    sensor,
    bodies,
    looks,
    events,
    done,
):
    """Run substeps `done + 1` to the last; returns (event count, awake count, substeps done).

    Part p of the boxes is looked at in every `strides[p]`-th substep and in the last; never if that is 0. `swings` is
    the swing of the light at every substep, empty if there is none; all pixels are told every `swing_stride` substeps.
    `sensor` is (photoreceptor time constant, refractory time, events already in the buffer). `bodies` is (poses and
    circles of all bodies at the block's probes, their parts, (width of an edge per metre, ambient share)), `looks` what
    `update_tiles` needs with the circles of the last look. Stops early when the buffer might overflow in the next
    substep; call again with a larger one.
    """
    count, last = int(sensor[2]), len(t_us) - 1
    probes, probed_circles, parts, scene = bodies
    looked, marks, tiles, listed, tile_us = looks
    ends, circles = np.empty((len(parts), 2, 3)), np.empty((len(parts), 2, 3))
    spans_before, spans_now = rows_for_spans(boxes[:, RACKET]), rows_for_spans(boxes[:, RACKET])
    for step in range(done + 1, last + 1):
        if room_for(boxes, strides, step, last) + count > len(events):
            return count, active_count, step - 1
        ball, racket = ball_numbers(rows, step), racket_numbers(rackets, step)
        swing = swings[step] if len(swings) else 0.0
        if len(parts):
            pose_at(probes, step / last, ends)
            pose_at(probed_circles, step / last, circles)
            mark_moved(circles, looked, UPDATE_PX if step < last else REST_PX, shape, marks, tiles, listed)
            count, active_count, finished = update_tiles(
                pixels, active, active_list, active_count, shape, maps, layers, view, ends, circles, parts, scene,
                (marks, tiles, listed, tile_us), t_us[step], t_us[0], ball, racket,
                boxes[step, BALL], boxes[step, SHADOW], boxes[step, RACKET], swing, sensor, events, count,
            )  # fmt: skip
            if not finished or room_for(boxes, strides, step, last) + count > len(events):
                return count, active_count, step - 1
        count, active_count = event_kernel_step(
            pixels, active, active_list, active_count, shape[0], maps, layers, len(parts) > 0, view, t_us, ball, racket,
            outlines, boxes, strides, swing, sensor, events, count, step, spans_before, spans_now,
        )  # fmt: skip
        if len(swings) and (step % swing_stride == 0 or step == last):
            count, active_count, finished = flicker_all_pixels(
                pixels, active, active_list, active_count, shape[0], t_us, swings, step, sensor, events, count
            )
            if not finished:
                return count, active_count, step - 1
    return count, active_count, last


@njit(error_model="numpy")
def room_for(boxes, strides, step, last):
    """Most events that ball, shadow and racket may make in a substep."""
    most = 0
    for part in range(boxes.shape[1]):
        if strides[part] != 0 and (step % strides[part] == 0 or step == last):
            x0, y0, x1, y1 = union_box(boxes[(step - 1) // strides[part] * strides[part], part], boxes[step, part])
            most += (x1 - x0) * (y1 - y0)
    return most * EVENTS_PER_PIXEL


@njit(error_model="numpy")
def event_kernel_step(
    pixels, active, active_list, active_count, width, maps, layers, among, view, t_us, ball, racket,
    outlines, boxes, strides, swing, sensor, events, count, step, spans_before, spans_now,
):  # fmt: skip
    """One substep of ball, shadow and racket; returns (event count, awake count). `among`: there are bodies."""
    tau_us, refractory_us, now_us, last = sensor[0], sensor[1], t_us[step], len(t_us) - 1
    for part in range(boxes.shape[1]):
        if strides[part] == 0 or (step % strides[part] != 0 and step != last):
            continue
        before = (step - 1) // strides[part] * strides[part]
        x0, y0, x1, y1 = union_box(boxes[before, part], boxes[step, part])
        before_us, recent_us = t_us[before], t_us[max(step - INNER_STRIDE, 0)]
        overlap = boxes_meet(boxes[step, BALL], boxes[step, SHADOW])
        see_ball, see_shadow, see_racket = part == BALL or overlap, part == SHADOW or overlap, part == RACKET
        if part != RACKET:
            see_racket = spans_meet(boxes, before, step, part, RACKET)
        else:
            see_ball = spans_meet(boxes, before, step, RACKET, BALL)
            see_shadow = spans_meet(boxes, before, step, RACKET, SHADOW)
            outline_spans(outlines[before], spans_before)
            outline_spans(outlines[step], spans_now)
        decay = math.exp((before_us - now_us) / tau_us) if tau_us > 0.0 else 0.0
        for y in range(y0, y1):
            left, right, first, end = x1, x1, x0, x1
            if part == RACKET:  # only where its outline passes
                first, left, right, end = unchanged_columns(spans_before, spans_now, y, x0, x1)
            for x in range(first, end):
                if left <= x < right:
                    continue
                pixel = y * width + x
                start_us = pixels[pixel, TIME_US]
                if start_us >= now_us:
                    continue  # parts overlap here
                seen = pixel_seen(maps, pixel)
                deep = part == BALL and not see_racket and deep_inside(seen, ball)
                if deep and step % INNER_STRIDE != 0 and step != last:
                    continue
                if among and (layers[pixel, NEAR_COVER] > 0.0 or layers[pixel, FAR_COVER] > 0.0):
                    light = light_among(seen, layers, pixel, view, ball, racket, see_ball, see_shadow, see_racket)
                    rest = float(layers[pixel, LOG_TOTAL])
                else:
                    light = pixel_light(seen, view, ball, racket, see_ball, see_shadow, see_racket)
                    rest = seen[LOG_LIGHT]
                goal = swing + (rest if light == UNTOUCHED else math.log(light))
                if goal == pixels[pixel, TARGET]:
                    continue  # at rest, which is caught up with in closed form when it ends
                if not active[pixel]:
                    active[pixel] = True
                    active_list[active_count] = pixel
                    active_count += 1
                fall = decay
                if start_us < before_us and not (deep and start_us >= recent_us):
                    count = rest_pixel(pixels, pixel, before_us, tau_us, refractory_us, events, count)
                    start_us = before_us
                elif start_us != before_us and tau_us > 0.0:
                    fall = math.exp((start_us - now_us) / tau_us)
                count = follow_pixel(pixels, pixel, goal, start_us, now_us, fall, tau_us, refractory_us, events, count)
    return count, active_count


@njit(error_model="numpy")
def settle_block(pixels, active, active_list, active_count, end_us, sensor, events):
    """Bring all awake pixels to the end of the block; returns (event count, awake count, finished).

    Not finished, and nothing done, if the buffers might overflow.
    """
    count = int(sensor[2])
    if count + active_count * EVENTS_PER_PIXEL > len(events):
        return count, active_count, False
    count, active_count = settle_active(
        pixels, active, active_list, active_count, end_us, sensor[0], sensor[1], events, count
    )
    return count, active_count, True


@njit(error_model="numpy")
def update_spans(pixels, shape, maps, layers, view, rows, rackets, boxes, bodies, looks):
    """Let pixels have looked at what is there for long: how a recording begins."""
    ball, racket, width = ball_numbers(rows, 0), racket_numbers(rackets, 0), shape[0]
    see_ball, see_shadow, see_racket = boxes[0, BALL].any(), boxes[0, SHADOW].any(), boxes[0, RACKET].any()
    for part in range(boxes.shape[1]):
        for y in range(boxes[0, part, 1], boxes[0, part, 3]):
            for x in range(boxes[0, part, 0], boxes[0, part, 2]):
                pixel = y * width + x
                seen = pixel_seen(maps, pixel)
                light = pixel_light(seen, view, ball, racket, see_ball, see_shadow, see_racket)
                goal = seen[LOG_LIGHT] if light == UNTOUCHED else math.log(light)
                pixels[pixel, TARGET] = pixels[pixel, RECEPTOR] = pixels[pixel, REFERENCE] = goal
    probes, probed_circles, parts, scene = bodies
    looked, marks, tiles, listed, tile_us = looks
    if len(parts):
        mark_moved(probed_circles[0], looked, 0.0, shape, marks, tiles, listed)
        nobody, nothing = np.empty(0, np.bool_), np.empty(0, np.int64)
        update_tiles(
            pixels, nobody, nothing, 0, shape, maps, layers, view, probes[0], probed_circles[0], parts, scene,
            (marks, tiles, listed, tile_us), 0.0, 0.0, ball, racket,
            boxes[0, BALL], boxes[0, SHADOW], boxes[0, RACKET], 0.0, (0.0, 0.0, 0.0),
            np.empty((1 << 14, 3)), 0,
        )  # fmt: skip


@njit(error_model="numpy")
def racket_numbers(rows, step):
    """A row of RACKET_COLUMNS as a tuple of numbers."""
    a, b = rows[step, :7], rows[step, 7:]
    return a[0], a[1], a[2], a[3], a[4], a[5], a[6], b[0], b[1], b[2], b[3], b[4], b[5], b[6]


@njit(error_model="numpy")
def spans_meet(boxes, before, step, one, other):
    """Whether the pixels that two parts pass over between two substeps may have one in common."""
    a = union_box(boxes[before, one], boxes[step, one])
    return boxes_meet(a, union_box(boxes[before, other], boxes[step, other]))


@njit(error_model="numpy")
def ball_numbers(rows, step):
    """A row of BALL_COLUMNS as a tuple of numbers."""
    a, b = rows[step, :8], rows[step, 8:]
    return a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8]


@njit(error_model="numpy")
def union_box(a, b):
    """The box round two boxes (first column, first row, last + 1 ...); an empty one does not count."""
    if a[2] <= a[0]:
        return b[0], b[1], b[2], b[3]
    if b[2] <= b[0]:
        return a[0], a[1], a[2], a[3]
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


@njit(error_model="numpy")
def boxes_meet(a, b):
    """Whether two boxes have a pixel in common."""
    return max(a[0], b[0]) < min(a[2], b[2]) and max(a[1], b[1]) < min(a[3], b[3])
