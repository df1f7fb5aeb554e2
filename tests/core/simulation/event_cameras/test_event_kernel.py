"""Rows of pixels against one pixel at a time."""

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.jit import njit
from core.simulation.event_cameras.event_kernel import DEEP, GOAL, ROW, ROW_NUMBERS, light_row, read_row
from core.simulation.flights import BallStates, VisibleRange
from core.simulation.scenes.background import LOG_LIGHT, NET_COVER, make_background
from core.simulation.scenes.ball_view import ball_and_shadow_boxes, ball_shading_rows
from core.simulation.scenes.block_view import BALL, RACKET, SHADOW, view_numbers
from core.simulation.scenes.racket_view import RACKET_COLUMNS, RacketPoses, racket_shading_rows
from core.simulation.scenes.scene import SceneConfig
from core.simulation.scenes.shading import BALL_COLUMNS, UNTOUCHED, Moving, deep_inside, pixel_light, pixel_seen

pytestmark = pytest.mark.numeric
SCENE = SceneConfig()
CAMERA = stereo_preset()["left"]
NOBODY = np.empty((0, 8))
NO_RACKET = (0.0,) * RACKET_COLUMNS


@njit
def one_by_one(maps, view, moving, light, deep):
    """Compiled, so that rays have the precision that they have in the kernel."""
    for pixel in range(len(light)):
        seen = pixel_seen(maps, pixel)
        light[pixel], deep[pixel] = pixel_light(seen, view, moving), deep_inside(seen, moving.ball)


@pytest.fixture(scope="module")
def maps() -> np.ndarray:
    return make_background(CAMERA, SCENE)


@pytest.mark.parametrize(("part", "both"), [(BALL, False), (SHADOW, False), (BALL, True), (SHADOW, True)])
def test_a_row_sees_what_its_pixels_see(maps, part: int, both: bool) -> None:
    rng = np.random.default_rng(1)
    ps = np.column_stack(
        [rng.uniform(-1.2, 1.2, 12), rng.uniform(-0.6, 0.6, 12), rng.uniform(0.02, 0.1 if both else 0.8, 12)]
    )
    there = np.ones(12, np.bool_)
    states = BallStates(np.zeros(12), ps, np.zeros((12, 3)), np.zeros((12, 3)), there)
    # Some leave the launcher's mouth: a plane through them hides a part.
    visible_range = VisibleRange(np.tile([1.0, 0.0, 0.0], (12, 1)), np.where(np.arange(12) % 3, -np.inf, ps[:, 0]))
    visible_range.offset_m[np.isinf(visible_range.offset_m)] = -1e3
    balls = ball_shading_rows(CAMERA, SCENE, states, visible_range)
    boxes = np.zeros((12, 3, 4), np.int64)
    ball_and_shadow_boxes(CAMERA, SCENE, states, boxes)
    view, row, lit, deep = view_numbers(CAMERA), np.full(ROW_NUMBERS, np.nan), 0, 0
    for ball, box in zip(balls, boxes[:, part], strict=True):
        moving = Moving(tuple(ball.tolist()), NO_RACKET, both or part == BALL, both or part == SHADOW, False)
        for y in range(box[1], box[3]):
            for x in range(box[0], box[2], ROW):
                first, wide = y * CAMERA.sensor.width_px + x, min(ROW, box[2] - x)
                free = read_row(maps, NOBODY, first, wide, row)
                assert free == (not maps[first : first + wide, NET_COVER].any())
                if not free:
                    continue
                light_row(view, moving, part, wide, row)
                pixels = maps[first : first + wide]
                light, inside = np.empty(wide), np.empty(wide, np.bool_)
                one_by_one(pixels, view, moving, light, inside)
                seen = light != UNTOUCHED
                goal = row[GOAL : GOAL + wide]
                assert goal[seen] == pytest.approx(np.log(light[seen]), rel=0, abs=1e-13)
                assert np.array_equal(goal[~seen], pixels[~seen, LOG_LIGHT])
                assert np.array_equal(row[DEEP : DEEP + wide] == 1.0, inside & (part == BALL))
                lit, deep = lit + seen.sum(), deep + inside.sum()
    assert lit > 500 and (deep > 100 or part == SHADOW)


class Racket:
    radius_m, thickness_m = 0.08, 0.1

    def at(self, t_s) -> RacketPoses:
        raise NotImplementedError


def test_a_row_sees_the_racket_that_its_pixels_see(maps) -> None:
    rng = np.random.default_rng(2)
    ps = np.column_stack([rng.uniform(-1.7, -0.2, 40), rng.uniform(-0.8, 0.8, 40), rng.uniform(0.02, 0.6, 40)])
    normals = rng.standard_normal((40, 3))
    normals[:6] = np.eye(3).repeat(2, axis=0)  # straight from the front and from the side
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rackets = racket_shading_rows(CAMERA, SCENE.racket, SCENE.edge_px, Racket(), RacketPoses(ps, normals))
    view, row, edges, whole = view_numbers(CAMERA), np.full(ROW_NUMBERS, np.nan), 0, 0
    size, reach = CAMERA.sensor, 120
    for racket, (u, v) in zip(rackets, CAMERA.project(ps), strict=True):
        moving = Moving((0.0,) * BALL_COLUMNS, tuple(racket.tolist()), False, False, True)
        for y in range(max(int(v) - reach, 0), min(int(v) + reach, size.height_px), 7):
            for x in range(max(int(u) - reach, 0), min(int(u) + reach, size.width_px) - ROW, ROW):
                first = y * size.width_px + x
                if not read_row(maps, NOBODY, first, ROW, row):
                    continue
                light_row(view, moving, RACKET, ROW, row)
                pixels = maps[first : first + ROW]
                light, inside = np.empty(ROW), np.empty(ROW, np.bool_)
                one_by_one(pixels, view, moving, light, inside)
                seen, goal = light != UNTOUCHED, row[GOAL : GOAL + ROW]
                assert goal[seen] == pytest.approx(np.log(light[seen]), rel=0, abs=1e-13)
                assert np.array_equal(goal[~seen], pixels[~seen, LOG_LIGHT]) and not row[DEEP : DEEP + ROW].any()
                covered = light == SCENE.racket
                assert (goal[covered] == np.log(SCENE.racket)).all()
                edges, whole = edges + (seen & ~covered).sum(), whole + covered.sum()
    assert edges > 500 and whole > 5000


def test_a_row_with_a_body_in_it_is_not_taken(maps) -> None:
    first = int(np.flatnonzero(maps[:-ROW, NET_COVER] == 0.0)[0])
    layers, row = np.zeros((len(maps), 8)), np.empty(ROW_NUMBERS)
    assert read_row(maps, layers, first, 5, row)
    layers[first + 4, 0] = 0.2
    assert not read_row(maps, layers, first, 5, row) and read_row(maps, layers, first, 4, row)
