"""A few tiles looked at as seldom as possible agree with every pixel every 20 us; the laws of a camera still hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from core.cameras import Camera
from core.events import Events, SensorSize, concatenate_events
from core.geometry import look_at
from core.simulation import SceneConfig, SensorConfig, scene_named
from core.simulation.bodies import MovingBodies, hidden_by_bodies, make_actors
from core.simulation.bodies.parts import blade, probe_bodies, rod
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights import BallPath
from tests.core.simulation.dense_sensor import compare_events, dense_events

pytestmark = pytest.mark.numeric
QUIET = SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0, threshold_mismatch=0.0)
SCENE = SceneConfig()


@dataclass(frozen=True)
class Sliding:
    """Parts that move along x together."""

    rows: np.ndarray
    start_m: np.ndarray
    speed_mps: float = 0.0

    @property
    def parts(self) -> np.ndarray:
        return self.rows

    def ends(self, t_s: Sequence[float] | np.ndarray) -> np.ndarray:
        t = np.asarray(t_s, np.float64)
        return self.start_m[None] + self.speed_mps * t[:, None, None, None] * np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Later:
    """The same bodies from a later moment on."""

    bodies: MovingBodies
    by_s: float

    @property
    def parts(self) -> np.ndarray:
        return self.bodies.parts

    def ends(self, t_s: np.ndarray) -> np.ndarray:
        return self.bodies.ends(np.asarray(t_s) + self.by_s)


def simulate(
    camera: Camera, path: BallPath, bodies: MovingBodies | None, end_us: int, chunk_us: int = BLOCK_US
) -> Events:
    rig = EventCamera(camera, SCENE, QUIET, np.random.default_rng(1), bodies)
    parts = [rig.advance(path, end) for end in range(chunk_us, end_us + 1, chunk_us)]
    return concatenate_events(parts, camera.sensor)


def arm(y_m: float, speed_mps: float = 0.6) -> Sliding:
    """An upright textured limb and a blade at a distance `y_m` beyond the ball's plane."""
    rows = np.array([rod(0.02, 0.03, 0.4, texture=0.5, stripes_per_m=12.0, bands=2.0), blade(0.04, 0.05)])
    limb = [[-0.06, y_m, 0.10], [-0.05, y_m, 0.32]]
    racket = [[0.03, y_m + 0.01, 0.2], [0.036, y_m + 0.018, 0.2]]
    return Sliding(rows, np.array([limb, racket]), speed_mps)


@pytest.mark.parametrize("y_m", [-0.3, 0.3])
def test_bodies_before_and_behind_the_ball_agree_with_a_dense_simulation(camera, crossing, y_m) -> None:
    bodies, end_us = arm(y_m), 40_000
    dense = dense_events(camera, SCENE, QUIET, crossing, end_us, bodies=bodies)
    events = simulate(camera, crossing, bodies, end_us)
    assert len(dense.t_us) > 2_000
    for found in compare_events(events, dense).values():
        assert found.ratio == pytest.approx(1.0, abs=0.1) and found.ks <= 0.05
    mine, theirs = np.zeros(96 * 72, np.int64), np.zeros(96 * 72, np.int64)
    np.add.at(mine, events.y_px.astype(int) * 96 + events.x_px, 1)
    np.add.at(theirs, dense.pixel, 1)
    assert np.abs(mine - theirs).sum() < 0.12 * theirs.sum(), "pixel by pixel"


@pytest.mark.parametrize("cast", ["person", "head"])
def test_a_scene_agrees_with_a_dense_simulation(gone, cast) -> None:
    K = np.array([[500.0, 0, 47.5], [0, 500.0, 35.5], [0, 0, 1]])
    target = (1.75, 0.2, 0.3) if cast == "person" else (-0.1, 0.9, 0.68)
    camera = Camera(SensorSize(96, 72), K, np.zeros(5), look_at((-2.4, 0.9, 1.3), target))
    bodies = make_actors(scene_named(cast).cast, 3)
    assert bodies is not None
    bodies = Later(bodies, 0.55 if cast == "person" else 1.2)
    dense = dense_events(camera, SCENE, QUIET, gone, 40_000, bodies=bodies)
    events = simulate(camera, gone, bodies, 40_000)
    assert len(dense.t_us) > 500
    for found in compare_events(events, dense).values():
        assert found.ratio == pytest.approx(1.0, abs=0.1) and found.ks <= 0.05


def test_the_time_may_be_cut_anyhow(camera, crossing) -> None:
    whole = simulate(camera, crossing, arm(0.2), 60_000, chunk_us=60_000)
    parts = simulate(camera, crossing, arm(0.2), 60_000)
    for column in ("t_us", "x_px", "y_px", "on"):
        assert np.array_equal(getattr(whole, column), getattr(parts, column))


def test_bodies_at_rest_make_no_events_and_one_that_was_at_rest_none_before_it_moves(camera, gone) -> None:
    class Starting(Sliding):
        def ends(self, t_s):
            return super().ends(np.maximum(np.asarray(t_s) - 0.2, 0.0))

    still = arm(0.2, speed_mps=0.0)
    assert len(simulate(camera, gone, still, 100_000)) == 0
    moving = simulate(camera, gone, Starting(still.rows, still.start_m, 0.6), 260_000)
    assert len(moving) > 300 and moving.t_us.min() > 200_000


def test_a_body_before_the_ball_hides_it_and_one_behind_does_not(camera, crossing) -> None:
    """A black screen over the whole picture: no event of the ball before it, all of them behind it."""
    rows = np.array([rod(0.5, 0.5, 0.05)])
    before = Sliding(rows, np.array([[[0.0, -0.6, 0.2], [0.0, -0.6, 0.21]]]))
    behind = Sliding(rows, np.array([[[0.0, 0.7, 0.2], [0.0, 0.7, 0.21]]]))
    assert len(simulate(camera, crossing, before, 30_000)) == 0
    assert len(simulate(camera, crossing, behind, 30_000)) > len(simulate(camera, crossing, None, 30_000))


def test_a_body_hides_what_is_behind_it(camera) -> None:
    bodies = Sliding(np.array([rod(0.05, 0.05, 0.4)]), np.array([[[0.0, 0.0, 0.1], [0.0, 0.0, 0.3]]]))
    eye = camera.position_world_m
    away = (np.array([0.0, 0.0, 0.2]) - eye) / np.linalg.norm(np.array([0.0, 0.0, 0.2]) - eye)
    points = np.array([[0.0, 0.0, 0.2] + 0.3 * away, [0.0, 0.0, 0.2] - 0.3 * away, [0.2, 0.3, 0.2]])
    assert hidden_by_bodies(bodies, eye, points, np.zeros(3)).tolist() == [True, False, False]


def test_a_part_that_reaches_behind_the_camera_is_left_out(camera) -> None:
    near = Sliding(np.array([rod(0.1, 0.1, 0.4)]), np.array([[camera.position_world_m, [0.0, 0.0, 0.2]]]))
    assert (probe_bodies(camera, near, np.zeros(1)).circles[..., 2] == -1).any()
