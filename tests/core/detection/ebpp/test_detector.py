"""EBPP on discs whose truth is exact, and on a simulated flight."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.config import replace_setting
from core.detection import Detection, ebpp_config, make_detector
from core.detection.ebpp import EbppDetector
from core.detection.ebpp_config import EbppConfig
from core.events import Events, SensorSize, Window
from core.metrics.grid_score import score_on_grid
from core.metrics.run import run_detector
from core.recordings import open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, scene_named, simulate_recording

pytestmark = pytest.mark.numeric
SENSOR = SensorSize(320, 240)
WINDOW_US = ebpp_config().window.window_us


def detect(scene) -> list[Detection]:
    detector = make_detector("ebpp", SENSOR, replace_setting(ebpp_config(), ("ebpp", "delay_us"), 0))
    found = [detector.step(window) for window in scene.windows(WINDOW_US)]
    return [one for one in found if one is not None]


@pytest.mark.parametrize("bright", [True, False], ids=["bright", "dark"])
@pytest.mark.parametrize("du_px_per_ms", [0.4, 2.5, 6.0])
def test_the_centre_is_that_of_the_disc_at_the_stated_time(make_scene, make_flight, du_px_per_ms, bright) -> None:
    flight = make_flight(u_px=20.0, v_px=100.0, du_px_per_ms=du_px_per_ms, dv_px_per_ms=0.2, bright=bright)
    duration_us = int(min(80_000, 270_000 / du_px_per_ms))
    found = detect(make_scene(flight, noise_hz=1, duration_us=duration_us))
    assert len(found) > 0.8 * duration_us / WINDOW_US
    off_px = np.array([(one.u_px, one.v_px) for one in found]) - [flight.centre(one.t_us) for one in found]
    assert math.hypot(*off_px.mean(axis=0)) < 1.0
    assert np.median(np.hypot(*off_px.T)) < 1.5, "the accumulator has cells of a pixel, and the surface broad edges"
    assert np.median([one.r_px for one in found]) == pytest.approx(flight.r_px, abs=1.5)


def test_noise_alone_is_no_ball(make_scene) -> None:
    assert len(detect(make_scene(noise_hz=5, duration_us=200_000))) <= 1


def test_the_stated_time_is_earlier_by_the_sensors_delay(make_scene, make_flight) -> None:
    windows = make_scene(make_flight(), duration_us=60_000).windows(WINDOW_US)
    detector = EbppDetector(EbppConfig(delay_us=430), SENSOR)
    ends = [(window.end_us, one.t_us) for window in windows if (one := detector.step(window)) is not None]
    assert len(ends) > 20 and all(t_us == end_us - 430 for end_us, t_us in ends)


def test_a_ball_that_flies_on_unseen_is_searched_on_the_whole_sensor(make_scene, make_flight) -> None:
    windows = make_scene(make_flight(du_px_per_ms=2.0), noise_hz=0.1, duration_us=110_000).windows(2000)
    detector = EbppDetector(EbppConfig(misses_to_reset=3), SENSOR)
    seen = [one for window in windows[:15] if (one := detector.step(window)) is not None]
    for window in windows[15:18]:
        assert detector.step(Window(Events.empty(SENSOR), window.start_us, window.end_us)) is None
    again = [one for window in windows[45:55] if (one := detector.step(window)) is not None]
    assert len(again) >= 7
    assert again[-1].u_px - seen[-1].u_px > 2 * EbppConfig().roi_expand_px, "far outside the region where it was lost"


def test_a_circle_without_new_events_on_it_is_no_ball(make_scene, make_flight) -> None:
    """The surface still shows the ball that vanished, while noise goes on elsewhere."""
    config = EbppConfig(support_us=0)
    detectors = EbppDetector(config, SENSOR), EbppDetector(replace(config, fresh_min=0.0), SENSOR)
    flight = make_scene(make_flight(du_px_per_ms=2.0), duration_us=40_000).windows(2000)
    noise = make_scene(noise_hz=0.05, duration_us=60_000, seed=3).windows(2000)[len(flight) :]
    for window in flight:
        found = [one.step(window) for one in detectors]
    assert found[0] == found[1] is not None
    assert any(len(window.events) for window in noise)
    for window in noise[:2]:
        assert detectors[0].step(window) is None
        (reason,) = detectors[0].why_not()
        assert reason.setting in ("ebpp.fresh_min", "window.window_us")
    stale = [one for window in noise[:2] if (one := detectors[1].step(window)) is not None]
    assert stale, "without the limit it is answered"


def test_a_simulated_flight_is_found_in_nearly_every_window(tmp_path) -> None:
    config = StereoConfig(scene=scene_named("ball"), sensor=SensorConfig(noise_hz=0.1))
    sensor = SensorSize(640, 360)
    cameras = {"left": stereo_preset("side", sensor)["left"]}
    simulate_recording(tmp_path / "flight.h5", config, cameras, [LaunchConfig(speed_mps=6.0)], seed=4)
    stream = open_recording(tmp_path / "flight.h5").cameras["left"]
    assert stream.truth is not None
    answers = run_detector(stream, make_detector("ebpp", sensor), WINDOW_US)
    score = score_on_grid(answers, stream.truth, sensor, (0.0, 1e9), window_us=WINDOW_US)
    assert score.asked > 100
    assert score.recall >= 0.9 and score.precision >= 0.9 and score.error_at(50) < 2.0
