"""The dense picture of a scene at one instant, which what is drawn piece by piece is held against."""

import math

from core.jit import njit
from core.simulation.scenes.background import LOG_LIGHT
from core.simulation.scenes.shading import UNTOUCHED, pixel_light, pixel_seen


@njit(error_model="numpy")
def render_light(maps, view, moving, out):
    """Log intensity of every pixel, written to `out`: the dense picture at one instant."""
    for pixel in range(len(out)):
        seen = pixel_seen(maps, pixel)
        light = pixel_light(seen, view, moving)
        out[pixel] = seen[LOG_LIGHT] if light == UNTOUCHED else math.log(light)
