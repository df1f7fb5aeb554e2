import numpy as np

from app.scene.uncertainty import CORNERS, RINGS, SIGMAS, tube_faces, tube_vertices


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
