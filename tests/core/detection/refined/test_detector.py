"""The refined detector on discs whose truth is exact, and on a simulated flight."""

import math

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.config import replace_setting
from core.detection import RefinedDetection, RefinedDetector, make_detector, refined_config
from core.detection.refined.history import EventHistory
from core.detection.refined_config import RefinedConfig
from core.events import Events, SensorSize
from core.metrics.grid_score import score_on_grid
from core.metrics.run import run_detector
from core.physics.config import physics_profile
from core.recordings import open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, scene_named, simulate_recording

pytestmark = pytest.mark.numeric
SENSOR = SensorSize(320, 240)


def detect(scene, window_us: int = 1000) -> list[RefinedDetection]:
    detector = make_detector("refined", SENSOR, replace_setting(refined_config(), ("refined", "delay_us"), 0))
    found = [detector.step(window) for window in scene.windows(window_us)]
    return [one for one in found if isinstance(one, RefinedDetection)]


@pytest.mark.parametrize("bright", [True, False], ids=["bright", "dark"])
@pytest.mark.parametrize("du_px_per_ms", [0.4, 2.5, 7.0])
def test_centre_and_velocity_are_those_of_the_disc_at_the_stated_time(
    make_scene, make_flight, du_px_per_ms, bright
) -> None:
    flight = make_flight(u_px=20.0, v_px=100.0, du_px_per_ms=du_px_per_ms, dv_px_per_ms=0.2, bright=bright)
    duration_us = int(min(80_000, 270_000 / du_px_per_ms))
    found = detect(make_scene(flight, noise_hz=2, duration_us=duration_us))
    assert len(found) > 0.5 * duration_us / 1000
    errors = [math.dist((one.u_px, one.v_px), flight.centre(one.t_us)) for one in found]
    assert np.median(errors) < 0.25 and max(errors) < 1.0
    assert np.median([one.vu_px_per_ms for one in found]) == pytest.approx(du_px_per_ms, rel=0.05)
    assert np.median([one.r_px for one in found]) == pytest.approx(flight.r_px, abs=0.8)
    assert all(np.linalg.eigvalsh(one.covariance).min() > 0 for one in found)


def test_the_stated_time_is_earlier_by_the_sensors_delay(make_scene, make_flight) -> None:
    windows = make_scene(make_flight(), duration_us=60_000).windows(1000)
    late = RefinedDetector(RefinedConfig(delay_us=430), SENSOR)
    for window in windows:
        one = late.step(window)
        assert one is None or one.t_us == window.end_us - 430


def test_what_has_vanished_is_not_seen_any_more(make_scene, make_flight) -> None:
    """A slow ball's history is long: half of it would do for a fit."""
    whole = make_scene(make_flight(du_px_per_ms=0.5, dv_px_per_ms=0.0), duration_us=120_000)
    found = detect(type(whole)(whole.slice(0, 80_000), 120_000))
    assert found and max(one.t_us for one in found) <= 82_000
    assert max(one.t_us for one in detect(whole)) > 115_000


@pytest.mark.gate
def test_a_dot_that_turns_at_13_px_per_ms_is_followed_on_its_circle(shared_data) -> None:
    stream = next(iter(open_recording(shared_data / "events/rotating_dot_evt2_640x480.raw").cameras.values()))
    answers = run_detector(stream, make_detector("refined", stream.sensor), 1000)
    u, v = answers.u_px[answers.detected], answers.v_px[answers.detected]
    assert len(u) >= 35, "of 50 windows"
    distance = np.hypot(u - 314.3, v - 202.4)
    assert distance.mean() == pytest.approx(106.5, abs=1.5) and distance.std() <= 0.45
    turned = np.polyfit(answers.t_us[answers.detected] * 1e-6, np.unwrap(np.arctan2(v - 202.4, u - 314.3)), 1)[0]
    assert turned == pytest.approx(121.8, abs=0.7), "radians a second, as the disc is said to turn"


def test_a_ball_that_meets_its_own_shadow_is_not_lost(make_scene, make_flight) -> None:
    """The shadow darkens pixels before the ball brightens them, and brightens them after it has left."""
    ball = make_flight(u_px=20.0, v_px=100.0, dv_px_per_ms=0.1)
    shadow = make_flight(u_px=53.0, v_px=118.0, du_px_per_ms=1.6, dv_px_per_ms=-0.1, r_px=10.0, bright=False)
    found = detect(make_scene(ball, shadow, duration_us=120_000))
    errors = [math.dist((one.u_px, one.v_px), ball.centre(one.t_us)) for one in found]
    assert len(found) > 100 and np.median(errors) < 0.3 and max(errors) < 2.5


def test_a_hand_that_was_taken_for_the_ball_gives_way_to_it(make_scene, make_flight) -> None:
    """A hand is slow and not quite round: its events are up to a pixel off. The ball comes when it is followed."""
    hand = make_flight(u_px=60.0, v_px=60.0, du_px_per_ms=0.7, dv_px_per_ms=0.0)
    ball = make_flight(u_px=-130.0, v_px=150.0, du_px_per_ms=2.5, dv_px_per_ms=0.1)
    scene, rng = make_scene(hand, duration_us=110_000), np.random.default_rng(1)
    one, other = scene.events, make_scene(ball, noise_hz=0, duration_us=110_000).events
    t, on = np.concatenate([one.t_us, other.t_us]), np.concatenate([one.on, other.on])
    x, y = (
        np.clip(np.concatenate([axis + rng.integers(-1, 2, len(axis)), more]), 0, 239 + 80 * (axis is one.x_px))
        for axis, more in ((one.x_px, other.x_px), (one.y_px, other.y_px))
    )
    order = np.argsort(t, kind="stable")
    found = detect(type(scene)(Events.from_columns(t[order], x[order], y[order], on[order], SENSOR), 110_000))
    assert any(math.dist((one.u_px, one.v_px), hand.centre(one.t_us)) < 2 for one in found), "it is taken for one"
    late = [one for one in found if one.t_us > 85_000]
    assert len(late) > 20 and all(math.dist((one.u_px, one.v_px), ball.centre(one.t_us)) < 2 for one in late)


def test_noise_and_hot_pixels_alone_are_no_ball(make_scene) -> None:
    assert detect(make_scene(noise_hz=20, duration_us=150_000)) == []


def test_a_head_that_moves_like_one_is_no_ball(make_scene, make_flight) -> None:
    assert detect(make_scene(make_flight(r_px=30.0, du_px_per_ms=0.3, u_px=100.0), duration_us=150_000)) == []


def test_the_history_keeps_its_span_whatever_comes() -> None:
    history, rng, told = EventHistory(5000), np.random.default_rng(1), np.empty(0, np.int64)
    for end_us in range(1000, 120_000, 1000):
        count = int(rng.choice([0, 3, 900, 40_000]))
        t = np.sort(rng.integers(end_us - 1000, end_us, count))
        history.append(Events.from_columns(t, t % 320, t % 240, t % 2 == 0, SENSOR), end_us)
        told = np.concatenate([told, t])[-400_000:]
        kept = history.recent
        assert np.array_equal(kept.t_us, told[told >= end_us - 5000])
        assert np.array_equal(kept.x_px, kept.t_us % 320) and np.array_equal(kept.y_px, kept.t_us % 240)
        assert np.array_equal(kept.on, kept.t_us % 2 == 0)


def test_a_simulated_flight_is_followed_over_its_bounce_to_a_fraction_of_a_pixel(tmp_path) -> None:
    config = StereoConfig(scene=scene_named("ball"), sensor=SensorConfig(noise_hz=1.0))
    sensor = SensorSize(640, 360)
    cameras = {"left": stereo_preset("side", sensor)["left"]}
    launch = LaunchConfig(speed_mps=6.0)
    simulate_recording(tmp_path / "flight.h5", config, cameras, [launch], seed=4, physics=physics_profile("real"))
    stream = open_recording(tmp_path / "flight.h5").cameras["left"]
    assert stream.truth is not None
    score = {
        method: score_on_grid(
            run_detector(stream, make_detector(method, sensor), window_us), stream.truth, sensor, (1.0, 1e9),
            window_us=window_us,
        )
        for method, window_us in (("refined", 1000), ("auto", 2000))
    }  # fmt: skip
    refined, auto = score["refined"], score["auto"]
    assert refined.asked > 100
    assert refined.precision >= 0.99 and refined.recall >= 0.9
    assert refined.error_at(50) <= 0.3 and refined.error_at(95) <= 1.0
    assert refined.error_at(50) < 0.4 * auto.error_at(50)


def test_a_person_who_walks_is_no_ball(shared_data) -> None:
    stream = next(iter(open_recording(shared_data / "events/walker_evt3_640x480.raw").cameras.values()))
    assert run_detector(stream, make_detector("refined", stream.sensor), 1000).detected.sum() <= 1
