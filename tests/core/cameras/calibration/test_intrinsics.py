import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.cameras import Camera
from core.cameras.calibration import Board, BoardView, calibrate_lens
from core.cameras.calibration.coverage import board_cover, coverage, odd_spacing
from core.errors import CalibrationError, ConfigError
from core.events import SensorSize

pytestmark = pytest.mark.numeric
BOARD = Board("dots", 6, 8, 0.03)
LENS = np.array([-0.15, 0.05, 0.0008, -0.0005, 0.0])
CAMERA = Camera(SensorSize(640, 480), np.array([[520.0, 0, 322.3], [0, 523.0, 236.1], [0, 0, 1]]), LENS, np.eye(4))


def views(count: int, noise_px: float, seed: int = 0) -> list[BoardView]:
    rng = np.random.default_rng(seed)
    made = []
    while len(made) < count:
        R = Rotation.from_euler("xyz", rng.uniform((-35, -35, -30), (35, 35, 30)), degrees=True).as_matrix()
        depth = rng.uniform(0.3, 0.7)
        middle = np.array([rng.uniform(-0.5, 0.5) * depth, rng.uniform(-0.4, 0.4) * depth, depth])
        uvs = CAMERA.project((BOARD.points_m - BOARD.points_m.mean(axis=0)) @ R.T + middle)
        if (uvs > 0).all() and (uvs < (640, 480)).all():
            made.append(BoardView(f"picture {len(made)}", uvs + rng.normal(0, noise_px, uvs.shape)))
    return made


def test_without_noise_the_lens_is_found_exactly() -> None:
    lens = calibrate_lens(views(12, 0.0), BOARD, CAMERA.sensor)
    np.testing.assert_allclose(lens.camera.K, CAMERA.K, atol=0.01)
    np.testing.assert_allclose(lens.camera.distortion, LENS, atol=2e-4)
    assert lens.rms_px < 0.001 and lens.rejected == ()


@pytest.mark.gate
def test_errors_are_as_large_as_the_standard_deviations_say() -> None:
    names = ("fx", "fy", "cx", "cy")
    true = np.array([520.0, 523.0, 322.3, 236.1])
    scores = []
    for seed in range(12):
        lens = calibrate_lens(views(15, 0.3, seed), BOARD, CAMERA.sensor)
        found = lens.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]]
        scores.append((found - true) / [lens.sigmas[name] for name in names])
        assert lens.rms_px == pytest.approx(0.3 * np.sqrt(2), rel=0.15)
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_a_picture_that_does_not_fit_is_left_out_and_named() -> None:
    given = views(12, 0.1)
    given[4] = BoardView("the bent one", given[4].uvs_px + np.random.default_rng(1).normal(0, 4.0, (48, 2)))
    lens = calibrate_lens(given, BOARD, CAMERA.sensor)
    assert lens.rejected == ("the bent one",)
    assert lens.fits[4].rms_px > 3 and max(fit.rms_px for fit in lens.fits if fit.used) < 0.3
    np.testing.assert_allclose(lens.camera.K, CAMERA.K, atol=1.0)


@pytest.mark.parametrize("count", [0, 2, 4, 5])
def test_coefficients_that_are_not_fitted_stay_zero(count: int) -> None:
    lens = calibrate_lens(views(10, 0.05), BOARD, CAMERA.sensor, coefficients=count)
    assert lens.camera.distortion[:count].all() and not lens.camera.distortion[count:].any()
    assert [lens.sigmas[name] > 0 for name in ("k1", "k2", "p1", "p2", "k3")] == [k < count for k in range(5)]


def test_a_lens_of_another_number_of_coefficients_is_refused() -> None:
    with pytest.raises(CalibrationError, match=r"one of \(0, 2, 4, 5\) coefficients, got 6"):
        calibrate_lens(views(10, 0.05), BOARD, CAMERA.sensor, coefficients=6)


def test_too_few_pictures_are_refused_with_their_number() -> None:
    with pytest.raises(CalibrationError, match="expected 6 or more, got 5;"):
        calibrate_lens(views(5, 0.1), BOARD, CAMERA.sensor)


def test_of_pictures_that_did_not_fit_it_is_said_how_many_there_are() -> None:
    given = views(6, 0.05)
    given[2] = BoardView("bent", given[2].uvs_px + np.random.default_rng(1).normal(0, 6.0, (48, 2)))
    with pytest.raises(CalibrationError, match="got 5, 1 did not fit together with the others"):
        calibrate_lens(given, BOARD, CAMERA.sensor)


def test_coverage_counts_the_cells_with_a_point() -> None:
    sensor = SensorSize(80, 60)
    assert coverage(np.array([[0.0, 0.0], [1.0, 1.0]]), sensor) == pytest.approx(1 / 48)
    every = np.stack(np.meshgrid(np.arange(80), np.arange(60)), axis=-1).reshape(-1, 2)
    assert coverage(every.astype(float), sensor) == 1.0


FISHEYE = Camera(
    SensorSize(640, 480),
    np.array([[260.0, 0, 322.3], [0, 261.0, 236.1], [0, 0, 1]]),
    np.array([0.04, -0.012, 0.003, -0.0008]),
    np.eye(4),
    "fisheye",
)


def wide_views(count: int, noise_px: float, seed: int = 0) -> list[BoardView]:
    """Views by a lens that sees 130 degrees across."""
    rng = np.random.default_rng(seed)
    made: list[BoardView] = []
    while len(made) < count:
        R = Rotation.from_euler("xyz", rng.uniform((-35, -35, -30), (35, 35, 30)), degrees=True).as_matrix()
        middle = np.array([rng.uniform(-0.35, 0.35), rng.uniform(-0.25, 0.25), rng.uniform(0.15, 0.35)])
        ps = (BOARD.points_m - BOARD.points_m.mean(axis=0)) @ R.T + middle
        uvs = FISHEYE.project(ps)
        if np.isfinite(uvs).all() and (uvs > 0).all() and (uvs < (640, 480)).all():
            made.append(BoardView(f"picture {len(made)}", uvs + rng.normal(0, noise_px, uvs.shape)))
    return made


def test_a_fisheye_lens_is_found_exactly_without_noise() -> None:
    lens = calibrate_lens(wide_views(15, 0.0), BOARD, FISHEYE.sensor, model="fisheye")
    assert lens.camera.model == "fisheye" and lens.rms_px < 1e-3 and lens.rejected == ()
    np.testing.assert_allclose(lens.camera.K, FISHEYE.K, atol=0.01)
    np.testing.assert_allclose(lens.camera.distortion, FISHEYE.distortion, atol=1e-4)


def test_errors_of_a_fisheye_lens_are_as_large_as_the_standard_deviations_say() -> None:
    true = np.array([260.0, 261.0, 322.3, 236.1, *FISHEYE.distortion])
    scores = []
    for seed in range(8):
        lens = calibrate_lens(wide_views(40, 0.1, seed), BOARD, FISHEYE.sensor, model="fisheye")
        K = lens.camera.K
        found = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *lens.camera.distortion])
        scores.append((found - true) / np.array(list(lens.sigmas.values())))
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_a_fisheye_lens_with_one_bad_picture_leaves_that_out() -> None:
    seen = wide_views(15, 0.1)
    seen[4] = BoardView("moved", seen[4].uvs_px + np.random.default_rng(0).normal(0, 6, seen[4].uvs_px.shape))
    lens = calibrate_lens(seen, BOARD, FISHEYE.sensor, model="fisheye")
    assert lens.rejected == ("moved",)
    np.testing.assert_allclose(lens.camera.K, FISHEYE.K, atol=1.0)
    cover = board_cover([fit.view for fit in lens.fits if fit.used], BOARD, lens.camera)
    assert cover.distances_m.min() > 0.1 and cover.distances_m.max() < 0.4 and odd_spacing(cover) is None


def test_a_board_in_another_unit_is_said() -> None:
    lens = calibrate_lens(views(12, 0.0), BOARD, CAMERA.sensor)
    for spacing_m, unit in ((0.003, "centimetres"), (0.0003, "metres"), (1.9, "30.2 m away")):
        board = Board("dots", 6, 8, spacing_m)
        said = odd_spacing(board_cover(views(12, 0.0), board, lens.camera))
        assert said is not None and unit in said
    with pytest.raises(ConfigError, match=r"0\.03 m are 30 mm"):
        Board("dots", 6, 8, 0.03e-3)
