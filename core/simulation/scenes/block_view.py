"""The substeps of a block: how many, rows that describe ball and racket, boxes to redraw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, ball_outline
from core.geometry import invert_transform
from core.simulation.flights.ball_path import BallPath, BallStates, VisibleRange
from core.simulation.scenes.flicker import make_flicker, updates_of_all
from core.simulation.scenes.racket_outline import racket_outline
from core.simulation.scenes.racket_shape import RACKET_COLUMNS, RacketPath, RacketPoses, racket_shading_rows
from core.simulation.scenes.scene import LIGHT_SIZE, TO_LIGHT_WORLD, SceneConfig
from core.simulation.scenes.shading import BALL_COLUMNS, INNER_STRIDE, VIEW_NUMBERS
from core.simulation.scenes.steps import Steps
from core.table import BALL_RADIUS_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

STEP_PX = 0.35
"""Most motion in the picture per substep: a fifth of an edge."""
RACKET_STEP_PX = 0.8
"""Most motion of the racket's outline from one look at it to the next: half an edge."""
RACKET_REST_PX = 0.05
"""A racket that has moved less since the last look is at rest."""
LONGEST_STEP_US = 500.0
"""A slow ball is looked at this often."""
LONGEST_SHADOW_STRIDE = 8
PROBES = 11
"""Instants in a block at which the speed in the picture is looked at."""
BOX_MARGIN_PX = 1.5
"""Beyond half an edge, for the curvature of the outline between its points and for rounding."""


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
        speed = _picture_speed(camera, states)
        steps = max(steps, int(np.ceil(span_us / LONGEST_STEP_US)), int(np.ceil(speed * span_us / STEP_PX)))
    t_us = np.linspace(start_us, end_us, steps + 1)
    rows, shadow = np.zeros((steps + 1, BALL_COLUMNS)), 1
    boxes = np.zeros((steps + 1, 3, 4), np.int64)
    if ball_there:
        states = path.at(t_us * 1e-6)
        rows = ball_shading_rows(camera, scene, states, path.portals(t_us * 1e-6))
        boxes[:, 0], boxes[:, 1] = _ball_boxes(camera, scene, states), _shadow_boxes(camera, scene, states)
        shadow = _shadow_stride(states, rows) if states.present.any() else 1
    rackets, outlines = np.zeros((steps + 1, RACKET_COLUMNS)), np.zeros((steps + 1, 0, 2))
    if racket is not None and probes is not None and (looks or least or boxes.any()):
        poses, outlines = _between_probes(*probes, steps)
        rackets = racket_shading_rows(camera, racket.light, scene.edge_px, racket.path, poses)
        boxes[:, 2] = _boxes(camera, outlines, 0.5 * scene.edge_px)
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


def ball_shading_rows(camera: Camera, scene: SceneConfig, states: BallStates, portals: VisibleRange) -> Array:
    """One row of BALL_COLUMNS per state; rows of an absent ball are far behind the camera."""
    ps_world = np.where(states.present[:, None], states.p_world_m, camera.position_world_m)
    ps = camera.to_camera(ps_world)
    ps[~states.present] = (0.0, 0.0, -1e3)
    R_camera_world = invert_transform(camera.T_world_camera)[:3, :3]
    distance2 = np.einsum("ij,ij->i", ps, ps)
    obliquity = distance2 / np.maximum(ps[:, 2], 1e-3) ** 2
    rows = np.empty((len(ps), BALL_COLUMNS))
    rows[:, 0:3] = ps
    rows[:, 3] = distance2 - BALL_RADIUS_M**2
    px_per_m = np.sqrt(camera.K[0, 0] * camera.K[1, 1]) * obliquity**0.75 / np.sqrt(distance2)
    rows[:, 4] = scene.edge_px / px_per_m
    rows[:, 5:8] = portals.normal_world @ R_camera_world.T
    rows[:, 8] = portals.offset_m - portals.normal_world @ camera.position_world_m
    rows[:, 9:12] = ps_world
    rows[:, 12] = np.where(states.present, scene.shadow, 0.0)
    rows[:, 13] = scene.ball
    rows[:, 14] = scene.ambient
    rows[:, 15] = distance2 - (BALL_RADIUS_M + 0.5 * rows[:, 4]) ** 2
    # At the launcher's mouth the inner part changes fast too.
    whole = np.einsum("ij,ij->i", portals.normal_world, ps_world) - portals.offset_m > 2 * BALL_RADIUS_M
    inner = BALL_RADIUS_M - (0.5 + INNER_STRIDE * STEP_PX / scene.edge_px) * rows[:, 4]
    rows[:, 16] = np.where(whole & (inner > 0), distance2 - np.maximum(inner, 0.0) ** 2, np.inf)
    return rows


def _picture_speed(camera: Camera, states: BallStates) -> float:
    """Fastest motion of the ball between neighbouring probes, pixels per microsecond; 0 out of the picture."""
    uvs = camera.project(states.p_world_m)
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    near = np.all(np.abs(uvs - size / 2) < size, axis=1)
    moved = np.linalg.norm(np.diff(uvs, axis=0), axis=1) / np.diff(states.t_s * 1e6)
    moved = moved[near[1:] & near[:-1]]
    return float(moved.max()) if len(moved) else 0.0


def _ball_boxes(camera: Camera, scene: SceneConfig, states: BallStates) -> NDArray[np.int64]:
    return _boxes(camera, ball_outline(camera, states.p_world_m, points=8), 0.5 * scene.edge_px)


def _shadow_boxes(camera: Camera, scene: SceneConfig, states: BallStates) -> NDArray[np.int64]:
    """Round the shadow on the plane where its middle falls: the table's, or else the floor's."""
    slope = TO_LIGHT_WORLD[:2] / TO_LIGHT_WORLD[2]
    p = states.p_world_m
    with np.errstate(invalid="ignore"):
        on_table = p[:, :2] - slope * p[:, 2:]
        hits_table = (np.abs(on_table) < np.array([TABLE_LENGTH_M, TABLE_WIDTH_M]) / 2).all(axis=1) & (p[:, 2] > 0)
        height = p[:, 2] + np.where(hits_table, 0.0, TABLE_HEIGHT_M)
        middle = np.column_stack([p[:, :2] - slope * height[:, None], p[:, 2] - height])
        reach = (BALL_RADIUS_M + 0.5 * LIGHT_SIZE * height) / TO_LIGHT_WORLD[2]
    angle = np.arange(8) * (np.pi / 4)
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
    points = middle[:, None] + reach[:, None, None] * around
    outline = camera.project(points.reshape(-1, 3)).reshape(len(p), 8, 2)
    return _boxes(camera, outline, 0.5 * scene.edge_px)


def _shadow_stride(states: BallStates, rows: Array) -> int:
    """Substeps in which the shadow moves by as large a part of its own soft edge as the ball does of its sharp one."""
    with np.errstate(invalid="ignore"):
        softness = LIGHT_SIZE * states.p_world_m[:, 2] / rows[:, 4]
    return int(np.clip(softness[states.present].min(), 1, LONGEST_SHADOW_STRIDE))


def _boxes(camera: Camera, outline: Array, margin_px: float) -> NDArray[np.int64]:
    """(N, 4) boxes round N outlines of some points, a little wider; all zero off the sensor."""
    low, high = outline.min(axis=1), outline.max(axis=1)
    widen = 0.05 * (high - low).max(axis=1, keepdims=True) + margin_px + BOX_MARGIN_PX
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    seen = np.isfinite(outline).all(axis=(1, 2)) & (high + widen > 0).all(axis=1) & (low - widen < size).all(axis=1)
    boxes = np.zeros((len(outline), 4), np.int64)
    boxes[seen, :2] = np.clip(np.floor(low - widen)[seen], 0, size)
    boxes[seen, 2:] = np.clip(np.ceil(high + widen)[seen] + 1, 0, size)
    boxes[(boxes[:, 2] <= boxes[:, 0]) | (boxes[:, 3] <= boxes[:, 1])] = 0
    return boxes
