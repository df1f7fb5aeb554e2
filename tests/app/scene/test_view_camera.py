"""Small things stay visible: known sizes, and the projection of a pinhole as the judge."""

import math

import numpy as np
import pytest

from app.scene.view_camera import (
    FLOOR_MIDDLE,
    LIFT_M,
    MIN_SHARE,
    NEAREST_M,
    ViewCamera,
    drawn_radius_m,
    lift_before_floor_m,
    sprite_pose,
)
from core.cameras import Camera
from core.events import SensorSize
from core.geometry import look_at, quaternion_from_matrix
from core.table import BALL_RADIUS_M

FOV_RAD = math.radians(40)
HEIGHT_PX = 720


def eye_at(position: tuple[float, float, float], target: tuple[float, float, float] = (0, 0, 0)) -> ViewCamera:
    T = look_at(position, target)
    return ViewCamera(np.array(position), quaternion_from_matrix(T[:3, :3]), FOV_RAD)


def camera_at(position: tuple[float, float, float]) -> Camera:
    f = HEIGHT_PX / 2 / math.tan(FOV_RAD / 2)
    K = np.array([[f, 0, 639.5], [0, f, 359.5], [0, 0, 1]])
    return Camera(SensorSize(1280, HEIGHT_PX), K, np.zeros(5), look_at(position, (0, 0, 0)))


def test_depth_is_along_the_line_of_sight() -> None:
    eye = eye_at((-3.0, -4.0, 0.0))
    assert eye.depth_m(np.zeros(3)) == pytest.approx(5.0)
    assert eye.depth_m(np.array([0.0, 0.0, 2.0])) == pytest.approx(5.0)
    assert eye.depth_m(np.array([-6.0, -8.0, 0.0])) == NEAREST_M, "behind the eye"


@pytest.mark.parametrize("distance_m", [6.0, 12.0, 40.0])
def test_a_far_ball_is_always_as_many_pixels(distance_m) -> None:
    eye = eye_at((0.0, -distance_m, 0.0))
    radius_px = drawn_radius_m(eye, np.zeros(3), BALL_RADIUS_M) * HEIGHT_PX / 2 / math.tan(FOV_RAD / 2) / distance_m
    assert radius_px == pytest.approx(MIN_SHARE * HEIGHT_PX) and radius_px > 5


def test_a_near_ball_has_its_own_size() -> None:
    assert drawn_radius_m(eye_at((0.0, -1.0, 0.0)), np.zeros(3), BALL_RADIUS_M) == BALL_RADIUS_M


@pytest.mark.parametrize("position", [(-4.4, -3.4, 2.7), (0.1, 0.1, 6.0), (2.0, 0.5, 0.1)])
def test_a_sprite_covers_in_the_picture_exactly_what_it_marks(position) -> None:
    ball, radius_m, camera = np.array([-0.8, 0.2, 0.02]), 0.05, camera_at(position)
    pose = sprite_pose(eye_at(position), ball, radius_m)
    np.testing.assert_allclose(camera.project(pose.p_world_m[None]), camera.project(ball[None]), atol=1e-6)
    assert np.linalg.norm(pose.p_world_m - ball) == pytest.approx(LIFT_M)
    away = [np.linalg.norm(p - np.array(position)) for p in (pose.p_world_m, ball)]
    assert pose.scale / away[0] == pytest.approx(radius_m / away[1])


def test_a_sprite_never_passes_the_eye() -> None:
    pose = sprite_pose(eye_at((0.0, -0.2, 0.0)), np.zeros(3), 0.02)
    assert pose.p_world_m[1] == pytest.approx(-0.1) and pose.scale == pytest.approx(0.01)


def test_an_eye_that_turned_is_another_one() -> None:
    eye = eye_at((1.0, 2.0, 3.0))
    assert eye.same_as(eye_at((1.0, 2.0, 3.0))) and not eye.same_as(eye_at((1.0, 2.0, 3.01)))
    assert not eye.same_as(None) and not eye.same_as(eye_at((1.0, 2.0, 3.0), (0.1, 0, 0)))


@pytest.mark.parametrize("x_m", [-1.2, 0.5, 1.1, 1.9, 3.0])
def test_a_sprite_is_drawn_after_the_floor_wherever_it_is(x_m) -> None:
    eye, ball = eye_at((-3.6, -2.8, 2.2)), np.array([x_m, -0.2, 0.4])
    pose = sprite_pose(eye, ball, 0.05, lift_before_floor_m(eye, ball))
    assert eye.depth_m(pose.p_world_m) < eye.depth_m(FLOOR_MIDDLE)
    lift_m = float(np.linalg.norm(pose.p_world_m - ball))
    assert lift_m == pytest.approx(LIFT_M) if x_m < 1 else lift_m >= LIFT_M
