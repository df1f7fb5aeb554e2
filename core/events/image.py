"""Pictures of events: (height, width) arrays that a viewer colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.events.events import Events

NO_EVENT = 0
OFF_EVENT = 1
ON_EVENT = 2


def polarity_image(events: Events, *, binning: int = 1) -> NDArray[np.uint8]:
    """NO_EVENT, OFF_EVENT or ON_EVENT per pixel: the polarity of its latest event.

    With `binning` n, n x n sensor pixels are one of the picture: a smaller picture in which single events still show.
    """
    image = np.zeros(_binned_shape(events, binning), np.uint8)
    # of repeated indices numpy keeps the last
    image[events.y_px // binning, events.x_px // binning] = events.on + np.uint8(OFF_EVENT)
    return image


def count_image(events: Events, *, binning: int = 1) -> NDArray[np.int64]:
    """Count the events of every pixel."""
    height, width = _binned_shape(events, binning)
    flat = (events.y_px // binning).astype(np.int64) * width + events.x_px // binning
    return np.bincount(flat, minlength=width * height).reshape(height, width)


def time_surface(events: Events, *, now_us: int, tau_us: float, binning: int = 1) -> NDArray[np.float32]:
    """exp(-(now - t) / tau) of each pixel's latest event at t, 0 where there was none."""
    surface = np.zeros(_binned_shape(events, binning), np.float32)
    surface[events.y_px // binning, events.x_px // binning] = np.exp((events.t_us - now_us) / tau_us)
    return surface


def _binned_shape(events: Events, binning: int) -> tuple[int, int]:
    return -(-events.sensor.height_px // binning), -(-events.sensor.width_px // binning)
