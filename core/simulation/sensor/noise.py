"""Events that no light caused: background noise and hot pixels, as Poisson processes of the whole sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.jit import njit
from core.simulation.sensor.sensor import LAST_EVENT_US, SensorConfig


@dataclass(frozen=True, slots=True, eq=False)
class HotPixels:
    """Pixels that fire on their own, fixed for the life of a sensor."""

    pixels: NDArray[np.int64]
    rates_hz: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RawEvents:
    """Unchecked columns, ascending in time."""

    t_us: NDArray[np.int64]
    pixel: NDArray[np.int64]
    """Row-major index."""
    on: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class MergedEvents:
    """The columns of an `Events` value."""

    t_us: NDArray[np.int64]
    x_px: NDArray[np.uint16]
    y_px: NDArray[np.uint16]
    on: NDArray[np.bool_]


def draw_hot_pixels(sensor: SensorSize, config: SensorConfig, rng: np.random.Generator) -> HotPixels:
    """Which pixels are hot, and how hot."""
    count = sensor.width_px * sensor.height_px
    hot = min(count, int(rng.poisson(config.hot_pixels_per_million * 1e-6 * count)))
    pixels = np.sort(rng.choice(count, hot, replace=False)).astype(np.int64)
    return HotPixels(pixels, config.hot_pixel_hz * np.exp(rng.standard_normal(hot)))


def draw_noise(
    sensor: SensorSize, config: SensorConfig, hot: HotPixels, start_us: int, end_us: int, rng: np.random.Generator
) -> RawEvents:
    """Noise in [start, end). The superposition of all pixels' processes is one process, drawn as such."""
    pixels = sensor.width_px * sensor.height_px
    seconds = (end_us - start_us) * 1e-6
    background = int(rng.poisson(config.noise_hz * pixels * seconds))
    t = _sorted_times(background, start_us, end_us, rng)
    pixel = rng.integers(0, pixels, background)
    # Leakage makes ON events only, shot noise both: one number decides.
    on = rng.random(background) < config.leak_share + 0.5 * (1.0 - config.leak_share)
    own = rng.poisson(hot.rates_hz * seconds)
    if not own.any():
        return RawEvents(t, pixel, on)
    total = int(own.sum())
    hot_t = rng.integers(start_us, end_us, total)
    t, pixel = np.concatenate([t, hot_t]), np.concatenate([pixel, np.repeat(hot.pixels, own)])
    on = np.concatenate([on, rng.random(total) < 0.5])
    order = np.argsort(t, kind="stable")
    return RawEvents(t[order], pixel[order], on[order])


def merge_events(
    signal: RawEvents, noise: RawEvents, pixels: NDArray[np.float64], refractory_us: int, width: int
) -> MergedEvents:
    """Both in order of time, without events of a pixel that is still refractory.

    `pixels` are the rows of `PixelState`, whose last event is brought up to date. Signal events keep clear of each
    other already; here noise is kept clear of signal and the other way round.
    """
    room = len(signal.t_us) + len(noise.t_us)
    t, on = np.empty(room, np.int64), np.empty(room, np.bool_)
    x, y = np.empty(room, np.uint16), np.empty(room, np.uint16)
    kept = _merge(
        (signal.t_us, signal.pixel, signal.on),
        (noise.t_us, noise.pixel, noise.on),
        pixels,
        refractory_us,
        width,
        (t, x, y, on),
    )
    return MergedEvents(t[:kept], x[:kept], y[:kept], on[:kept])


def _sorted_times(count: int, start_us: int, end_us: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """`count` uniform times in ascending order, without sorting: spacings of a Poisson process."""
    arrivals = np.cumsum(rng.standard_exponential(count + 1))
    times = start_us + np.floor(arrivals[:-1] * ((end_us - start_us) / arrivals[-1])).astype(np.int64)
    return np.minimum(times, end_us - 1)


@njit
def _merge(a, b, pixels, refractory_us, width, out):
    i = j = kept = 0
    while i < len(a[0]) or j < len(b[0]):
        if j >= len(b[0]) or (i < len(a[0]) and a[0][i] <= b[0][j]):
            t, pixel, on = a[0][i], a[1][i], a[2][i]
            i += 1
        else:
            t, pixel, on = b[0][j], b[1][j], b[2][j]
            j += 1
        if t - pixels[pixel, LAST_EVENT_US] < refractory_us:
            continue
        pixels[pixel, LAST_EVENT_US] = t
        out[0][kept] = t
        out[1][kept] = pixel % width
        out[2][kept] = pixel // width
        out[3][kept] = on
        kept += 1
    return kept
