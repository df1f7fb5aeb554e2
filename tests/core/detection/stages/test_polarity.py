import numpy as np
import pytest

from core.detection.stages.polarity import PolarityConfig, near_centroid, on_evidence, on_leads, remember
from core.events import Events, SensorSize


@pytest.mark.parametrize("speed", [1.2, 2.0, 4.0])
@pytest.mark.parametrize("bright", [True, False])
@pytest.mark.parametrize("direction", [0.0, 2.2, 4.5])
def test_the_drift_shows_which_edge_leads(
    make_scene, make_flight, speed: float, bright: bool, direction: float
) -> None:
    du, dv = speed * np.cos(direction), speed * np.sin(direction)
    flight = make_flight(u_px=160, v_px=120, du_px_per_ms=du, dv_px_per_ms=dv, bright=bright)
    evidence = on_evidence(make_scene(flight, noise_hz=0, duration_us=2000).events)
    assert (evidence > 2.0) if bright else (evidence < -2.0)


@pytest.mark.parametrize("bright", [True, False])
def test_a_slow_ball_shows_it_over_several_windows(make_scene, make_flight, bright: bool) -> None:
    flight = make_flight(u_px=160, v_px=120, du_px_per_ms=0.4, dv_px_per_ms=0.1, bright=bright)
    memory, config = 0.0, PolarityConfig()
    for window in make_scene(flight, noise_hz=0, duration_us=40_000).windows():
        memory = remember(memory, on_evidence(window.events), 2000, config)
    assert (memory > 4.0) if bright else (memory < -4.0)


def test_swapping_the_polarities_swaps_the_sign(make_scene, make_flight) -> None:
    events = make_scene(make_flight(), noise_hz=5, duration_us=2000).events
    swapped = Events.from_columns(events.t_us, events.x_px, events.y_px, ~events.on, events.sensor)
    assert on_evidence(swapped) == pytest.approx(-on_evidence(events)) and on_evidence(events) > 0


def test_one_polarity_alone_or_one_moment_or_nothing_is_no_evidence() -> None:
    sensor = SensorSize(50, 50)
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, 50, (2, 100))
    assert on_evidence(Events.from_columns(np.arange(100), x, y, np.ones(100), sensor)) == 0.0
    assert on_evidence(Events.from_columns(np.zeros(100), x, y, x > 25, sensor)) == 0.0
    assert on_evidence(Events.empty(sensor)) == 0.0


def test_only_auto_listens_to_the_evidence() -> None:
    auto, on, off = (PolarityConfig(leading_polarity=name) for name in ("auto", "on", "off"))
    assert on_leads(-3.0, 0.0, auto) is False and on_leads(-3.0, 4.0, auto) is True and on_leads(0.0, 0.0, auto) is True
    assert on_leads(-9.0, -9.0, on) is True and on_leads(9.0, 9.0, off) is False


def test_memory_fades_adds_and_stays_within_its_limit() -> None:
    config = PolarityConfig(memory_ms=40.0, memory_limit=30.0)
    assert remember(10.0, None, 40_000, config) == pytest.approx(10.0 / np.e)
    assert remember(0.0, 5.0, 2000, config) == 5.0
    assert remember(29.0, 20.0, 2000, config) == 30.0 and remember(-29.0, -20.0, 2000, config) == -30.0
    assert remember(10.0, 5.0, 2000, PolarityConfig(memory_ms=0.0)) == 0.0


def test_outliers_are_those_beyond_the_radius_around_the_centroid() -> None:
    xy = np.array([[10, 10], [12, 10], [10, 12], [12, 12], [41, 11]], np.int32)
    assert near_centroid(xy, xy[:4], 30.0).tolist() == [True] * 5
    assert near_centroid(xy, xy[:4], 29.9).tolist() == [True] * 4 + [False]
    assert near_centroid(xy, xy[:0], 30.0).tolist() == [False] * 5
