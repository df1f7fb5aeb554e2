"""The alarm of a moved camera: at 1 px, not at .3, soon enough, and not on and off."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.cameras import Camera, stereo_preset
from core.cameras.presets import camera_preset
from core.chain import ChainState, RallyChain
from core.chain.calibration_drift import CalibrationDrift, CalibrationDriftConfig
from core.detection.window import windows_side_by_side
from core.geometry import make_transform
from core.recordings import open_recording
from tests.core.chain.drifted_rigs import SightingNoise, epipolar_rms_px, feed_serves, turn_second

pytestmark = pytest.mark.numeric
PAIR = stereo_preset("side")


def rings(drift_px: float, seed: int) -> bool:
    rng = np.random.default_rng(seed)
    monitor = CalibrationDrift(turn_second(PAIR, drift_px, rng))
    feed_serves(monitor, PAIR, 6, rng)
    assert monitor.report.drift is not None and monitor.report.pair == ("left", "right")
    return monitor.report.alarm


@pytest.mark.gate
def test_it_rings_at_one_pixel_and_not_at_a_third() -> None:
    seeds = range(8)
    assert all(rings(1.0, seed) for seed in seeds)
    assert not any(rings(0.3, seed) for seed in seeds) and not any(rings(0.0, seed) for seed in seeds)


def test_a_camera_that_was_knocked_rings_too_though_no_ray_meets_another() -> None:
    assert rings(30.0, 0)


def test_the_turn_has_the_size_that_was_asked_for() -> None:
    points = np.random.default_rng(0).uniform((-1.3, -0.5, 0.02), (0.3, 0.5, 0.5), (300, 3))
    believed = turn_second(PAIR, 1.0, np.random.default_rng(0))
    assert 0.5 < epipolar_rms_px(PAIR, believed, points) < 2.0


def test_it_says_nothing_before_enough_points_and_rests_when_repaired() -> None:
    rng = np.random.default_rng(0)
    monitor = CalibrationDrift(turn_second(PAIR, 1.2, rng))
    t_us = feed_serves(monitor, PAIR, 1, rng)
    assert monitor.report.drift is None and not monitor.report.alarm
    assert 0 < monitor.report.points < monitor.report.needed == 200
    for _ in range(6):
        t_us = feed_serves(monitor, PAIR, 1, rng, start_us=t_us)
    assert monitor.report.alarm and monitor.report.points <= monitor.config.points
    fitting = turn_second(PAIR, 1.2, np.random.default_rng(0))  # it is put back to where it was believed to be
    for _ in range(12):
        t_us = feed_serves(monitor, fitting, 1, rng, start_us=t_us)
    assert not monitor.report.alarm


def test_between_the_two_limits_it_stays_as_it_was() -> None:
    def alarm_after(first_px: float) -> bool:
        rng = np.random.default_rng(3)
        monitor = CalibrationDrift(PAIR, CalibrationDriftConfig(alarm_px=0.8, over_px=0.2))
        moved = turn_second(PAIR, first_px, np.random.default_rng(3))
        t_us = feed_serves(monitor, moved, 8, rng)
        feed_serves(monitor, turn_second(PAIR, 0.5, np.random.default_rng(3)), 10, rng, start_us=t_us)
        return monitor.report.alarm

    assert alarm_after(1.5) and not alarm_after(0.0)


def test_of_three_cameras_the_pair_that_fits_worst_is_named() -> None:
    rng = np.random.default_rng(0)
    third = stereo_preset("ceiling")["left"]
    true = {"left": PAIR["left"], "top": third, "right": PAIR["right"]}
    believed = {**true, "right": turn_second(PAIR, 3.0, rng)["right"]}
    monitor = CalibrationDrift(believed)
    feed_serves(monitor, true, 6, rng)
    assert monitor.report.alarm and monitor.report.pair is not None and "right" in monitor.report.pair
    assert monitor.report.camera == "right"


@pytest.mark.parametrize("name", ["near_left", "far_right"])
def test_one_camera_of_four_that_is_half_a_pixel_off_is_named_and_a_third_of_a_pixel_is_no_alarm(name: str) -> None:
    true, noise = camera_preset("corners"), SightingNoise(sigma_px=0.2, flight_px=0.05)
    reports = {}
    for off_px in (0.5, 0.3):
        rng = np.random.default_rng(4)
        T, axis = true[name].T_world_camera, rng.normal(size=2)
        turn = Rotation.from_rotvec([*(off_px / 1000.0 * axis / np.linalg.norm(axis)), 0.0]).as_matrix()
        believed = {**true, name: replace(true[name], T_world_camera=make_transform(T[:3, :3] @ turn, T[:3, 3]))}
        monitor = CalibrationDrift(believed)
        feed_serves(monitor, true, 6, rng, noise)
        reports[off_px] = monitor.report
    assert reports[0.5].alarm and reports[0.5].camera == name
    assert not reports[0.3].alarm
    assert reports[0.5].distrusted == (name, pytest.approx(0.5, abs=0.1))
    assert reports[0.3].distrusted == (None, 0.0)


@pytest.mark.parametrize(("name", "axis_deg"), [("near_left", 30), ("far_left", 150)])
def test_a_camera_is_named_though_one_of_its_pairs_hardly_sees_the_turn(name: str, axis_deg: float) -> None:
    """Without that pair's drift, more than one camera could have been moved by the first look at the other pairs."""
    true, noise = camera_preset("corners"), SightingNoise(sigma_px=0.2, flight_px=0.05)
    T, angle = true[name].T_world_camera, np.deg2rad(axis_deg)
    turn = Rotation.from_rotvec([0.0005 * np.cos(angle), 0.0005 * np.sin(angle), 0.0]).as_matrix()
    monitor = CalibrationDrift(
        {**true, name: replace(true[name], T_world_camera=make_transform(T[:3, :3] @ turn, T[:3, 3]))}
    )
    feed_serves(monitor, true, 6, np.random.default_rng(4), noise)
    assert monitor.report.alarm and monitor.report.camera == name


def test_no_camera_is_named_where_two_were_moved_or_none_can_be_told_apart() -> None:
    rng, true = np.random.default_rng(0), camera_preset("corners")
    moved = dict(true)
    for name in ("near_left", "far_left"):
        T = true[name].T_world_camera
        turn = Rotation.from_rotvec([0.002, 0.001, 0.0]).as_matrix()
        moved[name] = replace(true[name], T_world_camera=make_transform(T[:3, :3] @ turn, T[:3, 3]))
    monitor, pair = CalibrationDrift(moved), CalibrationDrift(turn_second(PAIR, 2.0, rng))
    feed_serves(monitor, true, 6, rng)
    feed_serves(pair, PAIR, 6, rng)
    assert monitor.report.alarm and pair.report.alarm
    assert monitor.report.camera is None and pair.report.camera is None


@pytest.fixture(scope="module")
def states(serve_recording: Path) -> Iterator[list[ChainState]]:
    with open_recording(serve_recording) as recording:
        cameras = {name: stream.calibration for name, stream in recording.cameras.items() if stream.calibration}
        chain = RallyChain(tilted(cameras))
        yield [chain.step(windows) for windows in windows_side_by_side(recording.cameras, 0, 600_000, 2000)]


def tilted(cameras: dict[str, Camera]) -> dict[str, Camera]:
    """About 1.5 px: a turn of .09 degrees of the second camera."""
    T = cameras["right"].T_world_camera
    R = T[:3, :3] @ np.array([[1, 0, 0], [0, np.cos(0.0015), -np.sin(0.0015)], [0, np.sin(0.0015), np.cos(0.0015)]])
    return {**cameras, "right": replace(cameras["right"], T_world_camera=make_transform(R, T[:3, 3]))}


def test_the_real_chain_with_a_wrong_calibration_rings_and_with_the_right_one_does_not(states) -> None:
    points_of_one_serve = CalibrationDriftConfig(points_at_least=30, judged_every=5)
    wrong, right = (CalibrationDrift(cameras, points_of_one_serve) for cameras in (tilted(PAIR), PAIR))
    for state in states:
        wrong.add(state)
        right.add(state)
    assert wrong.report.alarm and not right.report.alarm
    assert wrong.report.drift is not None and right.report.drift is not None
    assert wrong.report.drift.drift_px > 0.9 and right.report.drift.drift_px < 0.2


def test_a_reading_that_is_not_sure_rings_no_alarm_and_cameras_without_a_table_are_watched_too() -> None:
    unsure = CalibrationDriftConfig(sure_sigmas=10.0)
    rng = np.random.default_rng(1)
    monitor = CalibrationDrift(turn_second(PAIR, 0.7, rng), unsure)
    feed_serves(monitor, PAIR, 6, rng)
    assert monitor.report.drift is not None and monitor.report.drift.drift_px > unsure.alarm_px
    assert not monitor.report.alarm

    def elsewhere(camera: Camera) -> Camera:
        """In a frame whose table is not where the balls are."""
        return replace(camera, T_world_camera=make_transform(np.eye(3), (50.0, 0, 0)) @ camera.T_world_camera)

    rng = np.random.default_rng(2)
    moved = {name: elsewhere(one) for name, one in turn_second(PAIR, 1.0, rng).items()}
    monitor = CalibrationDrift(moved)
    feed_serves(monitor, PAIR, 6, rng)
    assert monitor.report.alarm and monitor.report.drift is not None and monitor.report.drift.elsewhere_px is None
