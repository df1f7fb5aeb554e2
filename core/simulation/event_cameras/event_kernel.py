"""Walk through the substeps of a block and touch only pixels that ball, shadow, racket and bodies sweep over."""

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
from core.simulation.event_cameras.row_light import (
    DEEP,
    GOAL,
    ROW,
    ROW_NUMBERS,
    light_row,
    read_row,
)
from core.simulation.kernel_memory import uncounted
from core.simulation.scenes.background import LOG_LIGHT
from core.simulation.scenes.ball_outline import NO_RIM, ball_rim_between, rim_columns
from core.simulation.scenes.flicker import flicker_all_pixels
from core.simulation.scenes.racket_outline import outline_spans, rows_for_spans, unchanged_columns
from core.simulation.scenes.shading import INNER_STRIDE, UNTOUCHED, deep_inside, pixel_light, pixel_seen
from core.simulation.scenes.steps import BALL, RACKET, SHADOW, boxes_meet, is_looked_at, moving_at, union_box
from core.simulation.sensor.pixels import EVENTS_PER_PIXEL, follow_pixel, receptor_decay, rest_pixel, wake_pixel
from core.simulation.sensor.sensor import RECEPTOR, REFERENCE, TARGET, TIME_US


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
    """(ROW_NUMBERS,) see `core.simulation.event_cameras.row_light`."""


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
