import numpy as np
import pytest

from core.detection.stages.flicker import FlickerConfig, FlickerMemory, keep_steady_pixels
from core.events import Events, SensorSize

SENSOR = SensorSize(8, 6)
CONFIG = FlickerConfig(enabled=True, cycles_min=3)


def blinking(frequency_hz: float, duration_us: int = 200_000) -> Events:
    """One pixel, two ON events and two OFF events in every period."""
    starts = np.arange(0, duration_us, 1e6 / frequency_hz)
    t = (starts[:, None] + np.array([0, 300, 0.5e6 / frequency_hz, 0.5e6 / frequency_hz + 300])).ravel()
    on = np.tile([True, True, False, False], len(starts))
    return Events.from_columns(t.astype(np.int64), np.full(len(t), 2), np.full(len(t), 3), on, SENSOR)


@pytest.mark.parametrize("frequency_hz", [100.0, 120.0, 240.0])
def test_a_lamp_on_the_mains_is_dropped_after_the_required_periods(frequency_hz: float) -> None:
    events = blinking(frequency_hz)
    keep = keep_steady_pixels(events, FlickerMemory.blank(SENSOR), CONFIG)
    assert keep[:12].all(), "three periods are needed to know"
    assert not keep[12:].any()


@pytest.mark.parametrize("frequency_hz", [20.0, 700.0])
def test_other_rhythms_are_kept(frequency_hz: float) -> None:
    assert keep_steady_pixels(blinking(frequency_hz), FlickerMemory.blank(SENSOR), CONFIG).all()


def test_a_ball_that_passes_once_is_kept() -> None:
    t = np.array([0, 100, 200, 9000, 9100, 9200])
    events = Events.from_columns(t, np.full(6, 2), np.full(6, 2), t < 5000, SENSOR)
    assert keep_steady_pixels(events, FlickerMemory.blank(SENSOR), CONFIG).all()


def test_a_lamp_that_was_switched_off_is_forgotten() -> None:
    memory = FlickerMemory.blank(SENSOR)
    assert not keep_steady_pixels(blinking(100.0), memory, CONFIG)[-1]
    later = Events.from_columns([400_000], [2], [3], [True], SENSOR)
    assert keep_steady_pixels(later, memory, CONFIG).all()


def test_the_answer_does_not_depend_on_where_windows_are_cut() -> None:
    events = blinking(100.0)
    whole = keep_steady_pixels(events, FlickerMemory.blank(SENSOR), CONFIG)
    memory = FlickerMemory.blank(SENSOR)
    parts = [keep_steady_pixels(events.between(s, s + 3000), memory, CONFIG) for s in range(0, 210_000, 3000)]
    assert np.array_equal(np.concatenate(parts), whole)
