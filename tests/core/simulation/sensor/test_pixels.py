"""Laws of a single pixel."""

import numpy as np
import pytest

from core.simulation import SensorConfig
from core.simulation.sensor.pixels import EVENT_ON, EVENT_TIME_US, EventBuffer, PixelTiming, ramp_pixel, rest_pixel
from core.simulation.sensor.sensor import OFF_THRESHOLD, ON_THRESHOLD, TARGET, make_pixels

pytestmark = pytest.mark.numeric
PLAIN = SensorConfig(threshold_mismatch=0.0, refractory_us=0, photoreceptor_us=0.0)


def run_ramp(contrast: float, config: SensorConfig, *, duration_us: float = 1000.0, start: float = 0.0) -> np.ndarray:
    """(N, 3) events of one pixel whose log intensity moves by `contrast` at a constant rate."""
    pixels = make_pixels(np.array([start]), config, np.random.default_rng(0))
    events = EventBuffer.empty(1000).rows
    timing = PixelTiming(config.photoreceptor_us, float(config.refractory_us))
    decay = np.exp(-duration_us / config.photoreceptor_us) if config.photoreceptor_us else 0.0
    count = ramp_pixel(pixels.rows, 0, start + contrast, duration_us, decay, timing, events, 0)
    return events[:count]


@pytest.mark.parametrize("count", [0, 1, 2, 7])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_contrast_of_k_thresholds_makes_k_events(count: int, sign: int) -> None:
    events = run_ramp(sign * (count * 0.2 + 0.01), PLAIN)
    assert len(events) == count and np.all(events[:, EVENT_ON] == (sign > 0))


def test_events_lie_where_the_ramp_crosses_the_threshold() -> None:
    events = run_ramp(0.9, PLAIN, duration_us=900.0)
    assert events[:, EVENT_TIME_US] == pytest.approx([200, 400, 600, 800])


def test_on_and_off_are_mirror_images() -> None:
    up, down = run_ramp(0.93, PLAIN), run_ramp(-0.93, PLAIN)
    assert up[:, EVENT_TIME_US] == pytest.approx(down[:, EVENT_TIME_US])


def test_only_the_ratio_of_intensities_counts() -> None:
    assert run_ramp(0.93, PLAIN, start=0.0) == pytest.approx(run_ramp(0.93, PLAIN, start=5.0))


def test_the_refractory_time_keeps_events_apart() -> None:
    config = SensorConfig(threshold_mismatch=0.0, refractory_us=150, photoreceptor_us=0.0)
    times = run_ramp(4.0, config)[:, EVENT_TIME_US]
    assert len(times) > 3 and np.diff(times).min() >= 150


def test_a_slow_photoreceptor_delays_by_its_time_constant() -> None:
    slow = SensorConfig(threshold_mismatch=0.0, refractory_us=0, photoreceptor_us=50.0)
    pixels = make_pixels(np.array([0.0]), slow, np.random.default_rng(0))
    events, count, step_us = EventBuffer.empty(100).rows, 0, 5.0
    for step in range(1, 401):  # a contrast of 2 over 2 ms, in steps as short as the sweep's
        decay = np.exp(-step_us / 50.0)
        count = ramp_pixel(pixels.rows, 0, 0.005 * step, step_us * step, decay, PixelTiming(50.0, 0.0), events, count)
    late = events[4:count, EVENT_TIME_US]  # after several time constants
    assert late == pytest.approx(200.0 * np.arange(5, 5 + len(late)) + 50.0, abs=1.0)


def test_a_photoreceptor_that_still_follows_fires_after_the_light_has_settled() -> None:
    config = SensorConfig(threshold_mismatch=0.0, refractory_us=0, photoreceptor_us=200.0)
    pixels = make_pixels(np.array([0.0]), config, np.random.default_rng(0))
    pixels.rows[0, TARGET] = 1.0  # a step of light at time 0
    events = EventBuffer.empty(100).rows
    count = rest_pixel(pixels.rows, 0, 5000.0, PixelTiming(200.0, 0.0), events, 0)
    expected_us = [-200.0 * np.log(1.0 - level) for level in (0.2, 0.4, 0.6, 0.8)]
    assert events[:count, EVENT_TIME_US] == pytest.approx(expected_us)


def test_mismatch_spreads_the_thresholds_as_configured() -> None:
    pixels = make_pixels(np.zeros(20_000), SensorConfig(threshold_mismatch=0.1), np.random.default_rng(0))
    for column in (ON_THRESHOLD, OFF_THRESHOLD):
        assert pixels.rows[:, column].mean() == pytest.approx(0.2, rel=0.01)
        assert pixels.rows[:, column].std() == pytest.approx(0.02, rel=0.05)
