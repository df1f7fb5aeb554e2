"""The outline of a ball against the sphere itself."""

import numpy as np
import pytest

from core.cameras import Camera, ball_circles, ball_outline, stereo_preset
from core.events import SensorSize
from core.table import BALL_RADIUS_M

pytestmark = pytest.mark.numeric
PINHOLE = Camera(SensorSize(1280, 720), np.array([[1000.0, 0, 0], [0, 1000.0, 0], [0, 0, 1]]), np.zeros(5), np.eye(4))


def sphere_hull_area(camera: Camera, p_world: np.ndarray) -> tuple[np.ndarray, float]:
    """Centroid and area of the picture of a sphere, from counting points of a fine grid whose rays hit it."""
    circle = ball_circles(camera, p_world)
    u, v, r = circle.u_px[0], circle.v_px[0], circle.r_px[0]
    step = r / 150
    grid = np.arange(-1.4 * r, 1.4 * r, step)
    uvs = np.stack(np.meshgrid(u + grid, v + grid), axis=-1).reshape(-1, 2)
    rays = camera.unproject(uvs)
    to_ball = p_world - camera.position_world_m
    gap = np.linalg.norm(np.cross(rays, to_ball), axis=1)
    hit = uvs[gap <= BALL_RADIUS_M]
    return hit.mean(axis=0), len(hit) * step**2


@pytest.mark.parametrize("p", [(-1.42, 0.3, 0.3), (-0.8, 0.0, 0.02), (0.9, -0.4, 0.4), (-1.0, 1.0, 0.5)])
def test_centre_and_radius_are_those_of_the_area_that_the_sphere_covers(p: tuple[float, float, float]) -> None:
    for camera in stereo_preset().values():
        centroid, area = sphere_hull_area(camera, np.array(p))
        circle = ball_circles(camera, [p])
        assert (circle.u_px[0], circle.v_px[0]) == pytest.approx(centroid, abs=0.01)
        assert circle.r_px[0] == pytest.approx(np.sqrt(area / np.pi), rel=5e-4)  # counted points


def test_without_distortion_they_are_the_ellipses_closed_form() -> None:
    x, y, z = 0.7, -0.3, 1.2
    circle = ball_circles(PINHOLE, [(x, y, z)])
    scale = z * z - BALL_RADIUS_M**2
    long = BALL_RADIUS_M * np.sqrt(x * x + y * y + scale) / scale
    short = BALL_RADIUS_M / np.sqrt(scale)
    assert circle.u_px[0] == pytest.approx(1000 * x * z / scale, abs=1e-6)
    assert circle.v_px[0] == pytest.approx(1000 * y * z / scale, abs=1e-6)
    assert circle.r_px[0] == pytest.approx(1000 * np.sqrt(long * short), abs=1e-6)


def test_the_centre_is_not_the_projected_centre_of_the_ball() -> None:
    at = np.array([[1.5 * np.tan(np.radians(30)), 0.0, 1.5]])
    offset = ball_circles(PINHOLE, at).u_px[0] - PINHOLE.project(at)[0, 0]
    assert offset == pytest.approx(1000 * np.tan(np.radians(30)) * BALL_RADIUS_M**2 / 1.5**2, rel=1e-3)
    on_axis = ball_circles(PINHOLE, [(0.0, 0.0, 1.5)])
    assert (on_axis.u_px[0], on_axis.v_px[0]) == pytest.approx((0, 0), abs=1e-9)


def test_every_point_of_the_outline_touches_the_ball() -> None:
    camera, p = stereo_preset()["left"], np.array([-1.2, 0.2, 0.3])
    rays = camera.unproject(ball_outline(camera, p, points=12)[0])
    gap = np.linalg.norm(np.cross(rays, p - camera.position_world_m), axis=1)
    assert gap == pytest.approx(np.full(12, BALL_RADIUS_M), abs=1e-9)


def test_a_ball_behind_the_camera_or_round_it_has_no_outline() -> None:
    circles = ball_circles(PINHOLE, [(0, 0, -1.0), (0, 0, 0.01), (0, 0, 1.0), (np.nan, 0, 1)])
    assert np.isfinite(circles.r_px).tolist() == [False, False, True, False]
