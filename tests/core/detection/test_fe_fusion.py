"""F-E Fusion on discs whose truth is exact."""

import math

import numpy as np
import pytest

from core.config import replace_setting
from core.detection import Detection, fe_fusion_config, make_detector
from core.detection.fe_fusion import ROOM, FeFusionDetector
from core.detection.fe_fusion_config import FeFusionConfig
from core.events import Events, SensorSize, Window

SENSOR = SensorSize(320, 240)
WINDOW_US = fe_fusion_config().window.window_us


def detect(scene) -> list[Detection]:
    detector = make_detector("fe-fusion", SENSOR, replace_setting(fe_fusion_config(), ("fe_fusion", "delay_us"), 0))
    found = [detector.step(window) for window in scene.windows(WINDOW_US)]
    return [one for one in found if one is not None]


@pytest.mark.parametrize("bright", [True, False], ids=["bright", "dark"])
@pytest.mark.parametrize("du_px_per_ms", [1.2, 2.5, 6.0])
def test_the_centre_is_that_of_the_disc_at_the_stated_time(make_scene, make_flight, du_px_per_ms, bright) -> None:
    flight = make_flight(u_px=20.0, v_px=100.0, du_px_per_ms=du_px_per_ms, dv_px_per_ms=0.2, bright=bright)
    duration_us = int(min(80_000, 270_000 / du_px_per_ms))
    found = detect(make_scene(flight, noise_hz=1, duration_us=duration_us))
    assert len(found) > 0.8 * duration_us / WINDOW_US
    errors = [math.dist((one.u_px, one.v_px), flight.centre(one.t_us)) for one in found]
    assert np.median(errors) < 1.0
    assert 0.6 * flight.r_px < np.median([one.r_px for one in found]) < 1.4 * flight.r_px


def test_noise_alone_is_no_ball(make_scene) -> None:
    assert detect(make_scene(noise_hz=5, duration_us=200_000)) == []


def test_the_stated_time_is_the_middle_of_the_window_less_the_sensors_delay(make_scene, make_flight) -> None:
    windows = make_scene(make_flight(), duration_us=60_000).windows(4000)
    detector = FeFusionDetector(FeFusionConfig(delay_us=430), SENSOR)
    ends = [(window.end_us, one.t_us) for window in windows if (one := detector.step(window)) is not None]
    assert len(ends) > 10 and all(t_us == end_us - 2000 - 430 for end_us, t_us in ends)


def test_what_passes_beside_the_ball_is_counted(make_scene, make_flight) -> None:
    flights = make_flight(v_px=60.0, r_px=8.0), make_flight(v_px=180.0, r_px=10.0)
    detector = FeFusionDetector(FeFusionConfig(roi_expand_px=400.0), SENSOR)
    counts = []
    for window in make_scene(*flights, noise_hz=0.1, duration_us=60_000).windows(4000):
        detector.step(window)
        counts.append(detector.extra_circles)
    assert np.median(counts) == 1
    detector.step(Window(Events.empty(SENSOR), 60_000, 64_000))
    assert detector.extra_circles == 0


def test_a_window_with_more_events_than_there_is_room_for(make_scene, make_flight) -> None:
    scene = make_scene(make_flight(), noise_hz=300, duration_us=4000)
    events = scene.slice(0, 4000)
    many = Events.from_columns(*(np.repeat(c, 1 + ROOM // len(events)) for c in
                                 (events.t_us, events.x_px, events.y_px, events.on)), SENSOR)  # fmt: skip
    assert len(many) > ROOM
    found = make_detector("fe-fusion", SENSOR).step(Window(many, 0, 4000))
    assert found is None or 0 <= found.u_px < SENSOR.width_px
