"""What the sensor adds and delays: noise events that no light caused, and the readout's one queue for all pixels.

Background noise and hot pixels are Poisson processes of the whole sensor. The readout passes on so many events per
microsecond. Events that come faster wait in line and carry the time at which they were read, as real sensors stamp
them; one that would wait longer than the limit is lost, and counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.jit import njit
from core.simulation.sensor.pixels import AHEAD, EVENT_ON, EVENT_PIXEL, EVENT_TIME_US, EventBuffer, prefetch, uncounted
from core.simulation.sensor.sensor import SensorConfig


@dataclass(frozen=True, slots=True, eq=False)
class HotPixels:
    """Pixels that fire on their own, fixed for the life of a sensor."""

    pixels: NDArray[np.int64]
    rates_hz: NDArray[np.float64]


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


class NoiseModel(NamedTuple):
    """Background and hot pixels of a sensor as one Poisson process, which is drawn as such."""

    background_hz: float
    """Background event rate of all pixels together, Hz."""
    background_on: float
    """Share of ON events in the background."""
    hot: NDArray[np.int64]
    hot_hz: NDArray[np.float64]
    """Running sum of the rates of the hot pixels."""
    total_hz: float


def noise_model(sensor: SensorSize, config: SensorConfig, hot: HotPixels) -> NoiseModel:
    """The noise of a sensor. Leakage makes ON events only, shot noise both."""
    on_share = config.leak_share + 0.5 * (1.0 - config.leak_share)
    background_hz = float(config.noise_hz) * sensor.width_px * sensor.height_px
    hot_hz = np.cumsum(hot.rates_hz)
    return NoiseModel(
        background_hz, on_share, hot.pixels, hot_hz, background_hz + (float(hot_hz[-1]) if len(hot_hz) else 0.0)
    )


def merge_noise(
    signal: EventBuffer,
    last_event_us: NDArray[np.int64],
    law: NoiseModel,
    start_us: int,
    end_us: int,
    refractory_us: int,
    width: int,
    rng: np.random.Generator,
) -> MergedEvents:
    """The signal and freshly drawn noise of [start, end) in order of time, in whole microseconds.

    Events of a pixel that is still refractory are left out. Of equal times signal comes before noise, and what was
    found first before the rest.

    `last_event_us` is that of `PixelState` and is brought up to date. Signal events keep clear of each
    other already; here noise is kept clear of signal and the other way round.

    Args:
        signal: events of the scene, unsorted.
        last_event_us: (pixels,) time of each pixel's last event.
        law: rates of noise of the pixels.
        start_us: start of the span.
        end_us: its end.
        refractory_us: dead time of a pixel.
        width: of the sensor, px.
        rng: source of random numbers.
    """
    rows = signal.rows[: signal.filled[0]]
    t, x, y, on = _merge(rows, last_event_us, law, start_us, end_us, refractory_us, width, rng)
    return MergedEvents(t, x, y, on)


@njit
def _merge(rows, last_event_us, law, start_us, end_us, refractory_us, width, rng):
    rows, last_event_us, law = uncounted(rows), uncounted(last_event_us), uncounted(law)
    times, order = _in_order(rows, start_us, end_us)
    filled = len(rows)
    noise_us = _noise_times(law, start_us, end_us, rng)
    room = filled + len(noise_us)
    t, x, y = np.empty(room, np.int64), np.empty(room, np.uint16), np.empty(room, np.uint16)
    on = np.empty(room, np.bool_)
    i = j = kept = 0
    while i < filled or j < len(noise_us):
        if j >= len(noise_us) or (i < filled and times[order[i]] <= noise_us[j]):
            found = order[i]
            # Pixels come in random order: each would wait for memory.
            prefetch(last_event_us, np.uint32(rows[order[min(i + AHEAD, filled - 1)], EVENT_PIXEL]))
            now_us, pixel, rose = times[found], np.uint32(rows[found, EVENT_PIXEL]), rows[found, EVENT_ON] > 0.0
            i += 1
        else:
            pixel, rose = _noisy_pixel(law, len(last_event_us), rng)
            now_us = noise_us[j]
            j += 1
        if now_us - last_event_us[pixel] < refractory_us:
            continue
        last_event_us[pixel] = now_us
        row = pixel // np.uint32(width)
        t[kept], x[kept], y[kept], on[kept] = now_us, pixel - row * np.uint32(width), row, rose
        kept += 1
    return t[:kept], x[:kept], y[:kept], on[:kept]


@njit
def _in_order(rows, start_us, end_us):
    """(whole microseconds of the events, their places in order of time), by counting those of each microsecond."""
    filled = len(rows)
    times, order = np.empty(filled, np.int64), np.empty(filled, np.int64)
    place = np.zeros(end_us - start_us + 1, np.int64)
    for index in range(filled):
        times[index] = min(max(np.int64(math.floor(rows[index, EVENT_TIME_US])), start_us), end_us - 1)
        place[times[index] - start_us + 1] += 1
    for micro in range(1, len(place)):
        place[micro] += place[micro - 1]
    for index in range(filled):
        order[place[times[index] - start_us]] = index
        place[times[index] - start_us] += 1
    return times, order


@njit
def _noise_times(law, start_us, end_us, rng):
    """Ascending times, without sorting: spacings of a Poisson process."""
    count = rng.poisson(law.total_hz * (end_us - start_us) * 1e-6)
    times = np.empty(count, np.int64)
    arrivals, arrived = np.empty(count), 0.0
    for index in range(count):
        arrived += rng.standard_exponential()
        arrivals[index] = arrived
    scale = (end_us - start_us) / (arrived + rng.standard_exponential())
    for index in range(count):
        times[index] = min(start_us + np.int64(arrivals[index] * scale), end_us - 1)
    return times


@njit
def _noisy_pixel(law, count, rng):
    """(pixel, whether it is an ON event) of a noise event."""
    drawn_hz, rose = rng.random() * law.total_hz, rng.random()
    if drawn_hz < law.background_hz:
        return np.uint32(min(drawn_hz / law.background_hz * count, count - 1.0)), rose < law.background_on
    which = min(np.searchsorted(law.hot_hz, drawn_hz - law.background_hz, side="right"), len(law.hot) - 1)
    return np.uint32(law.hot[which]), rose < 0.5


@dataclass(frozen=True, slots=True)
class ReadoutCounts:
    """What the readout did to the events so far."""

    passed: int = 0
    delayed: int = 0
    """Stamped a microsecond or more after they happened."""
    dropped: int = 0
    longest_us: int = 0
    """The longest wait of an event that was not dropped."""

    def plus(self, later: ReadoutCounts) -> ReadoutCounts:
        """The counts of both together."""
        longest_us = max(self.longest_us, later.longest_us)
        delayed, dropped = self.delayed + later.delayed, self.dropped + later.dropped
        return ReadoutCounts(self.passed + later.passed, delayed, dropped, longest_us)


class Readout:
    """The queue of one sensor. Blocks of events go in by time and come out with the times at which they are read."""

    def __init__(self) -> None:
        self.counts = ReadoutCounts()
        self._free_us = -np.inf
        empty = np.empty(0, np.int64)
        self._waiting = MergedEvents(empty, empty.astype(np.uint16), empty.astype(np.uint16), empty.astype(np.bool_))

    def pass_on(self, events: MergedEvents, end_us: int, config: SensorConfig) -> MergedEvents:
        """Events of the earlier blocks and of this one that are read before `end_us`; the others wait."""
        stamps = np.empty(len(events.t_us), np.int64)
        each_us, limit_us = 1.0 / config.readout_mevps, config.readout_limit_us
        self._free_us, delayed, dropped, longest = _queue(events.t_us, each_us, limit_us, self._free_us, stamps)
        counts = self.counts
        self.counts = ReadoutCounts(
            counts.passed + len(stamps) - dropped,
            counts.delayed + delayed,
            counts.dropped + dropped,
            max(counts.longest_us, longest),
        )
        if not delayed and not dropped and not len(self._waiting.t_us):
            return events
        kept = stamps >= 0
        waiting = self._waiting
        t = np.concatenate([waiting.t_us, stamps[kept]])
        x, y = np.concatenate([waiting.x_px, events.x_px[kept]]), np.concatenate([waiting.y_px, events.y_px[kept]])
        on = np.concatenate([waiting.on, events.on[kept]])
        now = int(np.searchsorted(t, end_us))
        self._waiting = MergedEvents(t[now:], x[now:], y[now:], on[now:])
        return MergedEvents(t[:now], x[:now], y[:now], on[:now])


@njit
def _queue(t_us, each_us, limit_us, free_us, stamps):
    """Write the times at which events are read, -1 for a lost one; (free again, delayed, dropped, longest wait)."""
    delayed = dropped = longest = 0
    for index in range(len(t_us)):
        read_us = max(float(t_us[index]), free_us)
        stamp = int(read_us)
        wait = stamp - t_us[index]
        if wait > limit_us:
            stamps[index] = -1
            dropped += 1
            continue
        stamps[index] = stamp
        delayed += wait > 0
        longest = max(longest, wait)
        free_us = read_us + each_us
    return free_us, delayed, dropped, longest
