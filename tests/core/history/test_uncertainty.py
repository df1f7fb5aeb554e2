from types import SimpleNamespace

import numpy as np

from app.scene.prediction import CORNERS, RINGS, SIGMAS, ellipse, tube_faces, tube_vertices
from core.history.rally_picture import UncertaintyEllipse
from core.history.shown_prediction import spreads_of


def test_the_tube_is_as_wide_as_the_standard_deviations_across_the_path() -> None:
    path = np.linspace((1.0, 0.0, 0.3), (-1.0, 0.0, 0.3), 30)
    sigmas = np.tile((0.5, 0.03, 0.01), (30, 1))  # along the path nothing shows
    rings = tube_vertices(path, sigmas).reshape(RINGS, CORNERS, 3)
    np.testing.assert_allclose(np.abs(rings[..., 1]).max(axis=1), SIGMAS * 0.03, rtol=1e-5)
    np.testing.assert_allclose((rings[..., 2] - 0.3).max(axis=1), SIGMAS * 0.01, rtol=1e-4)
    np.testing.assert_allclose(rings.mean(axis=1)[[0, -1]], path[[0, -1]], atol=1e-6)


def test_every_face_joins_two_neighbouring_rings() -> None:
    faces = tube_faces()
    assert faces.shape == (2 * (RINGS - 1) * CORNERS, 3) and faces.max() == RINGS * CORNERS - 1
    rings = faces // CORNERS
    assert (rings.max(axis=1) - rings.min(axis=1) == 1).all()


def test_an_ellipse_is_two_standard_deviations_wide_and_closed() -> None:
    spread = UncertaintyEllipse(np.array([-1.42, 0.1, 0.2]), np.array([[0.0, 0.03, 0.0], [0.0, 0.0, 0.01]]))
    lines = ellipse(spread)
    np.testing.assert_allclose(lines[:, 0, 0], -1.42, rtol=1e-6)
    np.testing.assert_allclose(np.abs(lines[:, 0, 1] - 0.1).max(), SIGMAS * 0.03, rtol=1e-5)
    np.testing.assert_allclose(np.abs(lines[:, 0, 2] - 0.2).max(), SIGMAS * 0.01, rtol=1e-5)
    np.testing.assert_array_equal(lines[:-1, 1], lines[1:, 0])
    np.testing.assert_allclose(lines[-1, 1], lines[0, 0], atol=1e-7)


def test_the_ellipse_of_a_hit_has_the_covariance_of_height_and_side() -> None:
    covariance = np.zeros((6, 6))
    covariance[1:3, 1:3] = [[4e-4, 1e-4], [1e-4, 2e-4]]
    hit = SimpleNamespace(p_world_m=np.array([-1.42, 0.0, 0.2]), covariance=covariance)
    bounce = SimpleNamespace(p_world_m=np.array([-0.8, 0.0, 0.02]), sigma_m=np.array([0.02, 0.01, 0.0]))
    level, upright = spreads_of(SimpleNamespace(bounces=(bounce,), hit_plane=hit))
    np.testing.assert_allclose(upright.axes.T @ upright.axes, covariance[:3, :3], atol=1e-12)
    np.testing.assert_allclose(level.axes.T @ level.axes, np.diag([4e-4, 1e-4, 0.0]), atol=1e-12)
    assert spreads_of(SimpleNamespace(bounces=(), hit_plane=None)) == ()
