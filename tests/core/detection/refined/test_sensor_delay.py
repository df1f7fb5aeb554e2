"""A sensor's delay from what it saw, against the truth of the same recording."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.detection.bench_drawn_scenes import draw_flight
from core.cameras import stereo_preset
from core.detection import RefinedDetection, make_detector
from core.detection.refined.detector import FEWEST, estimate_delay
from core.metrics.grid_score import image_velocity
from core.metrics.run import run_detector
from core.physics.config import physics_profile
from core.recordings import CameraStream, open_recording
from core.simulation import SensorConfig, StereoConfig, scene_named, simulate_recording

pytestmark = pytest.mark.numeric


def seen_by(photoreceptor_us: float, path: Path) -> tuple[list[RefinedDetection], CameraStream]:
    flight = draw_flight("ball", 40, any_sensor=False)
    sensor = SensorConfig(photoreceptor_us=photoreceptor_us, noise_hz=0.5)
    stereo = StereoConfig(scene=scene_named("ball"), sensor=sensor)
    cameras = {"left": stereo_preset("side")["left"]}
    simulate_recording(path, stereo, cameras, [flight.launch], seed=3, physics=physics_profile("real"))
    stream = open_recording(path).cameras["left"]
    found = run_detector(stream, make_detector("refined", stream.sensor), 1000).detections
    return [one for one in found if isinstance(one, RefinedDetection)], stream


def true_delay_us(balls: list[RefinedDetection], stream: CameraStream, stamped_us: int = 230) -> float:
    """By how much the estimates trail the truth along their motion, and the delay they were stamped with."""
    assert stream.truth is not None
    t_us = np.array([one.t_us for one in balls])
    v, there = image_velocity(stream.truth, t_us), stream.truth.at(t_us)
    off = np.array([[one.u_px, one.v_px] for one in balls]) - np.column_stack([there.u_px, there.v_px])
    speed2 = (v**2).sum(axis=1)
    fast = speed2 > 1.0
    return stamped_us - 1000 * float(np.nanmedian((off * v).sum(axis=1)[fast] / speed2[fast]))


@pytest.mark.parametrize("photoreceptor_us", [80.0, 600.0])
def test_the_delay_is_known_without_the_truth(photoreceptor_us: float, tmp_path: Path) -> None:
    balls, stream = seen_by(photoreceptor_us, tmp_path / "flight.h5")
    found = estimate_delay(balls)
    assert found is not None
    assert found.delay_us == pytest.approx(true_delay_us(balls, stream), abs=3 * found.sigma_us)
    assert (found.delay_us > 450) == (photoreceptor_us > 300), "fast and slow sensors are told apart"
    assert estimate_delay(balls[: FEWEST - 1]) is None
