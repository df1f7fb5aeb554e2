"""What every detector promises, ours and the rivals'."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from core.config import field_specs, replace_setting
from core.detection import Detector, DetectorConfig, FastDetector, ReferenceDetector, auto_config, make_detector
from core.detection.method_trace import explain_step
from core.detection.methods import METHODS, VIEWS
from core.detection.reasons import Reason, reasons_of
from core.detection.window import ImageMotion, WindowRule, windows_by_rule
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


@pytest.mark.parametrize("method", METHODS)
def test_windows_of_any_length_follow_one_another(method, make_scene, make_flight) -> None:
    """Those of 250 us, and those that end by events or by motion."""
    scene = make_scene(make_flight(du_px_per_ms=2.5), noise_hz=5, duration_us=60_000)
    for rule in (
        WindowRule(longest_us=250),
        WindowRule(longest_us=4000, events=400),
        WindowRule(longest_us=4000, motion_px=2.0),
    ):
        detector, motion = make_detector(method, SENSOR), ImageMotion()
        ends, found = [], []
        for window in windows_by_rule(scene, 0, 60_000, rule, motion):
            found.append(detector.step(window))
            motion.add(found[-1])
            ends.append(window.end_us)
            assert found[-1] is None or abs(found[-1].t_us - window.end_us) <= 4000
        assert ends == sorted(set(ends)) and ends[-1] > 55_000
        assert rule.motion_px is None or any(found), "as with windows of the default length"


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


def test_a_traced_step_answers_the_same_and_shows_its_views(make, windows) -> None:
    plain, traced = make(), make()
    for window in windows:
        trace = explain_step(traced, window)
        assert trace.detection == plain.step(window)
        assert trace.reasons == (() if trace.detection is not None else reasons_of(plain))
        assert trace.views[0].name == "raw" and trace.views[-1].name == "result"
        assert all(len(row.figures) == len(trace.titles) for row in trace.candidates)


def test_it_says_why_there_is_no_ball_with_a_setting_that_exists_and_numbers(make, make_scene, add_frames) -> None:
    detector, known = make(), {".".join(spec.path) for spec in field_specs(DetectorConfig)}
    noise = add_frames(make_scene(noise_hz=20, duration_us=20_000).windows(), None)
    missed = 0
    for window in [*noise, Window(Events.empty(SENSOR), 20_000, 22_000)]:
        if detector.step(window) is not None:
            continue
        missed += 1
        reasons = reasons_of(detector)
        assert reasons and all(isinstance(one, Reason) and one.reason and one.text for one in reasons)
        assert all(one.setting is None or one.setting in known for one in reasons)
        assert all(number is None or math.isfinite(number) for one in reasons for number in (one.value, one.limit))
    assert missed


@pytest.mark.parametrize("method", METHODS)
def test_the_views_of_a_method_are_those_that_it_is_registered_with(method, make_scene) -> None:
    trace = explain_step(make_detector(method, SENSOR), make_scene(noise_hz=20, duration_us=2000).windows()[0])
    assert tuple(view.name for view in trace.views) == VIEWS[method]
