"""The substeps of a block: how many, rows that describe ball and racket, boxes to redraw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
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
from core.simulation.scenes.racket_outline import racket_outline
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
    probes_us = np.linspace(start_us, end_us, PROBES)
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
        steps = max(steps, int(np.ceil(span_us / LONGEST_STEP_US)), int(np.ceil(speed * span_us / STEP_PX)))
    t_us = np.linspace(start_us, end_us, steps + 1)
    rows, shadow = np.zeros((steps + 1, BALL_COLUMNS)), 1
    boxes = np.zeros((steps + 1, 3, 4), np.int64)
    if ball_there:
        states = path.at(t_us * 1e-6)
        rows = ball_shading_rows(camera, scene, states, path.portals(t_us * 1e-6))
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
    if np.abs(outlines - seen).max() < RACKET_REST_PX:
        return 0
    moved = np.abs(np.diff(outlines, axis=0)).max()
    return max(1, int(np.ceil(float(moved) * (len(outlines) - 1) / RACKET_STEP_PX)))


def _between_probes(poses: RacketPoses, outlines: Array, steps: int) -> tuple[RacketPoses, Array]:
    """The racket and its outline (steps + 1, K, 2), linear between probes: in a millisecond it bends by 10 um."""
    at = np.linspace(0, PROBES - 1, steps + 1)
    low = np.minimum(at.astype(np.intp), PROBES - 2)
    share = (at - low)[:, None]
    p, n = ((1 - share) * values[low] + share * values[low + 1] for values in (poses.p_world_m, poses.normal_world))
    share = share[:, :, None]
    return RacketPoses(p, n), (1 - share) * outlines[low] + share * outlines[low + 1]
