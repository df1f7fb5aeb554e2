"""Signal and noise in order of time, against a plain sort; hot pixels; who is still refractory."""

import numpy as np
import pytest

from core.events import SensorSize
from core.simulation import SensorConfig
from core.simulation.sensor.pixels import EventBuffer
from core.simulation.sensor.readout import HotPixels, merge_noise, noise_model

pytestmark = pytest.mark.numeric
SENSOR = SensorSize(64, 48)
COUNT = 64 * 48
QUIET = SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0)
COLD = HotPixels(np.empty(0, np.int64), np.empty(0))
LONG_AGO = -(10**12)


def buffer_of(t_us: np.ndarray, pixel: np.ndarray, on: np.ndarray) -> EventBuffer:
    events = EventBuffer.empty(len(t_us) + 5)
    events.rows[: len(t_us)] = np.column_stack([t_us, pixel, on])
    events.filled[0] = len(t_us)
    return events


def merge(signal: EventBuffer, config: SensorConfig, hot: HotPixels = COLD, seed: int = 0, span_us: int = 10_000):
    last = np.full(COUNT, LONG_AGO)
    law = noise_model(SENSOR, config, hot)
    rng = np.random.default_rng(seed)
    return merge_noise(signal, last, law, 20_000, 20_000 + span_us, config.refractory_us, 64, rng), last


def test_signal_alone_is_sorted_and_equal_times_keep_their_order() -> None:
    rng = np.random.default_rng(1)
    t_us, pixel = rng.uniform(19_999.0, 30_001.0, 3000), rng.permutation(COUNT)[:3000]
    on = rng.random(3000) < 0.5
    merged, last = merge(buffer_of(t_us, pixel, on), QUIET)
    whole = np.clip(np.floor(t_us).astype(np.int64), 20_000, 29_999)
    order = np.argsort(whole, kind="stable")
    assert np.unique(whole).size < 3000, "some times are equal"
    np.testing.assert_array_equal(merged.t_us, whole[order])
    np.testing.assert_array_equal(merged.y_px.astype(int) * 64 + merged.x_px, pixel[order])
    np.testing.assert_array_equal(merged.on, on[order])
    np.testing.assert_array_equal(last[pixel], whole)


def test_noise_and_signal_keep_clear_of_each_other() -> None:
    rng = np.random.default_rng(2)
    t_us, pixel = np.sort(rng.uniform(20_000.0, 30_000.0, 500)), rng.permutation(COUNT)[:500]
    config = SensorConfig(noise_hz=20.0, refractory_us=2000, hot_pixels_per_million=0.0)
    merged, _ = merge(buffer_of(t_us, pixel, np.ones(500)), config)
    address = merged.y_px.astype(int) * 64 + merged.x_px
    order = np.lexsort((merged.t_us, address))
    gaps = np.diff(merged.t_us[order])[np.diff(address[order]) == 0]
    assert len(merged.t_us) > 700 and (np.diff(merged.t_us) >= 0).all() and (len(gaps) == 0 or gaps.min() >= 2000)


def test_hot_pixels_fire_at_their_own_rates_and_the_background_everywhere() -> None:
    hot = HotPixels(np.array([5, 700, 3000]), np.array([400.0, 100.0, 900.0]))
    config = SensorConfig(noise_hz=0.5, refractory_us=0)
    merged, _ = merge(EventBuffer.empty(1), config, hot, span_us=4_000_000)
    counts = np.bincount(merged.y_px.astype(int) * 64 + merged.x_px, minlength=COUNT)
    for pixel, rate_hz in zip(hot.pixels, hot.rates_hz, strict=True):
        assert abs(counts[pixel] - 4.0 * (rate_hz + 0.5)) < 5 * np.sqrt(4.0 * rate_hz)
    others = np.delete(counts, hot.pixels)
    assert abs(others.sum() - 2.0 * len(others)) < 5 * np.sqrt(2.0 * len(others))
    assert others.max() < 15 and abs(others[: COUNT // 2].mean() - others[COUNT // 2 :].mean()) < 0.3
    assert abs(np.mean(merged.t_us) - 2_020_000) < 60_000


def test_the_same_seed_draws_the_same_noise_and_quiet_is_quiet() -> None:
    config = SensorConfig(noise_hz=5.0)
    one, same, other = (merge(EventBuffer.empty(1), config, seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.t_us, same.t_us)
    np.testing.assert_array_equal(one.x_px, same.x_px)
    assert len(one.t_us) > 50 and not np.array_equal(one.t_us, other.t_us)
    assert not len(merge(EventBuffer.empty(1), QUIET)[0].t_us)
