from __future__ import annotations

import numpy as np
import pytest

from benchmarks.labels.assistance import MIDDLE_US, SENSOR, Clip, draw_clip, try_snap
from core.events import Events, SensorSize
from core.simulation.sensor.sensor import SensorConfig
from labels.assist.snap import snap

pytestmark = pytest.mark.numeric


@pytest.fixture(scope="module")
def clip() -> Clip:
    return draw_clip(np.random.default_rng(3), speed_mps=5.0, radius_px=9.0)


def truth_of(clip: Clip) -> tuple[float, float]:
    return float(clip.truth.u_px[0]), float(clip.truth.v_px[0])


def test_a_click_near_a_simulated_ball_snaps_to_its_centre() -> None:
    trial = try_snap(25, np.random.default_rng(8))
    found = np.isfinite(trial.error_px)
    assert found.mean() > 0.9
    assert np.median(trial.error_px[found]) <= 0.25
    assert np.percentile(trial.error_px[found], 95) <= 0.8


def test_the_covariance_covers_the_error() -> None:
    trial = try_snap(25, np.random.default_rng(9))
    assert np.mean(trial.mahalanobis[np.isfinite(trial.error_px)] < 9.21) > 0.8  # 99 % of two dimensions


@pytest.mark.parametrize("scene", ["ball", "dark", "low-contrast"])
def test_the_radius_is_the_balls_whatever_its_speed(scene: str) -> None:
    trial = try_snap(25, np.random.default_rng(21), scene=scene)  # not one of the balls that it was calibrated on
    there = np.isfinite(trial.radius_ratio)
    assert there.sum() >= 20
    assert np.median(trial.radius_ratio[there]) == pytest.approx(1.0, abs=0.05)
    faster = trial.speed_px_per_ms > np.median(trial.speed_px_per_ms[there])
    slow, fast = (np.median(trial.radius_ratio[there & side]) for side in (~faster, faster))
    assert slow == pytest.approx(fast, abs=0.05)


def test_where_the_click_was_does_not_matter(clip: Clip) -> None:
    x, y = truth_of(clip)
    places = []
    for dx, dy in ((0, 0), (5, 0), (-3, 4), (0, -5)):
        found = snap(clip.events, MIDDLE_US, x + dx, y + dy)
        assert found is not None
        places.append((found.x_px, found.y_px))
    assert np.ptp(places, axis=0).max() < 0.25


def test_a_known_velocity_leads_to_the_same_circle(clip: Clip) -> None:
    x, y = truth_of(clip)
    plain = snap(clip.events, MIDDLE_US, x, y)
    hinted = snap(clip.events, MIDDLE_US, x, y, v_px_per_ms=tuple(clip.v_px_per_ms.tolist()), r_px=9.0)
    assert plain is not None and hinted is not None
    assert np.hypot(plain.x_px - hinted.x_px, plain.y_px - hinted.y_px) < 0.2
    velocity = np.array([plain.vx_px_per_ms, plain.vy_px_per_ms])
    assert np.linalg.norm(velocity - clip.v_px_per_ms) < 0.1 * np.linalg.norm(clip.v_px_per_ms)


@pytest.mark.parametrize("speed_px_per_ms", [0.5, 1.0, 4.0])
def test_a_snap_rests_on_two_pixels_of_motion_before_and_after_however_fast_the_ball_is(speed_px_per_ms: float) -> None:
    """An ideal disc that each pixel sees come and go: in 4 px of motion either arc sweeps 4 px times the diameter."""
    radius, middle, sensor = 8.0, np.array([100.3, 60.2]), SensorSize(200, 120)
    y, x = (axis.ravel() for axis in np.mgrid[0:120, 0:200])
    half = np.sqrt(np.maximum(radius**2 - (y - middle[1]) ** 2, 0.0))
    met = half > 0
    come, go = ((x + side * half - middle[0]) / speed_px_per_ms for side in (-1, 1))
    t_us = np.round(MIDDLE_US + 240 + 1e3 * np.concatenate([come[met], go[met]])).astype(np.int64)
    on = np.repeat([True, False], met.sum())
    rows = np.flatnonzero(np.abs(t_us - MIDDLE_US) < 20_000)
    rows = rows[np.argsort(t_us[rows], kind="stable")]
    xs, ys = np.tile(x[met], 2), np.tile(y[met], 2)
    events = Events.from_columns(t_us[rows], xs[rows], ys[rows], on[rows], sensor)
    found = snap(events, MIDDLE_US, 102.0, 59.0)
    assert found is not None and found.on_leads
    assert (found.x_px, found.y_px) == pytest.approx(middle, abs=0.1) and found.r_px == pytest.approx(radius, abs=0.2)
    assert (found.vx_px_per_ms, found.vy_px_per_ms) == pytest.approx((speed_px_per_ms, 0.0), abs=0.05 * speed_px_per_ms)
    assert found.points == pytest.approx(2 * (2 * 2.0) * 2 * radius, rel=0.15)


def test_a_dark_ball_on_a_bright_wall_is_snapped_too() -> None:
    dark = draw_clip(np.random.default_rng(5), speed_mps=6.0, radius_px=9.0, scene="dark")
    x, y = truth_of(dark)
    found = snap(dark.events, MIDDLE_US, x + 1, y - 1)
    assert found is not None
    assert not found.on_leads
    assert np.hypot(found.x_px - x, found.y_px - y) < 0.8


def test_mirrored_events_give_the_mirrored_circle(clip: Clip) -> None:
    x, y = truth_of(clip)
    events = clip.events
    flipped = Events.from_columns(events.t_us, SENSOR.width_px - 1 - events.x_px, events.y_px, events.on, SENSOR)
    plain, mirrored = snap(events, MIDDLE_US, x, y), snap(flipped, MIDDLE_US, SENSOR.width_px - 1 - x, y)
    assert plain is not None and mirrored is not None
    assert mirrored.x_px == pytest.approx(SENSOR.width_px - 1 - plain.x_px, abs=1e-6)
    assert mirrored.y_px == pytest.approx(plain.y_px, abs=1e-6)
    xx, xy, yy = plain.covariance_px2
    assert mirrored.covariance_px2 == pytest.approx((xx, -xy, yy), abs=1e-6)


def test_nothing_snaps_to_nothing(clip: Clip) -> None:
    x, y = truth_of(clip)
    assert snap(Events.empty(SENSOR), MIDDLE_US, 100.0, 100.0) is None
    assert snap(clip.events, MIDDLE_US, x + 60, y) is None
    assert snap(clip.events, 10**9, x, y) is None


def test_noise_alone_is_no_ball() -> None:
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(10):
        count = 3000
        t = np.sort(rng.integers(0, 40_000, count))
        events = Events.from_columns(
            t, rng.integers(0, 80, count), rng.integers(0, 80, count), rng.random(count) < 0.5, SensorSize(80, 80)
        )
        found += snap(events, 20_000, 40.0, 40.0) is not None
    assert found <= 1


def test_a_slower_sensor_needs_its_own_delay() -> None:
    """The delay is the sensor's; with the wrong one the centre is behind by so much of the motion."""
    slow = draw_clip(
        np.random.default_rng(6), speed_mps=5.0, radius_px=9.0, sensor=SensorConfig(photoreceptor_us=600.0)
    )
    x, y = truth_of(slow)
    found = snap(slow.events, MIDDLE_US, x, y)
    assert found is not None
    speed = np.linalg.norm(slow.v_px_per_ms)
    behind = float(np.dot((x - found.x_px, y - found.y_px), slow.v_px_per_ms / speed))
    assert 0.1 * speed < behind < 0.6 * speed
