"""The readout's queue: its rate, its order, what waits over the end of a block, what is lost."""

import numpy as np
import pytest

from core.simulation import SceneConfig, SensorConfig
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.sensor.readout import MergedEvents, Readout

pytestmark = pytest.mark.numeric


def burst(count: int, t_us: int) -> MergedEvents:
    index = np.arange(count)
    return MergedEvents(np.full(count, t_us), index.astype(np.uint16), index.astype(np.uint16), index % 2 == 0)


def test_a_slow_stream_passes_as_it_is() -> None:
    readout = Readout()
    events = MergedEvents(np.arange(0, 1000, 10), *(np.zeros(100, np.uint16),) * 2, np.ones(100, np.bool_))
    assert readout.pass_on(events, 10_000, SensorConfig(readout_mevps=1.0)) is events
    assert (readout.counts.passed, readout.counts.delayed, readout.counts.dropped) == (100, 0, 0)


def test_a_burst_is_read_at_the_readouts_rate_in_its_order() -> None:
    readout = Readout()
    read = readout.pass_on(burst(100, 50), 10_000, SensorConfig(readout_mevps=2.0))
    np.testing.assert_array_equal(read.t_us, 50 + np.arange(100) // 2)
    np.testing.assert_array_equal(read.x_px, np.arange(100))
    assert readout.counts.delayed == 98 and readout.counts.longest_us == 49 and readout.counts.dropped == 0


def test_what_would_wait_too_long_is_dropped_and_counted() -> None:
    readout = Readout()
    read = readout.pass_on(burst(100, 50), 10_000, SensorConfig(readout_mevps=1.0, readout_limit_us=30))
    assert len(read.t_us) == 31 and read.t_us.max() == 80
    assert (readout.counts.passed, readout.counts.dropped) == (31, 69)


def test_what_is_read_after_the_end_of_a_block_comes_with_the_next() -> None:
    readout, config = Readout(), SensorConfig(readout_mevps=1.0)
    first = readout.pass_on(burst(100, 9_950), 10_000, config)
    second = readout.pass_on(burst(10, 10_020), 20_000, config)
    assert len(first.t_us) == 50 and first.t_us.max() == 9_999
    np.testing.assert_array_equal(second.t_us, np.arange(10_000, 10_060))
    np.testing.assert_array_equal(second.x_px, [*range(50, 100), *range(10)])


def test_a_narrow_readout_loses_events_of_a_ball_and_says_so(small_camera, crossing) -> None:
    config = SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0, readout_mevps=0.1, readout_limit_us=100)
    narrow = EventCamera(small_camera, SceneConfig(), config, np.random.default_rng(1))
    wide = EventCamera(
        small_camera,
        SceneConfig(),
        SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0),
        np.random.default_rng(1),
    )
    some, all_events = narrow.advance(crossing, 3 * BLOCK_US), wide.advance(crossing, 3 * BLOCK_US)
    assert narrow.readout_counts.dropped > 100 and wide.readout_counts.dropped == 0
    waiting = narrow.readout_counts.passed - len(some)
    assert len(some) + waiting + narrow.readout_counts.dropped == len(all_events) and 0 <= waiting <= 11
    assert len(some) == pytest.approx(0.1 * 30_000, abs=20)
