import math

import numpy as np
import pytest

from benchmarks.perception import measure
from benchmarks.perception.measure import circle_bound_px, edge_events, look_back_us, read_once, read_time_ns
from core.detection.methods import method_config
from core.events import Events, SensorSize
from core.recordings import PixelTruth

SENSOR = SensorSize(100, 100)


def test_no_least_squares_circle_beats_the_bound_and_it_is_nearly_reached() -> None:
    rng, n = np.random.default_rng(1), 60
    angles = 2 * np.pi * np.arange(n) / n
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    radial = rng.uniform(-0.5, 0.5, (4000, n))  # an edge somewhere in its pixel
    unknowns = np.column_stack([normals, np.ones(n)])
    centres = np.linalg.lstsq(unknowns, radial.T, rcond=None)[0][:2]
    median = float(np.median(np.hypot(*centres)))
    assert median == pytest.approx(circle_bound_px(n), rel=0.04)
    assert circle_bound_px(4 * n) == pytest.approx(circle_bound_px(n) / 2)
    assert math.isinf(circle_bound_px(0))


def test_points_on_one_side_know_less() -> None:
    rng, n = np.random.default_rng(2), 60
    angles = np.pi * np.arange(n) / n
    unknowns = np.column_stack([np.cos(angles), np.sin(angles), np.ones(n)])
    centres = np.linalg.lstsq(unknowns, rng.uniform(-0.5, 0.5, (1000, n)).T, rcond=None)[0][:2]
    assert np.median(np.hypot(*centres)) > 1.5 * circle_bound_px(n)


def test_events_of_the_edge_are_those_near_it_at_the_time_of_their_light() -> None:
    t_us = np.arange(0, 10_000, 500)
    u = 20.0 + 0.002 * t_us  # 2 px/ms
    there = PixelTruth(t_us, u, np.full(20, 50.0), np.full(20, 8.0), np.ones(20, bool))
    now = 4000
    edge_x = 20 + 0.002 * (now - measure.SENSOR_DELAY_US) + 8
    xs = [round(edge_x), round(edge_x) - 8, 90, round(edge_x)]
    events = Events.from_columns([now, now, now, 9999], xs, [50] * 4, [True] * 4, SENSOR)
    assert edge_events(events, there).t_us.tolist() == [now]
    assert len(edge_events(Events.empty(SENSOR), there)) == 0


def test_refined_looks_back_as_far_as_the_ball_is_slow_and_others_on_a_window() -> None:
    refined = method_config("refined")
    assert look_back_us("refined", refined, 1.0) == 3500
    assert look_back_us("refined", refined, 100.0) == refined.refined.history_min_us
    assert look_back_us("refined", refined, 0.0) == refined.refined.history_max_us
    assert look_back_us("paper", method_config("paper"), 1.0) == method_config("paper").window.window_us


def test_one_read_sees_every_event_and_costs_nanoseconds() -> None:
    rng, n = np.random.default_rng(3), 200_000
    t_us, x, y = np.sort(rng.integers(0, 10**6, n)), rng.integers(0, 100, n), rng.integers(0, 100, n)
    events = Events.from_columns(t_us, x, y, rng.random(n) < 0.5, SENSOR)
    total = read_once(events.t_us, events.x_px, events.y_px, events.on)
    assert total == int((t_us ^ (x + 2 * y + events.on)).sum())
    assert 0.05 < read_time_ns(events) < 100
    assert math.isnan(read_time_ns(Events.empty(SENSOR)))
