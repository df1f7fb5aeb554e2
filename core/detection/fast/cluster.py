"""The labels of scikit-learn's DBSCAN for a set of events, found on their picture instead of in a tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.detection.fast.clusters_in_time import TIME_LISTS, label_in_time
from core.detection.fast.opening import box_of, set_bits
from core.detection.fast.picture import blank_picture, count_events, label_pixels
from core.detection.stages.cluster import ClusterConfig, scaled_time
from core.events import Events
from core.jit import njit


def grid_labels(events: Events, config: ClusterConfig) -> NDArray[np.int32]:
    """(N,) the labels of `cluster.cluster_labels`, fast."""
    count = len(events)
    if not count:
        return np.zeros(0, np.int32)
    picture, found = blank_picture(events.sensor, config.eps_px, count)
    pixels, box = show_events(events.x_px, events.y_px, events.on, picture, found)
    if config.time_scale_px_per_ms > 0:
        times = scaled_time(events.t_us, config.time_scale_px_per_ms)
        chains = np.empty((TIME_LISTS, count), np.int32)
        label_in_time(times, pixels, box, picture, found, chains, config.eps_px, config.min_samples)
        return found.labels[:count]
    label_pixels(count, pixels, box, picture, found, config.min_samples)
    return found.labels[found.pixel_of[:count]]


@njit
def show_events(x_px, y_px, on, picture, found):
    """Enter all events into an empty picture; returns how many pixels have some, and the box of words with pixels."""
    events = np.arange(len(x_px))
    words = set_bits(x_px, y_px, events, len(x_px), picture.occupied.reshape((-1, picture.stride)), found.queue)
    box = box_of(found.queue[:words], picture.stride)
    return count_events(x_px, y_px, on, events, box, picture, found), box
