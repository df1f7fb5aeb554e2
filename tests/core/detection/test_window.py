import numpy as np
import pytest

from core.detection import Detection
from core.detection.window import SHORTEST_US, ImageMotion, WindowRule, windows_between, windows_by_rule
from core.errors import ConfigError
from core.events import Events, SensorSize

END_US = 20_000


def test_windows_follow_one_another_and_none_is_partial(make_scene) -> None:
    scene = make_scene(duration_us=10_500, noise_hz=50.0)
    windows = list(windows_between(scene, 0, 10_500, 2000))
    assert [(w.start_us, w.end_us) for w in windows] == [(s, s + 2000) for s in range(0, 10_000, 2000)]
    assert sum(len(w.events) for w in windows) == len(scene.events.between(0, 10_000)) > 0


def test_a_stretch_shorter_than_a_window_has_none(make_scene) -> None:
    assert list(windows_between(make_scene(), 0, 1999, 2000)) == []


class Every:
    """An event every so many microseconds."""

    def __init__(self, step_us: int) -> None:
        t_us = np.arange(0, END_US, step_us)
        pixels = np.zeros(len(t_us), np.uint16)
        self.events = Events.from_columns(t_us, pixels, pixels, pixels == 0, SensorSize(4, 4))

    def slice(self, start_us: int, end_us: int) -> Events:
        return self.events.between(start_us, end_us)


def windows_of(source, rule: WindowRule, motion: ImageMotion | None = None) -> list[tuple[int, int]]:
    cut = windows_by_rule(source, 0, END_US, rule, motion or ImageMotion())
    return [(window.start_us, window.end_us) for window in cut]


def test_a_rule_of_time_alone_cuts_equal_windows(make_scene) -> None:
    scene = make_scene(duration_us=END_US, noise_hz=50.0)
    equal = [(one.start_us, one.end_us) for one in windows_between(scene, 0, END_US, 1500)]
    assert windows_of(scene, WindowRule(longest_us=1500)) == equal


def test_a_window_by_events_has_so_many_unless_it_would_be_too_long_or_too_short() -> None:
    rule = WindowRule(longest_us=4000, events=100)
    for source, length_us in ((Every(10), 1000), (Every(100), 4000), (Every(1), SHORTEST_US)):
        cut = windows_of(source, rule)
        equal = [(start, start + length_us) for start in range(0, END_US, length_us)]
        assert cut == equal[: len(cut)] and len(cut) >= len(equal) - 1, "the last one may end without the next event"
    windows = list(windows_by_rule(Every(10), 0, END_US, rule, ImageMotion()))
    assert {len(window.events) for window in windows} == {100}


def test_a_window_by_motion_is_as_long_as_the_ball_takes_for_so_many_pixels() -> None:
    motion = ImageMotion()
    cut = windows_by_rule(Every(10), 0, END_US, WindowRule(longest_us=2000, motion_px=1.5), motion)
    lengths = []
    for number, window in enumerate(cut):
        lengths.append(window.end_us - window.start_us)
        motion.add(Detection(window.end_us, 3e-3 * window.end_us, 0.0, 5.0) if number < 12 else None)
    assert lengths[:2] == [2000, 2000], "one answer tells no velocity"
    assert set(lengths[2:]) == {500}, "3 px/ms; a window without an answer keeps the last velocity for a while"


def test_a_fast_ball_does_not_make_windows_shorter_than_the_shortest_nor_a_slow_one_longer() -> None:
    for speed_px_per_ms, length_us in ((100.0, SHORTEST_US), (1e-3, 2000), (0.0, 2000)):
        motion = ImageMotion()
        motion.add(Detection(-1000, 0.0, 0.0, 5.0))
        motion.add(Detection(0, speed_px_per_ms, 0.0, 5.0))
        assert windows_of(Every(10), WindowRule(longest_us=2000, motion_px=1.0), motion)[0] == (0, length_us)


def test_an_old_answer_tells_no_velocity() -> None:
    motion = ImageMotion()
    motion.add(Detection(0, 0.0, 0.0, 5.0))
    motion.add(Detection(1000, 2.0, 0.0, 5.0))
    assert motion.speed_px_per_ms(2000) == pytest.approx(2.0) and motion.speed_px_per_ms(30_000) is None


def test_a_window_of_no_length_is_refused() -> None:
    with pytest.raises(ConfigError, match="events"):
        WindowRule(longest_us=1000, events=0)
