"""What no method can do better: a circle through the events that were seen, and reading each event once."""

from __future__ import annotations

import math
import time
from typing import Final, NamedTuple

import numpy as np

from benchmarks.perception.loaded_camera import LoadedCamera
from core.detection import DetectorConfig
from core.detection.methods import Method
from core.detection.refined_config import RefinedConfig
from core.events import Events
from core.jit import njit
from core.metrics.grid_score import image_velocity, wholly_in_view
from core.recordings import PixelTruth

SENSOR_DELAY_US: Final = RefinedConfig().delay_us
"""From the light to the event, of the simulated sensor: the photoreceptor's."""
PIXEL_SIGMA_PX: Final = 1 / math.sqrt(12)
"""0.29: an event says of the edge that it was somewhere in its pixel."""
RIM_PX: Final = 1.5
"""An event so near the true circle is of the ball's edge."""
STEP_US: Final = 10_000
MEDIAN_OF_RAYLEIGH: Final = math.sqrt(2 * math.log(2))
READS: Final = 5


class CircleBounds(NamedTuple):
    """Least median errors of a circle's centre in pixels."""

    events_px: float
    """If every event were an observation of its own."""
    pixels_px: float
    """If a pixel says the same however many events it has."""


def circle_bound_px(points: int) -> float:
    """Least median distance of a fitted centre from the true one; endless without points.

    n points on a circle, each with a radial error of sigma = 1/sqrt(12) px, know the centre no better than the inverse
    of their Fisher information, sum(n_i n_i^T) / sigma^2 with the unit normals n_i. Its trace is n / sigma^2 whatever
    the points; the sum of both variances is least when they lie all round: 2 sigma^2 / n for each axis. The distance is
    then Rayleigh distributed, with the median sqrt(2 ln 2) sigma sqrt(2 / n).
    """
    if points <= 0:
        return math.inf
    return MEDIAN_OF_RAYLEIGH * PIXEL_SIGMA_PX * math.sqrt(2 / points)


def circle_bounds(camera: LoadedCamera, method: Method, config: DetectorConfig) -> list[CircleBounds]:
    """The bounds at times 10 ms apart with the ball in view, for the events that the method looks back on."""
    truth = camera.truth
    if not len(truth.t_us):
        return []
    times_us = np.arange(truth.t_us[0], truth.t_us[-1], STEP_US)
    seen = times_us[wholly_in_view(truth.at(times_us), camera.sensor)]
    speeds = np.linalg.norm(image_velocity(truth, seen), axis=1)
    found = []
    for t_us, speed in zip(seen.tolist(), speeds.tolist(), strict=True):
        events = camera.slice(t_us - look_back_us(method, config, speed), t_us)
        edge = edge_events(events, truth)
        if len(edge):
            pixels = len(np.unique(edge.y_px.astype(np.int64) * camera.sensor.width_px + edge.x_px))
            found.append(CircleBounds(circle_bound_px(len(edge)), circle_bound_px(pixels)))
    return found


def look_back_us(method: Method, config: DetectorConfig, speed_px_per_ms: float) -> int:
    """The events of an answer are so old: those of one window, and of `refined` those of its history."""
    if method != "refined":
        return config.window.window_us
    refined = config.refined
    wanted = 1000 * refined.motion_px / max(speed_px_per_ms, 1e-6)
    return round(min(max(wanted, refined.history_min_us), refined.history_max_us))


def edge_events(events: Events, truth: PixelTruth) -> Events:
    """Those that lie on the edge of the true ball at the time of the light that they are of."""
    at = truth.at(events.t_us - SENSOR_DELAY_US)
    distance = np.hypot(events.x_px - at.u_px, events.y_px - at.v_px)
    return events.rows(np.nan_to_num(np.abs(distance - at.r_px), nan=np.inf) <= RIM_PX)


def read_time_ns(events: Events) -> float:
    """Processor time per event of a compiled pass that looks at every column once; the best of some passes."""
    if not len(events):
        return math.nan
    read_once(events.t_us[:1], events.x_px[:1], events.y_px[:1], events.on[:1])  # compiles
    best_s = math.inf
    for _ in range(READS):
        began_s = time.thread_time()
        read_once(events.t_us, events.x_px, events.y_px, events.on)
        best_s = min(best_s, time.thread_time() - began_s)
    return 1e9 * best_s / len(events)


@njit
def read_once(t_us, x_px, y_px, on):
    """A number that every event has a part in."""
    total = 0
    for k in range(len(t_us)):
        total += t_us[k] ^ (x_px[k] + 2 * y_px[k] + on[k])
    return total
