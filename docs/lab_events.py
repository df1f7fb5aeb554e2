"""Recordings for the pictures of a lab: cameras that see nothing but noise, and stripes that move, which are drawn.

A pixel of the stripes sends an event whenever the logarithm of its intensity has changed by a threshold, which differs
from pixel to pixel; between two pictures it changes evenly. Some noise is added. No camera is so simple.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.cameras import stereo_preset
from core.events import Events, SensorSize
from core.recordings import RecordingWriter
from core.simulation import LaunchConfig, StereoConfig
from core.simulation.event_cameras.event_camera import BLOCK_US, simulate_stereo
from core.simulation.flights import draw_serve_series

Array = NDArray[np.float64]
Picture = NDArray[np.float32]

THRESHOLD: Final = 0.25
MISMATCH: Final = 0.1
NOISE_HZ: Final = 0.2


def events_of_pictures(
    pictures: Iterable[tuple[int, Picture]], sensor: SensorSize, rng: np.random.Generator
) -> Iterator[Events]:
    """What a camera says between each two pictures: (time in us, (height, width) intensity above 0)."""
    size = sensor.width_px * sensor.height_px
    thresholds = THRESHOLD * np.maximum(0.3, 1 + MISMATCH * rng.standard_normal(size))
    reference = np.empty(0)
    before_us = 0
    for t_us, picture in pictures:
        level = np.log(picture.astype(np.float64)).ravel()
        if not len(reference):
            reference, before_us = level + thresholds * rng.uniform(-0.9, 0.9, size), t_us
            continue
        steps = np.trunc((level - reference) / thresholds).astype(np.int64)
        pixels = np.flatnonzero(steps)
        counts = np.abs(steps[pixels])
        reference[pixels] += steps[pixels] * thresholds[pixels]
        rows = np.repeat(pixels, counts)
        nth = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (nth + rng.random(len(rows))) / np.repeat(counts, counts)
        yield _sorted_events(
            before_us + share * (t_us - before_us), rows, np.repeat(steps[pixels] > 0, counts), sensor, rng,
            (before_us, t_us),
        )  # fmt: skip
        before_us = t_us


def _sorted_events(
    t_us: Array,
    pixels: NDArray[np.int64],
    on: NDArray[np.bool_],
    sensor: SensorSize,
    rng: np.random.Generator,
    span_us: tuple[int, int],
) -> Events:
    """With noise, in order of time."""
    size = sensor.width_px * sensor.height_px
    noise = rng.poisson(NOISE_HZ * size * (span_us[1] - span_us[0]) * 1e-6)
    t = np.concatenate([t_us, rng.uniform(*span_us, noise)]).astype(np.int64)
    where = np.concatenate([pixels, rng.integers(0, size, noise)])
    signs = np.concatenate([on, rng.random(noise) < 0.5])
    order = np.argsort(t, kind="stable")
    v, u = np.divmod(where[order], sensor.width_px)
    return Events.from_columns(t[order], u, v, signs[order], sensor)


def write_noise(path: Path, duration_us: int = 400_000) -> None:
    """Two simulated cameras after the last ball has left: nothing but noise."""
    cameras = stereo_preset()
    flight = draw_serve_series([LaunchConfig(speed_mps=5.0)], np.random.default_rng(0))
    quiet_us = -(-round(1e6 * flight.end_s) // BLOCK_US) * BLOCK_US + 200_000
    with RecordingWriter(path, {name: one.sensor for name, one in cameras.items()}, calibration=cameras) as writer:
        for chunk in simulate_stereo(StereoConfig(), cameras, flight, seed=0, duration_us=quiet_us + duration_us):
            for name, events in chunk.events.items():
                if chunk.start_us >= quiet_us:
                    later = events.t_us - quiet_us
                    writer.append(name, Events.from_columns(later, events.x_px, events.y_px, events.on, events.sensor))


def write_stripes(path: Path, sensor: SensorSize, blurs_px: dict[str, float]) -> None:
    """A board with stripes that moves by a pixel a millisecond, for cameras that are so far out of focus."""
    rng = np.random.default_rng(0)
    with RecordingWriter(path, dict.fromkeys(blurs_px, sensor)) as writer:
        for name, blur_px in blurs_px.items():
            for events in events_of_pictures(_stripes(sensor, blur_px), sensor, rng):
                writer.append(name, events)


def _stripes(sensor: SensorSize, blur_px: float, moves: int = 60) -> Iterator[tuple[int, Picture]]:
    """Slanted stripes of 60 px with a wide margin, shifted a pixel more each time."""
    v, u = np.mgrid[: sensor.height_px, : sensor.width_px + 2 * moves].astype(np.float32)
    black = (np.floor((u + 0.25 * v) / 60.0) % 2 > 0) & (v > 140) & (v < sensor.height_px - 140)
    whole = cv2.GaussianBlur(np.where(black, 0.1, 0.6).astype(np.float32), (0, 0), blur_px)
    for shift in range(moves):
        left = moves - shift
        yield 1000 * shift, np.asarray(whole[:, left : left + sensor.width_px], np.float32)
