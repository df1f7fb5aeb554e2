"""The detector on events of real sensors."""

from pathlib import Path

import numpy as np
import pytest

from core.config import load_config
from core.detection import DetectorConfig, FastDetector, TrackState, auto_config, make_detector, trace_window
from core.detection.methods import DEFAULT_METHOD, method_config
from core.detection.window import windows_between
from core.metrics import run_detector
from core.recordings import open_recording

pytestmark = pytest.mark.numeric
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def dot(shared_data: Path):
    return _stream(shared_data / "events" / "rotating_dot_evt2_640x480.raw")


@pytest.fixture(scope="module")
def walker(shared_data: Path):
    return _stream(shared_data / "events" / "walker_evt3_640x480.raw")


def _stream(path: Path):
    (stream,) = open_recording(path).cameras.values()
    return stream


def test_the_example_config_finds_the_rotating_dot_on_its_circle(dot) -> None:
    config = load_config(DetectorConfig, ROOT / "docs" / "examples" / "rotating-dot.toml")
    answers = run_detector(dot, FastDetector(config), config.window.window_us)
    found = answers.detected
    assert found.sum() >= 98
    uv = np.stack([answers.u_px[found], answers.v_px[found]], axis=1)
    (u, v, c), *_ = np.linalg.lstsq(np.column_stack([2 * uv, np.ones(len(uv))]), (uv**2).sum(axis=1), rcond=None)
    off_px = np.hypot(uv[:, 0] - u, uv[:, 1] - v) - np.sqrt(c + u * u + v * v)
    assert np.sqrt((off_px**2).mean()) <= 0.5
    assert (u, v) == pytest.approx((314.3, 202.4), abs=0.5)
    angle = np.unwrap(np.arctan2(uv[:, 1] - v, uv[:, 0] - u))
    assert np.polyfit(answers.t_us[found] * 1e-6, angle, 1)[0] == pytest.approx(121.8, abs=0.3)


def test_the_default_finds_the_rotating_dot_with_its_own_settings(dot) -> None:
    config = method_config(DEFAULT_METHOD)
    answers = run_detector(dot, make_detector(DEFAULT_METHOD, dot.sensor), config.window.window_us)
    found = answers.detected
    assert found.sum() >= 35 and not found[:5].any(), "it waits until it is sure"
    off_px = np.hypot(answers.u_px[found] - 314.3, answers.v_px[found] - 202.4)
    assert off_px.std() < 0.5 and (answers.r_px[found] > 17).all() and (answers.r_px[found] < 20).all()
    angle = np.unwrap(np.arctan2(answers.v_px[found] - 202.4, answers.u_px[found] - 314.3))
    assert np.polyfit(answers.t_us[found] * 1e-6, angle, 1)[0] == pytest.approx(121.8, abs=0.5)


def test_the_example_config_confirms_the_rotating_dot_at_once(dot) -> None:
    config = load_config(DetectorConfig, ROOT / "docs" / "examples" / "rotating-dot.toml")
    answers = run_detector(dot, make_detector("refined", dot.sensor, config), 1000)
    found = answers.detected
    assert found.sum() >= 45, "of 51 windows"
    assert np.hypot(answers.u_px[found] - 314.3, answers.v_px[found] - 202.4).std() < 0.5


def test_auto_finds_out_that_the_dot_is_dark(dot) -> None:
    config = load_config(DetectorConfig, ROOT / "docs" / "examples" / "rotating-dot.toml")
    detector = FastDetector(config)
    run_detector(dot, detector, config.window.window_us)
    assert detector.state.on_leads < -10


def test_a_walking_person_is_no_ball_and_every_cluster_says_why(walker) -> None:
    config = auto_config()
    answers = run_detector(walker, FastDetector(config), config.window.window_us)
    assert not answers.detected.any() and not answers.extra_circles.any()
    candidates = [
        candidate
        for window in windows_between(walker, 400_000, 1_600_000, config.window.window_us)
        for candidate in trace_window(window, TrackState(), config).candidates
    ]
    assert len(candidates) > 10 and all(candidate.rejected for candidate in candidates)
