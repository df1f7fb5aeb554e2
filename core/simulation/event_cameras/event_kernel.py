"""Walk through the substeps of a block and touch only pixels that ball, shadow, racket and bodies sweep over."""

from __future__ import annotations

import math

import numpy as np

from core.jit import njit
from core.simulation.bodies.shading import FAR_COVER, NEAR_COVER, light_and_rest, posed_bodies
from core.simulation.bodies.tile_updates import REST_PX, UPDATE_PX, mark_moved, pose_at, update_tiles
from core.simulation.scenes.background import LOG_LIGHT, RAY_X, RAY_Y
from core.simulation.scenes.flicker import flicker_all_pixels
from core.simulation.scenes.racket_outline import outline_spans, rows_for_spans, unchanged_columns
from core.simulation.scenes.shading import INNER_STRIDE, UNTOUCHED, pixel_light, pixel_seen
from core.simulation.scenes.steps import BALL, RACKET, SHADOW, boxes_meet, is_looked_at, moving_at, union_box
from core.simulation.sensor.pixels import EVENTS_PER_PIXEL, follow_pixel, receptor_decay, rest_pixel, wake_pixel
from core.simulation.sensor.sensor import RECEPTOR, REFERENCE, TARGET, TIME_US


@njit(error_model="numpy")
def event_kernel_block(pixels, scene, steps, probes, updates, timing, events, done):
    """Run substeps `done + 1` to the last with the bodies at the block's `probes`; returns the last one done.

    Stops early when the buffer might overflow in the next substep; call again with a larger one.
    """
    last, swing = len(steps.t_us) - 1, steps.swing
    posed = posed_bodies(np.empty((len(scene.parts), 2, 3)), np.empty((len(scene.parts), 2, 3)))
    spans_before, spans_now = rows_for_spans(steps.boxes[:, RACKET]), rows_for_spans(steps.boxes[:, RACKET])
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
        event_kernel_step(pixels, scene, steps, step, spans_before, spans_now, timing, events)
        told = len(swing.log_light) and (step % swing.stride == 0 or step == last)
        if told and not flicker_all_pixels(pixels, scene.width_px, steps, step, timing, events):
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
def event_kernel_step(pixels, scene, steps, step, spans_before, spans_now, timing, events):
    """One substep of ball, shadow and racket."""
    # Out of the tuples once: numba counts references to an array each time that it is taken from one.
    rows, active, event_rows, maps, layers = pixels.rows, pixels.active, events.rows, scene.maps, scene.layers
    t_us, boxes, last = steps.t_us, steps.boxes, len(steps.t_us) - 1
    now_us, count = t_us[step], events.filled[0]
    swing = steps.swing.log_light[step] if len(steps.swing.log_light) else 0.0
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
            outline_spans(steps.outlines[before], spans_before)
            outline_spans(steps.outlines[step], spans_now)
        else:
            overlap = boxes_meet(boxes[step, BALL], union_box(boxes[step, SHADOW], boxes[step, SHADOW]))
            see_ball, see_shadow = part == BALL or overlap, part == SHADOW or overlap
            see_racket = boxes_meet(swept[part], swept[RACKET])
        moving = moving_at(steps, step, see_ball, see_shadow, see_racket)
        ball_x, ball_y, ball_z = moving.ball[0], moving.ball[1], moving.ball[2]
        reach2, inner2 = moving.ball[15], moving.ball[16]
        only_ball = part == BALL and not see_shadow and not see_racket
        decay = receptor_decay(before_us, now_us, timing)
        for y in range(y0, y1):
            left, right, first, end = x1, x1, x0, x1
            if part == RACKET:  # only where its outline passes
                first, left, right, end = unchanged_columns(spans_before, spans_now, y, x0, x1)
            for x in range(first, end):
                if left <= x < right:
                    continue
                pixel = y * scene.width_px + x
                start_us = rows[pixel, TIME_US]
                if start_us >= now_us:
                    continue  # parts overlap here
                x_ray, y_ray = maps[pixel, RAY_X], maps[pixel, RAY_Y]
                length2 = x_ray * x_ray + y_ray * y_ray + 1.0
                along = x_ray * ball_x + y_ray * ball_y + ball_z
                met2 = along * along if along > 0.0 else 0.0
                deep = part == BALL and not see_racket and met2 > inner2 * length2
                if deep and step % INNER_STRIDE != 0 and step != last:
                    continue
                if only_ball and met2 <= reach2 * length2 and not _has_body(layers, pixel):
                    goal = swing + maps[pixel, LOG_LIGHT]
                else:
                    seen = pixel_seen(maps, pixel)
                    light, rest = light_and_rest(seen, layers, pixel, scene.numbers, moving)
                    goal = swing + (rest if light == UNTOUCHED else math.log(light))
                if goal == rows[pixel, TARGET]:
                    continue  # at rest, which is caught up with in closed form when it ends
                if not active[pixel]:
                    wake_pixel(pixels, pixel)
                if start_us < (recent_us if deep else before_us):
                    count = rest_pixel(rows, pixel, before_us, timing, event_rows, count)
                    start_us = before_us
                fall = decay if start_us == before_us else receptor_decay(start_us, now_us, timing)
                count = follow_pixel(rows, pixel, goal, now_us, fall, timing, event_rows, count)
    events.filled[0] = count


@njit(inline="always", error_model="numpy")
def _has_body(layers, pixel):
    return len(layers) > 0 and (layers[pixel, NEAR_COVER] > 0.0 or layers[pixel, FAR_COVER] > 0.0)


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
