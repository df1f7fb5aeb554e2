"""The racket in the cameras: the cylinder's outline, what hides what, and events where its outline moves only."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.stats import ks_2samp

from core.cameras import Camera
from core.events import Events, concatenate_events
from core.simulation import SceneConfig, SensorConfig, pixel_truth
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights import BallPath, ParabolicPath
from core.simulation.scenes.background import DEPTH_M, LIGHT, LOG_LIGHT, make_background
from core.simulation.scenes.ball_view import ball_shading_rows
from core.simulation.scenes.block_view import view_numbers
from core.simulation.scenes.racket_view import (
    RacketPath,
    RacketPoses,
    racket_gap,
    racket_outline,
    racket_shading_rows,
)
from core.simulation.scenes.shading import UNTOUCHED, Moving, pixel_light, pixel_seen
from tests.dense_picture import render_light

pytestmark = pytest.mark.numeric
QUIET = SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0, threshold_mismatch=0.0)
SCENE = SceneConfig()
TILTED = np.array([0.9, -0.2, 0.3]) / np.linalg.norm([0.9, -0.2, 0.3])


@dataclass
class Sliding:
    """A small racket that moves along x."""

    speed_mps: float = 0.0
    start_m: tuple[float, float, float] = (-0.02, 0.06, 0.2)
    radius_m: float = 0.04
    thickness_m: float = 0.03

    def at(self, t_s: ArrayLike) -> RacketPoses:
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        p = np.array(self.start_m) + np.outer(t, [self.speed_mps, 0.0, 0.0])
        return RacketPoses(p, np.tile(TILTED, (len(t), 1)))


@pytest.fixture(scope="module")
def gone() -> ParabolicPath:
    """No ball after the first microsecond, and that far away."""
    return ParabolicPath(
        np.array([-1.0]), np.array([[0.0, 50.0, 0.1]]), np.array([[0.0, 1.0, 0.0]]), np.zeros((1, 3)), -0.5
    )


def simulate(camera: Camera, path: BallPath, racket: RacketPath, end_us: int, chunk_us: int = BLOCK_US) -> Events:
    rig = EventCamera(camera, SCENE, QUIET, np.random.default_rng(1))
    parts = [rig.advance(path, end, racket) for end in range(chunk_us, end_us + 1, chunk_us)]
    return concatenate_events(parts, camera.sensor)


def row_of(camera: Camera, racket: RacketPath, t_s: float = 0.0) -> tuple[float, ...]:
    return tuple(racket_shading_rows(camera, SCENE.racket, SCENE.edge_px, racket, racket.at(t_s))[0].tolist())


def ray(camera: Camera, p_world: np.ndarray) -> tuple[float, float]:
    x, y, z = camera.to_camera(p_world[None])[0]
    return x / z, y / z


def test_the_gap_of_a_ray_is_zero_on_the_outline_and_has_its_sign_on_both_sides(small_camera) -> None:
    racket, row = Sliding(), row_of(small_camera, Sliding())
    middle = racket.at(0.0).p_world_m[0] - 0.5 * racket.thickness_m * TILTED
    side = np.cross(TILTED, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    other = np.cross(TILTED, side)
    # Distances from the camera's ray to a convex body: sampled points of the surface give the least gap.
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        rim = np.cos(angle) * side + np.sin(angle) * other
        for end in (0.5, -0.5):
            p = middle + end * racket.thickness_m * TILTED + racket.radius_m * rim
            assert racket_gap(row, *ray(small_camera, p))[0] <= 1e-9, "a point of the body is never outside"
            out = middle + 1.5 * (p - middle)
            gap, known = racket_gap(row, *ray(small_camera, out))[0], brute_gap(small_camera, racket, out)
            assert gap == pytest.approx(known, abs=1e-6) or (gap == 1.0 and known > 0.5 * row[7]), "1: far outside"


def brute_gap(camera: Camera, racket: Sliding, p_world: np.ndarray) -> float:
    """The least over a dense walk along the ray."""
    eye = camera.position_world_m
    t = np.linspace(0.9, 1.1, 200_001)[:, None]
    along = eye + t * (p_world - eye) - racket.at(0.0).p_world_m[0]
    height = along @ TILTED
    radial = np.linalg.norm(along - np.outer(height, TILTED), axis=1) - racket.radius_m
    gap = np.maximum(radial, np.maximum(height, -racket.thickness_m - height)).min()
    return max(float(gap), -0.5 * racket.thickness_m) if gap > -0.01 else float(gap)


def test_the_rough_outline_holds_the_body(small_camera) -> None:
    racket = Sliding()
    points = racket_outline(small_camera, racket, racket.at(0.0))[0]
    row = row_of(small_camera, racket)
    uvs = np.stack(np.meshgrid(np.arange(96.0), np.arange(72.0)), axis=-1).reshape(-1, 2)
    rays = small_camera.undistort(uvs)
    inside = uvs[[racket_gap(row, float(x), float(y))[0] < 0 for x, y in rays]]
    assert len(inside) > 300
    assert (inside.min(axis=0) >= points.min(axis=0) - 1).all() and (inside.max(axis=0) <= points.max(axis=0) + 1).all()
    assert (points.max(axis=0) - points.min(axis=0) < np.ptp(inside, axis=0) + 4).all()


def test_what_is_nearer_hides_what_is_behind(small_camera) -> None:
    racket = Sliding()
    row, view = row_of(small_camera, racket), view_numbers(small_camera)
    middle = racket.at(0.0).p_world_m[0] - 0.5 * racket.thickness_m * TILTED
    x, y = ray(small_camera, middle)
    seen = (x, y, 0.1, 9.0, 0.0, 0.0, np.log(0.1))
    eye = small_camera.position_world_m
    away = (middle - eye) / np.linalg.norm(middle - eye)

    def light(ball_m: np.ndarray, depth_m: float = 9.0) -> float:
        flight = ParabolicPath(np.array([-1.0]), ball_m[None], np.zeros((1, 3)), np.zeros((1, 3)), 1.0, 0.0)
        ball = tuple(ball_shading_rows(small_camera, SCENE, flight.at([0.0]), _no_portals())[0].tolist())
        return pixel_light((*seen[:3], depth_m, *seen[4:]), view, Moving(ball, row, True, False, True))

    assert light(middle + 0.2 * away) == SCENE.racket
    assert light(middle - 0.2 * away) > 0.5
    assert light(middle + 5.0 * away, depth_m=0.5) == UNTOUCHED  # behind what the pixel sees


def _no_portals():
    from core.simulation.flights import VisibleRange

    return VisibleRange(np.zeros((1, 3)), np.full(1, -np.inf))


def test_a_racket_at_rest_makes_no_events(small_camera, gone) -> None:
    assert len(simulate(small_camera, gone, Sliding(), 50_000)) == 0


def test_a_moving_racket_makes_events_near_its_outline_only(small_camera, gone) -> None:
    racket = Sliding(speed_mps=0.5)
    events = simulate(small_camera, gone, racket, 60_000)
    assert len(events) > 1000
    rays = small_camera.undistort(np.column_stack([events.x_px, events.y_px]).astype(np.float64))
    rows = racket_shading_rows(small_camera, SCENE.racket, SCENE.edge_px, racket, racket.at(events.t_us * 1e-6))
    gaps_m = np.array([racket_gap(tuple(row), float(x), float(y))[0] for row, (x, y) in zip(rows, rays, strict=True)])
    # Half an edge, and what the racket moves while a pixel answers: 14 events from a white line to black rubber.
    reach_m = 0.75 * rows[:, 7] + 0.5 * 2e-3
    assert (np.abs(gaps_m) <= reach_m).mean() > 0.99 and (np.abs(gaps_m) <= 2 * reach_m).all()
    leading = events.x_px > np.median(events.x_px)
    assert abs(events.on[leading].mean() - events.on[~leading].mean()) > 0.5


@pytest.mark.parametrize("ball_y_m", [-0.08, 0.3])
def test_few_pixels_and_few_looks_agree_with_a_dense_simulation(small_camera, ball_y_m) -> None:
    """A ball passes before the racket, and one behind it, which moves too."""
    ball = ParabolicPath(
        np.array([-0.2]), np.array([[0.9, ball_y_m, 0.2]]), np.array([[-4.0, 0, 0]]), np.zeros((1, 3)), 1.0, 0.0
    )
    racket, end_us = Sliding(speed_mps=0.8), 40_000
    counts, t_us = dense(small_camera, ball, racket, end_us)
    events = simulate(small_camera, ball, racket, end_us)
    found = np.zeros((72, 96), np.int64)
    np.add.at(found, (events.y_px, events.x_px), 1)
    assert len(events) == pytest.approx(counts.sum(), rel=0.1)
    assert ks_2samp(events.t_us, t_us).statistic < 0.05
    assert np.abs(found - counts).sum() < 0.12 * counts.sum(), "pixel by pixel"


def dense(camera: Camera, ball: BallPath, racket: RacketPath, end_us: int) -> tuple[np.ndarray, np.ndarray]:
    """Events per pixel and their times from every pixel every 20 us, without the refractory time's details."""
    step_us, maps, view = 20, make_background(camera, SCENE), view_numbers(camera)
    times_us = np.arange(0, end_us + 1, step_us, dtype=np.float64)
    balls = ball_shading_rows(camera, SCENE, ball.at(times_us * 1e-6), ball.visible_range(times_us * 1e-6))
    rackets = racket_shading_rows(camera, SCENE.racket, SCENE.edge_px, racket, racket.at(times_us * 1e-6))
    light = np.empty(len(maps))
    render_light(maps, view, Moving(tuple(balls[0]), tuple(rackets[0]), True, True, True), light)
    receptor, reference, free_us = light.copy(), light.copy(), np.zeros(len(maps))
    counts, times = np.zeros(len(maps), np.int64), []
    for now_us, row, other in zip(times_us[1:], balls[1:], rackets[1:], strict=True):
        render_light(maps, view, Moving(tuple(row), tuple(other), True, True, True), light)
        receptor += (light - receptor) * (1 - np.exp(-step_us / QUIET.photoreceptor_us))
        just_free = (free_us > now_us - step_us) & (free_us <= now_us)
        reference[just_free] = receptor[just_free]
        free = free_us <= now_us
        for sign, threshold in ((1.0, QUIET.on_threshold), (-1.0, QUIET.off_threshold)):
            fired = free & (sign * (receptor - reference) >= threshold)
            counts += fired
            times += [now_us] * int(fired.sum())
            free_us[fired] = now_us + QUIET.refractory_us
    return counts.reshape(72, 96), np.array(times)


def test_the_time_may_be_cut_anyhow(small_camera, crossing) -> None:
    racket = Sliding(speed_mps=0.3)
    whole = simulate(small_camera, crossing, racket, 60_000, chunk_us=60_000)
    parts = simulate(small_camera, crossing, racket, 60_000)
    np.testing.assert_array_equal(whole.t_us, parts.t_us)
    np.testing.assert_array_equal(whole.x_px, parts.x_px)


def test_the_static_picture_has_no_racket(small_camera) -> None:
    maps = make_background(small_camera, SCENE)
    seen = pixel_seen(maps, 40 * 96 + 48)
    assert seen[LIGHT] > 2 * SCENE.racket and seen[DEPTH_M] > 1.0 and np.isfinite(seen[LOG_LIGHT])


def test_a_ball_behind_the_racket_is_not_visible_and_one_before_it_is(small_camera) -> None:
    racket = Sliding()
    middle = racket.at(0.0).p_world_m[0] - 0.5 * racket.thickness_m * TILTED
    away = middle - small_camera.position_world_m
    away /= np.linalg.norm(away)
    across = np.cross(away, [0.0, 0.0, 1.0])
    for p, seen in (
        (middle + 0.2 * away, False),
        (middle - 0.2 * away, True),
        (middle + 0.2 * away + 0.12 * across, True),
    ):
        v = np.array([0.0, 1.0, 0.0])
        ball = ParabolicPath(np.array([-1.0]), (p - v)[None], v[None], np.zeros((1, 3)), 1.0, 0.0)
        assert pixel_truth(small_camera, ball, [0]).visible.all()
        assert pixel_truth(small_camera, ball, [0], None, racket).visible.tolist() == [seen]
