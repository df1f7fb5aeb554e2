"""The substeps of a block: how many, rows that describe ball and racket, boxes to redraw."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.flights.ball_path import BallPath
from core.simulation.scenes.ball_view import (
    STEP_PX,
    ball_and_shadow_boxes,
    ball_shading_rows,
    picture_speed,
    shadow_stride,
)
from core.simulation.scenes.flicker import make_flicker, updates_of_all
from core.simulation.scenes.lens import boxes_round, lens_of
from core.simulation.scenes.racket_outline import most_moved, racket_outline
from core.simulation.scenes.racket_shape import RACKET_COLUMNS, RacketPath, RacketPoses, racket_shading_rows
from core.simulation.scenes.scene import TO_LIGHT_WORLD, SceneConfig
from core.simulation.scenes.shading import BALL_COLUMNS, VIEW_NUMBERS
from core.simulation.scenes.steps import Steps

Array = NDArray[np.float64]

RACKET_STEP_PX = 0.8
"""Most motion of the racket's outline from one look at it to the next: half an edge."""
RACKET_REST_PX = 0.05
"""A racket that has moved less since the last look is at rest."""
LONGEST_STEP_US = 500.0
"""A slow ball is looked at this often."""
PROBES = 11
"""Instants in a block at which the speed in the picture is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class RacketView:
    """The racket of a block to one camera."""

    path: RacketPath
    light: float
    seen: Array | None
    """(K, 2) its outline at the last look; None before the first."""


def view_numbers(camera: Camera) -> tuple[float, ...]:
    """The VIEW_NUMBERS that describe the camera to the kernels."""
    R = camera.T_world_camera[:3, :3]
    numbers = np.concatenate([R.ravel(), camera.position_world_m, R.T @ TO_LIGHT_WORLD, TO_LIGHT_WORLD])
    assert len(numbers) == VIEW_NUMBERS
    return tuple(numbers.tolist())


def moving_steps(
    camera: Camera,
    scene: SceneConfig,
    path: BallPath,
    racket: RacketView | None,
    start_us: int,
    end_us: int,
    least: int = 0,
) -> Steps | None:
    """Substeps over [start, end] fine enough for what moves; None if nothing that moves can be seen.

    `least` are the substeps that something besides ball and racket needs.
    """
    least = max(least, updates_of_all(scene, end_us - start_us))
    probes_us = _evenly(start_us, end_us, PROBES - 1)
    states = path.at(probes_us * 1e-6)
    ball_there = bool(states.present.any())
    probes = None if racket is None else _racket_probes(camera, racket, probes_us)
    looks = 0 if racket is None or probes is None else _racket_looks(racket.seen, probes[1])
    if not looks and not ball_there and not least:
        return None
    span_us = end_us - start_us
    steps = max(looks, least, 1)
    if ball_there:
        speed = picture_speed(camera, states)
        steps = max(steps, math.ceil(span_us / LONGEST_STEP_US), math.ceil(speed * span_us / STEP_PX))
    t_us = _evenly(start_us, end_us, steps)
    rows, shadow = np.zeros((steps + 1, BALL_COLUMNS)), 1
    boxes = np.zeros((steps + 1, 3, 4), np.int64)
    if ball_there:
        states = path.at(t_us * 1e-6)
        rows = ball_shading_rows(camera, scene, states, path.visible_range(t_us * 1e-6))
        ball_and_shadow_boxes(camera, scene, states, boxes)
        shadow = shadow_stride(states, rows) if states.present.any() else 1
    rackets, outlines = np.zeros((steps + 1, RACKET_COLUMNS)), np.zeros((steps + 1, 0, 2))
    if racket is not None and probes is not None and (looks or least or boxes.any()):
        poses, outlines = _between_probes(*probes, steps)
        rackets = racket_shading_rows(camera, racket.light, scene.edge_px, racket.path, poses)
        boxes_round(outlines, 0.5 * scene.edge_px, lens_of(camera).size_px, boxes[:, 2])
    if not boxes[:, :2].any() and not (looks and boxes.any()) and not least:
        return None
    return Steps(
        t_us,
        rows,
        rackets,
        outlines,
        boxes,
        make_flicker(scene, t_us),
        np.array([1, shadow, steps // looks if looks else 0]),
    )


def _racket_probes(camera: Camera, racket: RacketView, probes_us: Array) -> tuple[RacketPoses, Array] | None:
    """The racket and its outline (PROBES, K, 2) in a block; None if it is not wholly before the camera."""
    poses = racket.path.at(probes_us * 1e-6)
    outlines = racket_outline(camera, racket.path, poses)
    return (poses, outlines) if np.isfinite(outlines).all() else None


def _racket_looks(seen: Array | None, outlines: Array) -> int:
    """How often the racket has to be looked at in a block; 0 for one that has not moved since the last look."""
    if seen is None:
        return 1
    away, moved = most_moved(outlines, seen)
    if away < RACKET_REST_PX:
        return 0
    return max(1, math.ceil(moved * (len(outlines) - 1) / RACKET_STEP_PX))


def _between_probes(poses: RacketPoses, outlines: Array, steps: int) -> tuple[RacketPoses, Array]:
    """The racket and its outline (steps + 1, K, 2), linear between probes: in a millisecond it bends by 10 um."""
    p, n, found = np.empty((steps + 1, 3)), np.empty((steps + 1, 3)), np.empty((steps + 1, *outlines.shape[1:]))
    for probed, out in ((poses.p_world_m, p), (poses.normal_world, n), (outlines, found)):
        _interpolate(probed.reshape(PROBES, -1), _evenly(0, PROBES - 1, steps), out.reshape(steps + 1, -1))
    return RacketPoses(p, n), found


@njit(error_model="numpy")
def _interpolate(probed, at, out):
    for index in range(len(out)):
        low = min(int(at[index]), len(probed) - 2)
        share = at[index] - low
        for column in range(out.shape[1]):
            out[index, column] = (1 - share) * probed[low, column] + share * probed[low + 1, column]


def _evenly(start: float, end: float, steps: int) -> Array:
    """What `np.linspace` says of `steps + 1` numbers, in a fifth of its time."""
    numbers = np.arange(steps + 1, dtype=np.float64)
    numbers *= (end - start) / steps
    numbers += start
    numbers[-1] = end
    return numbers
