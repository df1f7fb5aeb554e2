"""Where the ball's rim is, and where a look at the ball looks, against every pixel of its box."""

import dataclasses

import numpy as np
import pytest

from core.cameras import Camera, stereo_preset
from core.cameras.outline import ball_outline
from core.jit import njit
from core.simulation.flights import BallStates, VisibleRange
from core.simulation.scenes.background import make_background
from core.simulation.scenes.ball_view import (
    ball_and_shadow_boxes,
    ball_rim,
    ball_rim_between,
    ball_shading_rows,
    rim_columns,
)
from core.simulation.scenes.block_view import BALL
from core.simulation.scenes.lens import lens_of
from core.simulation.scenes.scene import SceneConfig
from core.simulation.scenes.shading import deep_inside, pixel_seen
from core.table import BALL_RADIUS_M

pytestmark = pytest.mark.numeric
SCENE = SceneConfig()
PLAIN = stereo_preset()["left"]
STRONG_LENS = dataclasses.replace(PLAIN, distortion=np.array([-0.3, 0.1, 0.002, -0.001, 0.0]))
STEP_M = 0.0006


@njit
def touched(maps, ball, covered, deep):
    """Which pixels the ball may cover, and which lie deep inside."""
    for pixel in range(len(covered)):
        seen = pixel_seen(maps, pixel)
        x, y = seen[0], seen[1]
        along = x * ball[0] + y * ball[1] + ball[2]
        covered[pixel] = along > 0.0 and along * along > ball[15] * (x * x + y * y + 1.0)
        deep[pixel] = deep_inside(seen, ball)


@pytest.mark.parametrize("camera", [PLAIN, STRONG_LENS], ids=["plain", "strong lens"])
def test_the_rim_is_the_outline_of_the_cameras_also_far_beside_the_picture(camera: Camera) -> None:
    beside = np.array([(0.0, 0.0, 1.0), (0.3, -0.2, 0.8), (3.0, 0.4, 1.0), (-2.0, 1.0, 0.5), (0.1, 2.0, 0.4)])
    seen = np.concatenate([beside, [(0.0, 0.0, 0.5 * BALL_RADIUS_M), (0.2, 0.0, -1.0)]])  # round the camera, behind it
    ps = camera.position_world_m + seen @ camera.T_world_camera[:3, :3].T
    outlines, points = ball_outline(camera, ps, points=12), np.empty((12, 2))
    for p, outline in zip(ps, outlines, strict=True):
        ball_rim(lens_of(camera), *p, points)
        np.testing.assert_allclose(points, outline, rtol=1e-9, atol=1e-6)
    assert np.isfinite(outlines[: len(beside)]).all() and np.isnan(outlines[len(beside) :]).all()


@pytest.mark.parametrize("camera", [PLAIN, STRONG_LENS], ids=["plain", "strong lens"])
def test_what_is_left_out_has_not_changed(camera: Camera) -> None:
    maps, width = make_background(camera, SCENE), camera.sensor.width_px
    rng = np.random.default_rng(3)
    near = camera.position_world_m + camera.T_world_camera[:3, 2] * 0.25
    ps = np.column_stack([rng.uniform(-1.4, 1.4, 60), rng.uniform(-0.8, 0.8, 60), rng.uniform(0.02, 0.9, 60)])
    ps[:3] = near  # so large that it fills much of the picture
    after = ps + STEP_M * np.array([1.0, 0.3, -0.5])
    both = np.concatenate([ps, after])
    nothing, there = np.zeros_like(both), np.ones(len(both), np.bool_)
    states = BallStates(np.zeros(len(both)), both, nothing, nothing, there)
    balls = ball_shading_rows(camera, SCENE, states, VisibleRange(nothing, np.full(len(both), -1e3)))
    boxes = np.zeros((len(both), 3, 4), np.int64)
    ball_and_shadow_boxes(camera, SCENE, states, boxes)
    looked = skipped = met = 0
    for index in range(len(ps)):
        now = balls[len(ps) + index]
        box = tuple(boxes[[index, len(ps) + index], BALL].min(axis=0)[:2]) + tuple(
            boxes[[index, len(ps) + index], BALL].max(axis=0)[2:]
        )
        if box[2] <= box[0]:
            continue
        rim = ball_rim_between(maps, width, box, balls[index], tuple(now.tolist()), True)
        for y in range(box[1], box[3]):
            first, left, right, end = rim_columns(maps, y * width, box[0], box[2], rim)
            assert box[0] <= first <= left <= right <= end <= box[2]
            line, count = maps[y * width + box[0] : y * width + box[2]], box[2] - box[0]
            covered, before, deep, _ = (np.zeros(count, np.bool_) for _ in range(4))
            touched(line, tuple(balls[index].tolist()), before, deep)
            touched(line, tuple(now.tolist()), covered, deep)
            columns = np.arange(box[0], box[2])
            inner, outer = (left <= columns) & (columns < right), (columns < first) | (columns >= end)
            assert not (covered | before)[outer].any()
            assert deep[inner].all()
            looked, skipped = looked + count - inner.sum() - outer.sum(), skipped + inner.sum() + outer.sum()
            met += covered.sum()
    assert skipped > looked and met > 10_000
