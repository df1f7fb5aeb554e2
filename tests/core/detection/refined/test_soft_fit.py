"""Balls without a rim: a drawn glow whose truth is exact, and the planet's recording."""

import math
from pathlib import Path

import numpy as np
import pytest

from core.config import load_config, replace_setting
from core.detection import DetectorConfig, RefinedDetection, RefinedDetector, make_detector, refined_config
from core.detection.refined_config import RefinedConfig
from core.detection.window import windows_between
from core.events import Events, SensorSize
from core.recordings import open_recording
from tests.drawn_glow import DURATION_US, SENSOR, draw_glow, glow_centre

pytestmark = pytest.mark.numeric
EXAMPLES = Path(__file__).parents[4] / "docs/examples"
GLOW = RefinedConfig(edge="soft", fill_min=0.1, residual_px=1.5, history_max_us=24_000, motion_px=8.0, delay_us=0)


class Stored:
    def __init__(self, events: Events) -> None:
        self.events = events

    def slice(self, start_us: int, end_us: int) -> Events:
        return self.events.between(start_us, end_us)


@pytest.mark.parametrize("bright", [True, False], ids=["bright", "dark"])
def test_a_glow_that_turns_back_is_followed_where_a_rim_is_not_found(bright) -> None:
    windows = list(windows_between(Stored(draw_glow(bright)), 0, DURATION_US, 1000))
    soft, sharp = RefinedDetector(GLOW, SENSOR), RefinedDetector(RefinedConfig(delay_us=0), SENSOR)
    found = [one for window in windows if (one := soft.step(window)) is not None]
    errors = [math.dist((one.u_px, one.v_px), glow_centre(one.t_us)) for one in found]
    assert len(found) > 0.7 * len(windows) and np.median(errors) < 0.8 and max(errors) < 4.0
    assert np.median([one.r_px for one in found]) == pytest.approx(28.0, abs=3.0), "of the even disc as wide"
    assert all(np.linalg.eigvalsh(one.covariance).min() > 0 for one in found)
    assert sum(sharp.step(window) is not None for window in windows) < 0.2 * len(found)


def test_the_trace_of_a_soft_fit_has_its_events_and_the_same_answer() -> None:
    windows = list(windows_between(Stored(draw_glow(True)), 0, 25_000, 1000))
    one, other = RefinedDetector(GLOW, SENSOR), RefinedDetector(GLOW, SENSOR)
    steps = [(one.trace(window), other.step(window)) for window in windows]
    assert all(trace.detection == answer for trace, answer in steps)
    trace, answer = steps[-1]
    assert answer is not None
    edges = trace.fits[0].edges
    assert edges is not None and len(edges.u_px) > 100
    assert np.hypot(edges.u_px - answer.u_px, edges.v_px - answer.v_px).max() < 1.6 * answer.r_px
    assert 0.0 < edges.outlier.mean() < 0.4, "some events have the wrong polarity for their half"


def test_noise_alone_is_no_glow(make_scene) -> None:
    detector = RefinedDetector(GLOW, SensorSize(320, 240))
    assert all(detector.step(window) is None for window in make_scene(noise_hz=20, duration_us=100_000).windows(1000))


@pytest.mark.gate
def test_the_planet_is_followed_with_its_example_settings(shared_data) -> None:
    """The places are from its moons (`bench planet`)."""
    (stream,) = open_recording(shared_data / "events/planet_gen4_1280x720.dat").cameras.values()
    config = load_config(DetectorConfig, EXAMPLES / "planet.toml")
    detector = make_detector("refined", stream.sensor, config)
    found = {}
    for window in windows_between(stream, 100_000, 400_000, 1000):
        one = detector.step(window)
        if isinstance(one, RefinedDetection):
            found[window.end_us] = one
    assert len(found) > 240, "of 300 windows"
    for end_us, place in ((250_000, (480.3, 290.8)), (350_000, (478.0, 274.2)), (400_000, (480.0, 284.2))):
        assert math.dist((found[end_us].u_px, found[end_us].v_px), place) < 3.0
    plain = make_detector("refined", stream.sensor, replace_setting(refined_config(), ("refined", "delay_us"), 0))
    assert all(plain.step(window) is None for window in windows_between(stream, 100_000, 200_000, 1000))
