"""The compiled rows and boxes of the ball against the same arithmetic in plain numpy, one array at a time."""

import numpy as np
import pytest

from core.cameras import Camera, ball_outline
from core.cameras.presets import stereo_preset
from core.geometry import invert_transform
from core.simulation import SceneConfig
from core.simulation.flights import BallStates, VisibleRange
from core.simulation.scenes.ball_view import (
    STEP_PX,
    ball_and_shadow_boxes,
    ball_shading_rows,
    picture_speed,
)
from core.simulation.scenes.lens import BOX_MARGIN_PX, boxes_round, lens_of
from core.simulation.scenes.scene import LIGHT_SIZE, TO_LIGHT_WORLD
from core.simulation.scenes.shading import INNER_STRIDE
from core.table import BALL_RADIUS_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric
SCENE = SceneConfig()


@pytest.fixture(scope="module", params=["left", "right", "bent"])
def camera(request) -> Camera:
    cameras = stereo_preset()
    if request.param != "bent":
        return cameras[request.param]
    plain = cameras["left"]
    return Camera(plain.sensor, plain.K, np.array([-0.25, 0.06, 1e-3, -2e-3, 0.0]), plain.T_world_camera)


@pytest.fixture(scope="module")
def states() -> BallStates:
    """All over the room, some behind the cameras, some absent."""
    rng = np.random.default_rng(4)
    t_s = np.arange(400) * 1e-3
    p = rng.uniform((-4.0, -4.0, -0.7), (4.0, 4.0, 2.0), (400, 3))
    p[:200] = np.linspace((1.2, 0.3, 0.3), (-1.6, -0.2, 0.1), 200)
    present = rng.random(400) < 0.9
    p[~present] = np.nan
    return BallStates(t_s, p, np.zeros((400, 3)), np.zeros((400, 3)), present)


@pytest.fixture(scope="module")
def visible_range() -> VisibleRange:
    rng = np.random.default_rng(5)
    normal = rng.standard_normal((400, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    offset = rng.uniform(-1.0, 1.0, 400)
    normal[::2], offset[::2] = 0.0, -np.inf
    return VisibleRange(normal, offset)


def plain_rows(camera: Camera, states: BallStates, visible_range: VisibleRange) -> np.ndarray:
    ps_world = np.where(states.present[:, None], states.p_world_m, camera.position_world_m)
    ps = camera.to_camera(ps_world)
    ps[~states.present] = (0.0, 0.0, -1e3)
    R_camera_world = invert_transform(camera.T_world_camera)[:3, :3]
    distance2 = np.einsum("ij,ij->i", ps, ps)
    obliquity = distance2 / np.maximum(ps[:, 2], 1e-3) ** 2
    px_per_m = np.sqrt(camera.K[0, 0] * camera.K[1, 1]) * obliquity**0.75 / np.sqrt(distance2)
    edge = SCENE.edge_px / px_per_m
    whole = np.einsum("ij,ij->i", visible_range.normal_world, ps_world) - visible_range.offset_m > 2 * BALL_RADIUS_M
    inner = BALL_RADIUS_M - (0.5 + INNER_STRIDE * STEP_PX / SCENE.edge_px) * edge
    columns = [
        ps,
        distance2 - BALL_RADIUS_M**2,
        edge,
        visible_range.normal_world @ R_camera_world.T,
        visible_range.offset_m - visible_range.normal_world @ camera.position_world_m,
        ps_world,
        np.where(states.present, SCENE.shadow, 0.0),
        np.full(len(ps), SCENE.ball),
        np.full(len(ps), SCENE.ambient),
        distance2 - (BALL_RADIUS_M + 0.5 * edge) ** 2,
        np.where(whole & (inner > 0), distance2 - np.maximum(inner, 0.0) ** 2, np.inf),
    ]
    return np.column_stack(columns)


def plain_boxes(camera: Camera, outline: np.ndarray) -> np.ndarray:
    low, high = outline.min(axis=1), outline.max(axis=1)
    widen = 0.05 * (high - low).max(axis=1, keepdims=True) + 0.5 * SCENE.edge_px + BOX_MARGIN_PX
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    seen = np.isfinite(outline).all(axis=(1, 2)) & (high + widen > 0).all(axis=1) & (low - widen < size).all(axis=1)
    boxes = np.zeros((len(outline), 4), np.int64)
    boxes[seen, :2] = np.clip(np.floor(low - widen)[seen], 0, size)
    boxes[seen, 2:] = np.clip(np.ceil(high + widen)[seen] + 1, 0, size)
    boxes[(boxes[:, 2] <= boxes[:, 0]) | (boxes[:, 3] <= boxes[:, 1])] = 0
    return boxes


def plain_shadow_outline(camera: Camera, p: np.ndarray) -> np.ndarray:
    slope = TO_LIGHT_WORLD[:2] / TO_LIGHT_WORLD[2]
    on_table = p[:, :2] - slope * p[:, 2:]
    hits_table = (np.abs(on_table) < np.array([TABLE_LENGTH_M, TABLE_WIDTH_M]) / 2).all(axis=1) & (p[:, 2] > 0)
    height = p[:, 2] + np.where(hits_table, 0.0, TABLE_HEIGHT_M)
    middle = np.column_stack([p[:, :2] - slope * height[:, None], p[:, 2] - height])
    reach = (BALL_RADIUS_M + 0.5 * LIGHT_SIZE * height) / TO_LIGHT_WORLD[2]
    angle = np.arange(8) * (np.pi / 4)
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
    points = middle[:, None] + reach[:, None, None] * around
    return camera.project(points.reshape(-1, 3)).reshape(len(p), 8, 2)


def test_the_rows_that_shade_the_ball(camera, states, visible_range) -> None:
    rows = ball_shading_rows(camera, SCENE, states, visible_range)
    np.testing.assert_allclose(rows, plain_rows(camera, states, visible_range), rtol=1e-9, atol=1e-12)


def test_the_boxes_of_ball_and_shadow(camera, states) -> None:
    boxes = np.full((400, 3, 4), 7)
    ball_and_shadow_boxes(camera, SCENE, states, boxes)
    with np.errstate(invalid="ignore"):
        expected = plain_boxes(camera, ball_outline(camera, states.p_world_m, points=8))
        shadow = plain_boxes(camera, plain_shadow_outline(camera, states.p_world_m))
    np.testing.assert_array_equal(boxes[:, 0], expected)
    np.testing.assert_array_equal(boxes[:, 1], shadow)
    assert expected.any(axis=1).sum() > 50 and shadow.any(axis=1).sum() > 50 and (boxes[:, 2] == 7).all()


def test_a_box_round_nothing_is_empty(camera) -> None:
    outlines = np.array([[[np.nan, 3.0]] * 8, [[-900.0, 3.0]] * 8, [[9.0, 9.0]] * 8])
    boxes = np.full((3, 4), 7)
    boxes_round(outlines, 0.8, lens_of(camera).size_px, boxes)
    assert not boxes[:2].any() and boxes[2].tolist() == [6, 6, 13, 13]


def test_the_speed_in_the_picture(camera, states) -> None:
    uvs = camera.project(states.p_world_m)
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    near = np.all(np.abs(uvs - size / 2) < size, axis=1)
    moved = np.linalg.norm(np.diff(uvs, axis=0), axis=1) / np.diff(states.t_s * 1e6)
    assert picture_speed(camera, states) == pytest.approx(moved[near[1:] & near[:-1]].max(), rel=1e-9)
