import numpy as np
import pytest

from benchmarks.calibration.calibration_error import perturb, seen_volume, space_errors
from core.cameras import stereo_preset

CAMERAS = stereo_preset("side")


def test_the_volume_is_what_all_cameras_see() -> None:
    ps = seen_volume(CAMERAS, 300, np.random.default_rng(0))
    assert 100 < len(ps) < 300
    for camera in CAMERAS.values():
        uvs = camera.project(ps)
        assert (uvs > -0.5).all() and (uvs < (1279.5, 719.5)).all()


@pytest.mark.parametrize("part", ["pose", "lens", "both"])
def test_a_perturbed_camera_is_off_by_exactly_what_was_asked(part) -> None:
    rng = np.random.default_rng(1)
    ps = seen_volume(CAMERAS, 200, rng)
    camera = CAMERAS["left"]
    for rms_px in (0.1, 0.5):
        moved = perturb(camera, ps, rms_px, part, rng)
        off = moved.project(ps) - camera.project(ps)
        assert np.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(rms_px, rel=1e-3)
        assert np.array_equal(moved.K, camera.K) == (part == "pose")
        assert np.array_equal(moved.T_world_camera, camera.T_world_camera) == (part == "lens")
    assert perturb(camera, ps, 0.0, part, rng) is camera


def test_errors_are_split_along_and_across_the_view() -> None:
    rng = np.random.default_rng(2)
    ps = seen_volume(CAMERAS, 200, rng)
    perfect = space_errors(CAMERAS, CAMERAS, ps, 0.0, rng)
    assert perfect.whole_m.max() < 1e-8
    noisy = space_errors(CAMERAS, CAMERAS, ps, 0.5, rng)
    twice = space_errors(CAMERAS, CAMERAS, ps, 1.0, np.random.default_rng(2))
    assert np.median(twice.whole_m) == pytest.approx(2 * np.median(noisy.whole_m), rel=0.2)
    np.testing.assert_allclose(noisy.whole_m**2, noisy.depth_m**2 + noisy.lateral_m**2)


def test_cameras_side_by_side_know_depth_worst() -> None:
    rng = np.random.default_rng(3)
    behind = stereo_preset("behind")
    errors = space_errors(behind, behind, seen_volume(behind, 300, rng), 0.4, rng)
    assert np.median(errors.depth_m) > 1.3 * np.median(errors.lateral_m)
