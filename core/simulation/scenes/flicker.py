"""Lamps that flicker: the light of everything swings together, so that every pixel has to be told."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.jit import njit
from core.simulation.scenes.scene import SceneConfig
from core.simulation.sensor.pixels import ramp_pixel, receptor_decay, rest_pixel, wake_pixel
from core.simulation.sensor.sensor import TARGET, TIME_US

Array = NDArray[np.float64]

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
