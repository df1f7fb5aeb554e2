"""DBSCAN with time as a third axis: the events of a pixel may belong to several clusters."""

from __future__ import annotations

from typing import Final

import numpy as np

from core.detection.fast.opening import PAD_ROWS
from core.detection.fast.picture import rank
from core.jit import njit

TIME_LISTS: Final = 3
"""Of 32-bit numbers with one for each event."""


@njit
def label_in_time(times, pixels, box, picture, found, chains, eps, min_samples):
    """DBSCAN over the events on the pixels; returns the number of clusters, the labels of the events are in `found`.

    `chains` has room for the last event of each pixel, and for the one before on the same pixel of each event.
    """
    count, labels, stack = len(times), found.labels, found.queue
    heads, following = chains[0], chains[1]
    heads[:pixels] = -1
    for i in range(count):
        pixel = found.pixel_of[i]
        following[i] = heads[pixel]
        heads[pixel] = i
    labels[:count] = -1
    near = np.empty(count, np.int32)
    clusters = 0
    for seed in range(count):
        if labels[seed] != -1:
            continue
        reached = _near_in_time(times, box, picture, found, chains, seed, eps, near)
        if reached < min_samples:
            continue
        labels[seed] = clusters
        stack[0] = seed
        depth = 1
        while depth:
            depth -= 1
            reached = _near_in_time(times, box, picture, found, chains, np.int64(stack[depth]), eps, near)
            if reached < min_samples:
                continue
            for k in range(reached):
                if labels[near[k]] == -1:
                    labels[near[k]] = clusters
                    stack[depth] = near[k]
                    depth += 1
        clusters += 1
    return clusters


@njit
def _near_in_time(times, box, picture, found, chains, event, eps, near):
    reached = 0
    pixel = found.pixel_of[event]
    x, y = np.int64(found.spots[pixel, 0]), np.int64(found.spots[pixel, 1])
    for k in range(picture.disc.shape[1]):
        dy, width = picture.disc[0, k], picture.disc[1, k]
        row = y + dy + PAD_ROWS
        if not box[0] <= row <= box[1]:
            continue
        start = np.uint64((row * picture.stride + 1) * 64 + x - width)
        for other_pixel in range(rank(picture, start), rank(picture, start + np.uint64(2 * width + 1))):
            dx = found.spots[other_pixel, 0] - x
            other = chains[0, other_pixel]
            while other >= 0:
                dt = times[event] - times[other]
                if dx * dx + dy * dy + dt * dt <= eps * eps:
                    near[reached] = other
                    reached += 1
                other = chains[1, other]
    return reached


@njit
def spots_of_clusters(t_us, on, events, clusters, found, spot_times, lists):
    """Replaces the pixels of all events by those of each cluster, one cluster after the other.

    `spot_times` are their sums of times, see `memory.Memory`.
    """
    order, last_cluster, spot_of = lists[0], lists[1], lists[2]
    _sort_by_cluster(found.labels[: len(events)], clusters, order, found.starts, spot_of)
    pixels = found.spots[: len(events)].copy()
    last_cluster[: len(events)] = -1
    spots = 0
    for cluster in range(clusters):
        start, end = found.starts[cluster], found.starts[cluster + 1]
        found.starts[cluster] = spots
        for place in range(start, end):
            k = order[place]
            i, pixel = events[k], found.pixel_of[k]
            if last_cluster[pixel] != cluster:
                last_cluster[pixel], spot_of[pixel], found.members[spots] = cluster, spots, spots
                found.spots[spots, 0], found.spots[spots, 1] = pixels[pixel, 0], pixels[pixel, 1]
                found.spots[spots, 2], found.spots[spots, 3] = 0, 0
                spot_times[spots] = 0
                spots += 1
            side, t = 1 if on[i] else 0, t_us[i] - t_us[0]
            found.spots[spot_of[pixel], 2 + side] += 1
            spot_times[spot_of[pixel], side] += t
            spot_times[spot_of[pixel], 2 + side] += t * t
    found.starts[clusters] = spots


@njit
def _sort_by_cluster(labels, clusters, order, starts, next_place):
    """Numbers of the events of each cluster, one cluster after the other, from starts[cluster] on in `order`."""
    starts[: clusters + 1] = 0
    for label in labels:
        if label >= 0:
            starts[label + 1] += 1
    for cluster in range(clusters):
        starts[cluster + 1] += starts[cluster]
        next_place[cluster] = starts[cluster]
    for k in range(len(labels)):
        label = labels[k]
        if label >= 0:
            order[next_place[label]] = k
            next_place[label] += 1
