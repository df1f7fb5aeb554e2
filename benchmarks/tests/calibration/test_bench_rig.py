import numpy as np
import pytest

from benchmarks.calibration.bench_rig import BallSwing, click_corners, seen_by
from core.cameras import ball_circles, stereo_preset
from core.cameras.calibration.table_corners import CORNERS

CAMERAS = stereo_preset("side")


def test_velocities_are_the_derivatives_of_positions() -> None:
    swing = BallSwing(4.0)
    t = np.linspace(0.1, 3.9, 50)
    step = 1e-5
    expected = (swing.at(t + step).p_world_m - swing.at(t - step).p_world_m) / (2 * step)
    np.testing.assert_allclose(swing.at(t).v_world_mps, expected, atol=1e-6)
    assert not swing.at([-0.1, 4.0]).present.any() and np.isnan(swing.at([4.0]).p_world_m).all()


def test_a_clock_that_is_ahead_stamps_the_same_ball_later() -> None:
    swing, camera = BallSwing(2.0), CAMERAS["left"]
    track = seen_by(camera, swing, np.random.default_rng(0), noise_px=0.0, clock_ahead_us=1700)
    circles = ball_circles(camera, swing.at((track.t_us - 1700) * 1e-6).p_world_m)
    np.testing.assert_allclose(track.uvs_px, np.column_stack([circles.u_px, circles.v_px]), atol=1e-9)


def test_noise_and_strays_are_as_asked() -> None:
    swing, camera = BallSwing(6.0), CAMERAS["left"]
    exact = seen_by(camera, swing, np.random.default_rng(0), noise_px=0.0)
    noisy = seen_by(camera, swing, np.random.default_rng(0), noise_px=0.4, stray_share=0.05)
    off = np.abs(noisy.uvs_px - exact.uvs_px)
    assert 1.4826 * np.median(off) == pytest.approx(0.4, rel=0.15)
    assert (off.max(axis=1) > 5).mean() == pytest.approx(0.05, abs=0.02)


def test_only_corners_in_the_picture_are_clicked() -> None:
    clicks = click_corners(CAMERAS, np.random.default_rng(0), 0.0)
    for name, camera in CAMERAS.items():
        assert 4 <= len(clicks[name].names) <= len(CORNERS)
        np.testing.assert_allclose(clicks[name].uvs_px, camera.project(clicks[name].ps_world_m))
        assert (clicks[name].uvs_px > 0).all()
