"""What a camera looks at in a block: its substeps with ball and racket at each, the boxes to redraw, and lamps that
flicker, whose light changes every pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.flights import BallPath
from core.simulation.scenes.ball_view import (
    STEP_PX,
    ball_and_shadow_boxes,
    ball_shading_rows,
    picture_speed,
    shadow_stride,
)
from core.simulation.scenes.lens import boxes_round, lens_of
from core.simulation.scenes.racket_view import (
    RACKET_COLUMNS,
    RacketPath,
    RacketPoses,
    most_moved,
    racket_outline,
    racket_shading_rows,
)
from core.simulation.scenes.scene import TO_LIGHT_WORLD, SceneConfig
from core.simulation.scenes.shading import BALL_COLUMNS, VIEW_NUMBERS, Moving
from core.simulation.sensor.pixels import ramp_pixel, receptor_decay, rest_pixel, wake_pixel
from core.simulation.sensor.sensor import TARGET, TIME_US

Array = NDArray[np.float64]

BALL, SHADOW, RACKET = range(3)
"""Parts of the picture that move, in the order in which they are looked at."""


class Steps(NamedTuple):
    """Ball and racket at S + 1 instants, equally spaced, to one camera."""

    t_us: Array
    """(S + 1,)."""
    rows: Array
    """(S + 1, BALL_COLUMNS), see `core.simulation.scenes.shading`."""
    rackets: Array
    """(S + 1, RACKET_COLUMNS), see `core.simulation.scenes.racket_view`."""
    outlines: Array
    """(S + 1, K, 2) pixels of points on the racket's rims, see `core.simulation.scenes.racket_view`."""
    boxes: NDArray[np.int64]
    """(S + 1, 3, 4): first column, first row, one past the last column and row of ball, shadow and racket; empty where
    0."""
    swing: FlickerSwing
    strides: NDArray[np.int64]
    """(3,): substeps from one look at ball, shadow and racket to the next, 0 for no look: a soft shadow changes slowly,
    a racket at rest not at all."""


@njit(error_model="numpy")
def moving_at(steps, step, see_ball, see_shadow, see_racket):
    """Ball and racket at a substep."""
    ball = to_fixed_tuple(steps.rows[step], BALL_COLUMNS)  # pyright: ignore[reportCallIssue] - a numba intrinsic
    racket = to_fixed_tuple(steps.rackets[step], RACKET_COLUMNS)  # pyright: ignore[reportCallIssue]
    return Moving(ball, racket, see_ball, see_shadow, see_racket)


@njit(error_model="numpy")
def is_looked_at(steps, step, part):
    """Whether a part is looked at in this substep."""
    stride = steps.strides[part]
    return stride != 0 and (step % stride == 0 or step == len(steps.t_us) - 1)


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


LOOKS_PER_SWING: Final = 20
"""Between two looks the logarithm of the light is taken as straight: 1.2 % of the swing off in the middle."""
EVENTS_PER_PIXEL = 64
"""Room kept free in the buffer per pixel of a row: the steepest swing at the lowest threshold is 16 a look."""


class FlickerSwing(NamedTuple):
    """The swing at the substeps of a block."""

    log_light: Array
    """(S + 1,) what is added to the logarithm of every intensity; empty without flicker."""
    stride: int
    """Substeps from one look at all pixels to the next."""


def flicker_log_light(scene: SceneConfig, t_us: ArrayLike) -> Array:
    """What is added to the logarithm of every intensity at times `t_us` (N,); 0 at 0."""
    swing = np.sin(2e-6 * np.pi * scene.flicker_hz * np.asarray(t_us, np.float64))
    return np.log1p(scene.flicker * swing)


def updates_of_all(scene: SceneConfig, duration_us: int) -> int:
    """How often all pixels have to be looked at; 0 without flicker."""
    return math.ceil(LOOKS_PER_SWING * scene.flicker_hz * duration_us * 1e-6) if scene.flicker > 0 else 0


def make_flicker(scene: SceneConfig, t_us: Array) -> FlickerSwing:
    """The light's swing at the equally spaced substeps `t_us` (S + 1,)."""
    looks = updates_of_all(scene, round(float(t_us[-1] - t_us[0])))
    if not looks:
        return FlickerSwing(np.empty(0), 1)
    return FlickerSwing(flicker_log_light(scene, t_us), max(1, (len(t_us) - 1) // looks))


@njit(error_model="numpy")
def flicker_all_pixels(pixels, width, steps, step, timing, events):
    """Swing the light of all pixels that were not looked at in this substep, row by row of `width` pixels.

    What a pixel saw last holds the swing of that time. Returns false if the buffer might overflow: call again with a
    larger one.
    """
    rows, active, event_rows = pixels.rows, pixels.active, events.rows
    t_us, swings = steps.t_us, steps.swing.log_light
    now_us, each_us = t_us[step], t_us[1] - t_us[0]
    for first in range(0, len(rows), width):
        count = events.filled[0]
        if count + width * EVENTS_PER_PIXEL > len(event_rows):
            return False
        for pixel in range(first, first + width):
            start_us = rows[pixel, TIME_US]
            if start_us >= now_us:
                continue
            since = max(int((start_us - t_us[0]) / each_us + 0.5), 0)
            # The target holds the swing of when the pixel was last seen: the difference is added.
            goal = rows[pixel, TARGET] + swings[step] - swings[since]
            if not active[pixel]:
                wake_pixel(pixels, pixel)
            if start_us < t_us[0]:
                count = rest_pixel(rows, pixel, t_us[0], timing, event_rows, count)
                start_us = t_us[0]
            decay = receptor_decay(start_us, now_us, timing)
            count = ramp_pixel(rows, pixel, goal, now_us, decay, timing, event_rows, count)
        events.filled[0] = count
    return True


RACKET_STEP_PX = 0.8
"""Most motion of the racket's outline from one look at it to the next: half an edge."""
RACKET_REST_PX = 0.05
"""A racket that has moved less since the last look is at rest."""
LONGEST_STEP_US = 500.0
"""A slow ball is looked at this often."""
PROBES = 11
"""Instants in a block at which the speed in the picture is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class RacketView:
    """The racket of a block to one camera."""

    path: RacketPath
    light: float
    seen: Array | None
    """(K, 2) its outline at the last look; None before the first."""


def view_numbers(camera: Camera) -> tuple[float, ...]:
    """The VIEW_NUMBERS that describe the camera to the kernels."""
    R = camera.T_world_camera[:3, :3]
    numbers = np.concatenate([R.ravel(), camera.position_world_m, R.T @ TO_LIGHT_WORLD, TO_LIGHT_WORLD])
    assert len(numbers) == VIEW_NUMBERS
    return tuple(numbers.tolist())


def moving_steps(
    camera: Camera,
    scene: SceneConfig,
    path: BallPath,
    racket: RacketView | None,
    start_us: int,
    end_us: int,
    least: int = 0,
) -> Steps | None:
    """Substeps over [start, end] fine enough for what moves; None if nothing that moves can be seen.

    `least` are the substeps that something besides ball and racket needs.
    """
    least = max(least, updates_of_all(scene, end_us - start_us))
    probes_us = _evenly(start_us, end_us, PROBES - 1)
    states = path.at(probes_us * 1e-6)
    ball_there = bool(states.present.any())
    probes = None if racket is None else _racket_probes(camera, racket, probes_us)
    looks = 0 if racket is None or probes is None else _racket_looks(racket.seen, probes[1])
    if not looks and not ball_there and not least:
        return None
    span_us = end_us - start_us
    steps = max(looks, least, 1)
    if ball_there:
        speed = picture_speed(camera, states)
        steps = max(steps, math.ceil(span_us / LONGEST_STEP_US), math.ceil(speed * span_us / STEP_PX))
    t_us = _evenly(start_us, end_us, steps)
    rows, shadow = np.zeros((steps + 1, BALL_COLUMNS)), 1
    boxes = np.zeros((steps + 1, 3, 4), np.int64)
    if ball_there:
        states = path.at(t_us * 1e-6)
        rows = ball_shading_rows(camera, scene, states, path.visible_range(t_us * 1e-6))
        ball_and_shadow_boxes(camera, scene, states, boxes)
        shadow = shadow_stride(states, rows) if states.present.any() else 1
    rackets, outlines = np.zeros((steps + 1, RACKET_COLUMNS)), np.zeros((steps + 1, 0, 2))
    if racket is not None and probes is not None and (looks or least or boxes.any()):
        poses, outlines = _between_probes(*probes, steps)
        rackets = racket_shading_rows(camera, racket.light, scene.edge_px, racket.path, poses)
        boxes_round(outlines, 0.5 * scene.edge_px, lens_of(camera).size_px, boxes[:, 2])
    # There, but outside of the picture.
    if not boxes[:, :2].any() and not (looks and boxes.any()) and not least:
        return None
    return Steps(
        t_us,
        rows,
        rackets,
        outlines,
        boxes,
        make_flicker(scene, t_us),
        np.array([1, shadow, steps // looks if looks else 0]),
    )


def _racket_probes(camera: Camera, racket: RacketView, probes_us: Array) -> tuple[RacketPoses, Array] | None:
    """The racket and its outline (PROBES, K, 2) in a block; None if it is not wholly before the camera."""
    poses = racket.path.at(probes_us * 1e-6)
    outlines = racket_outline(camera, racket.path, poses)
    return (poses, outlines) if np.isfinite(outlines).all() else None


def _racket_looks(seen: Array | None, outlines: Array) -> int:
    """How often the racket has to be looked at in a block; 0 for one that has not moved since the last look."""
    if seen is None:
        return 1
    away, moved = most_moved(outlines, seen)
    if away < RACKET_REST_PX:
        return 0
    return max(1, math.ceil(moved * (len(outlines) - 1) / RACKET_STEP_PX))


def _between_probes(poses: RacketPoses, outlines: Array, steps: int) -> tuple[RacketPoses, Array]:
    """The racket and its outline (steps + 1, K, 2), linear between probes: in a millisecond it bends by 10 um."""
    p, n, found = np.empty((steps + 1, 3)), np.empty((steps + 1, 3)), np.empty((steps + 1, *outlines.shape[1:]))
    for probed, out in ((poses.p_world_m, p), (poses.normal_world, n), (outlines, found)):
        _interpolate(probed.reshape(PROBES, -1), _evenly(0, PROBES - 1, steps), out.reshape(steps + 1, -1))
    return RacketPoses(p, n), found


@njit(error_model="numpy")
def _interpolate(probed, at, out):
    for index in range(len(out)):
        low = min(int(at[index]), len(probed) - 2)
        share = at[index] - low
        for column in range(out.shape[1]):
            out[index, column] = (1 - share) * probed[low, column] + share * probed[low + 1, column]


def _evenly(start: float, end: float, steps: int) -> Array:
    """What `np.linspace` says of `steps + 1` numbers, in a fifth of its time."""
    numbers = np.arange(steps + 1, dtype=np.float64)
    numbers *= (end - start) / steps
    numbers += start
    numbers[-1] = end
    return numbers
