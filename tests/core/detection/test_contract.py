"""What every detector promises, ours and the rivals'."""

from collections.abc import Callable

import numpy as np
import pytest

from core.config import replace_setting
from core.detection import Detector, FastDetector, ReferenceDetector, auto_config, make_detector
from core.detection.methods import METHODS
from core.detection.yolo.detector import YoloDetector
from core.events import Events, SensorSize, Window

pytestmark = pytest.mark.numeric
SENSOR = SensorSize(320, 240)
WITH_ALL_STAGES = replace_setting(
    replace_setting(auto_config(), ("hot_pixels", "enabled"), True), ("flicker", "enabled"), True
)
DETECTORS: dict[str, Callable[[], Detector] | str] = {
    **{name: lambda name=name: make_detector(name, SENSOR) for name in METHODS},
    "reference": lambda: ReferenceDetector(auto_config()),
    "reference with all stages": lambda: ReferenceDetector(WITH_ALL_STAGES),
    "fast with all stages": lambda: FastDetector(WITH_ALL_STAGES),
    "yolo": "small_yolo",
}
"""Those that look at pictures by the fixture with their weights."""


@pytest.fixture(params=DETECTORS, scope="module")
def make(request) -> Callable[[], Detector]:
    found = DETECTORS[request.param]
    if not isinstance(found, str):
        return found
    weights = request.getfixturevalue(found)
    return lambda: YoloDetector(weights)


@pytest.fixture(scope="module")
def windows(make_scene, make_flight, add_frames) -> list[Window]:
    flight = make_flight(du_px_per_ms=2.5)
    return add_frames(make_scene(flight, noise_hz=5, duration_us=60_000).windows(), flight)


def test_it_finds_a_plain_ball_and_times_its_answer_within_the_window(make, windows) -> None:
    detector = make()
    found = [detector.step(window) for window in windows]
    assert sum(one is not None for one in found) >= 25
    for window, one in zip(windows, found, strict=True):
        assert one is None or window.start_us <= one.t_us <= window.end_us


def test_an_empty_window_has_no_ball_first_in_between_and_last(make, windows) -> None:
    detector = make()
    for start in (0, 2000, 500_000):
        assert detector.step(Window(Events.empty(SENSOR), start, start + 2000)) is None
        assert detector.extra_circles == 0
    assert any(detector.step(window) for window in windows[:5])


def test_a_single_event_is_no_ball(make) -> None:
    assert make().step(Window(Events.from_columns([5], [3], [4], [True], SENSOR), 0, 2000)) is None


def test_reset_forgets_everything(make, windows) -> None:
    detector = make()
    first = [detector.step(window) for window in windows]
    detector.reset()
    assert [detector.step(window) for window in windows] == first


def test_two_of_a_kind_answer_the_same(make, windows) -> None:
    one, other = make(), make()
    assert [one.step(window) for window in windows] == [other.step(window) for window in windows]


def test_nothing_it_is_given_is_written_to(make, windows) -> None:
    detector = make()
    for window in windows[:10]:
        assert window.frame is not None
        image = window.frame.image
        columns = [
            column.copy()
            for column in (window.events.t_us, window.events.x_px, window.events.y_px, window.events.on, image)
        ]
        detector.step(window)
        after = (window.events.t_us, window.events.x_px, window.events.y_px, window.events.on, image)
        assert all(np.array_equal(a, b) for a, b in zip(columns, after, strict=True))
        assert not any(column.flags.writeable for column in after)


def test_other_sensor_sizes_can_follow(make, make_scene, add_frames) -> None:
    detector = make()
    for sensor in (SensorSize(64, 1), SensorSize(1, 64), SensorSize(333, 217)):
        detector.reset()
        windows = add_frames(make_scene(noise_hz=300, duration_us=8000, sensor=sensor).windows(), None)
        found = [detector.step(window) for window in windows]
        fresh = make()
        assert found == [fresh.step(window) for window in windows], "nothing of the other sensor is left"
        for one in found:
            assert one is None or (0 <= one.u_px < sensor.width_px and 0 <= one.v_px < sensor.height_px)
