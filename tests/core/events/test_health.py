import itertools

import numpy as np
import pytest

from core.events import Events, SensorSize, assess_health, sample_spans
from core.events.health import Gap, find_gaps

SENSOR = SensorSize(64, 48)


def noise(rng: np.random.Generator, start_us: int, length_us: int, count: int, hot: tuple[int, int] | None) -> Events:
    t = np.sort(rng.integers(start_us, start_us + length_us, count))
    x, y = rng.integers(0, SENSOR.width_px, count), rng.integers(0, SENSOR.height_px, count)
    if hot is not None:
        x[::50], y[::50] = hot
    return Events.from_columns(t, x, y, rng.random(count) < 0.7, SENSOR)


def test_a_hot_pixel_is_found_and_noise_is_not() -> None:
    rng = np.random.default_rng(1)
    samples = [noise(rng, 100_000 * n, 20_000, 200, (7, 9)) for n in range(20)]
    health = assess_health(np.full(2000, 10), 2_000_000, samples, SENSOR)
    assert health.hot_pixels_xy.tolist() == [[7, 9]]
    assert health.on_share == pytest.approx(0.7, abs=0.03)
    assert health.mean_rate_hz == pytest.approx(10_000) and health.peak_rate_hz == 10_000
    assert health.gaps == ()


def test_the_share_of_on_events_is_that_of_the_samples_and_not_known_without_any() -> None:
    nothing, on = np.zeros(3, np.int64), np.array([True, False, False])
    sample = Events.from_columns(np.arange(3), nothing, nothing, on, SENSOR)
    assert assess_health(np.full(1, 3), 1000, [sample], SENSOR).on_share == 1 / 3
    assert np.isnan(assess_health(np.zeros(1, np.int64), 1000, [], SENSOR).on_share)


def test_something_that_passes_is_not_a_hot_pixel() -> None:
    rng = np.random.default_rng(2)
    passing = noise(rng, 0, 20_000, 200, (7, 9))
    quiet = [noise(rng, 100_000 * n, 20_000, 200, None) for n in range(1, 20)]
    assert len(assess_health(np.full(2000, 10), 2_000_000, [passing, *quiet], SENSOR).hot_pixels_xy) == 0


@pytest.mark.parametrize("duration_us", [0, 1, 30, 50_001, 799_999, 800_000, 60_000_000])
def test_samples_never_overlap_and_lie_inside(duration_us: int) -> None:
    spans = sample_spans(duration_us)
    assert all(end <= start for (_, end), (start, _) in itertools.pairwise(spans))
    assert spans[0][0] == 0 and spans[-1][1] <= max(duration_us, 1)
    assert all(0 < end - start <= 20_000 for start, end in spans)
    assert len(spans) == 40 or duration_us < 40


def test_something_that_runs_round_in_a_short_recording_is_not_hot_pixels_but_a_hot_pixel_there_is() -> None:
    """A dot that needs 50 ms for its round, in a recording of 50 ms, and a pixel that fires every millisecond."""
    t = np.arange(0, 50_000, 5)
    angle = 2 * np.pi * t / 50_000
    x, y = (32 + 20 * np.cos(angle)).astype(int), (24 + 20 * np.sin(angle)).astype(int)
    x[::100], y[::100] = 3, 5
    events = Events.from_columns(t, x, y, np.ones(len(t), np.bool_), SENSOR)
    samples = [events.between(*span) for span in sample_spans(50_000)]
    health = assess_health(np.full(50, 200), 50_000, samples, SENSOR)
    assert health.hot_pixels_xy.tolist() == [[3, 5]]


def test_a_silence_in_a_busy_stream_is_a_gap() -> None:
    counts = np.full(1000, 20)
    counts[300:340] = 0
    counts[700] = 0  # a single empty millisecond is shorter than the shortest gap
    assert find_gaps(counts) == (Gap(300_000, 340_000),)


def test_a_sparse_stream_has_no_gaps_by_chance() -> None:
    counts = np.random.default_rng(3).poisson(0.05, 20_000)
    assert find_gaps(counts) == ()


def test_nothing_at_all_is_healthy_in_its_way() -> None:
    health = assess_health(np.zeros(0, np.int64), 0, [], SENSOR)
    assert health.event_count == 0 and np.isnan(health.on_share) and health.gaps == ()
