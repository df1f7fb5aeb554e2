import numpy as np

from core.detection.stages.hot_pixels import HotPixelConfig, HotPixelMemory, keep_cool_pixels
from core.events import Events, SensorSize

SENSOR = SensorSize(20, 10)
CONFIG = HotPixelConfig(enabled=True, tick_ms=4.0, persistence_ms=40.0)


def events_at(times_us: np.ndarray, x: int, y: int) -> Events:
    count = len(times_us)
    return Events.from_columns(times_us, np.full(count, x), np.full(count, y), np.ones(count), SENSOR)


def test_a_pixel_that_fires_in_every_tick_is_dropped_once_it_has_kept_that_up() -> None:
    events = events_at(np.arange(0, 200_000, 2000), 3, 4)
    keep = keep_cool_pixels(events, HotPixelMemory.blank(SENSOR), CONFIG)
    assert keep[events.t_us < 36_000].all() and not keep[events.t_us >= 40_000].any()


def test_a_passing_edge_is_kept_however_many_events_it_makes() -> None:
    events = events_at(np.arange(0, 18_000, 100), 3, 4)
    assert keep_cool_pixels(events, HotPixelMemory.blank(SENSOR), CONFIG).all()


def test_a_pixel_that_fires_in_less_than_half_of_the_ticks_is_never_dropped() -> None:
    events = events_at(np.arange(0, 2_000_000, 9000), 3, 4)
    assert keep_cool_pixels(events, HotPixelMemory.blank(SENSOR), CONFIG).all()


def test_a_pixel_that_falls_silent_is_trusted_again() -> None:
    hot = events_at(np.arange(0, 2_000_000, 1000), 3, 4)
    memory = HotPixelMemory.blank(SENSOR)
    assert not keep_cool_pixels(hot, memory, CONFIG)[-1]
    assert keep_cool_pixels(events_at(np.array([2_100_000]), 3, 4), memory, CONFIG).all()


def test_however_long_it_was_hot_a_pixel_is_trusted_again_after_twelve_silent_ticks() -> None:
    # 40 ms are ten ticks: the score is capped at 20, each silent tick takes one, and below ten it is trusted.
    for silent, trusted in ((11, False), (12, True)):
        memory = HotPixelMemory.blank(SENSOR)
        keep_cool_pixels(events_at(np.arange(0, 2_000_000, 1000), 3, 4), memory, CONFIG)
        again_us = 2_000_000 + silent * 4000
        assert keep_cool_pixels(events_at(np.array([again_us]), 3, 4), memory, CONFIG).tolist() == [trusted]


def test_the_answer_does_not_depend_on_where_windows_are_cut() -> None:
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 300_000, 3000))
    events = Events.from_columns(t, rng.integers(0, 5, 3000), rng.integers(0, 4, 3000), rng.random(3000) < 0.5, SENSOR)
    whole = keep_cool_pixels(events, HotPixelMemory.blank(SENSOR), CONFIG)
    memory = HotPixelMemory.blank(SENSOR)
    parts = [keep_cool_pixels(events.between(s, s + 7000), memory, CONFIG) for s in range(0, 300_000, 7000)]
    assert np.array_equal(np.concatenate(parts), whole)
    assert not whole.all() and whole.any()


def test_other_pixels_are_left_alone() -> None:
    t = np.arange(0, 400_000, 1000)
    x = np.where(t % 40_000 == 0, 9, 3)
    events = Events.from_columns(t, x, np.zeros(len(t)), np.ones(len(t)), SENSOR)
    keep = keep_cool_pixels(events, HotPixelMemory.blank(SENSOR), CONFIG)
    assert keep[x == 9].all() and not keep[(x == 3) & (t > 60_000)].any()
