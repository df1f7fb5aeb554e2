"""The ball to one camera: the rows that shade it, the boxes that ball and shadow can be in, and its rim.

A pixel sees the ball where its ray lies in a cone round the ball's centre. Along a row of the picture rays lie nearly
on a straight line, so where the row enters and leaves the cone is found in closed form. That is a little rough, and
only says where to look; what a pixel sees there is computed from the body itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras import BallCircles, Camera
from core.cameras.outline import OUTLINE_POINTS, circle_round
from core.jit import njit
from core.simulation.flights import BallStates, VisibleRange
from core.simulation.scenes.background import RAY_X, RAY_Y
from core.simulation.scenes.lens import box_round, lens_of, project_from_camera, to_camera
from core.simulation.scenes.scene import LIGHT_SIZE, TO_LIGHT_WORLD, SceneConfig
from core.simulation.scenes.shading import BALL_COLUMNS, INNER_STRIDE
from core.table import BALL_RADIUS_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

MARGIN_PX = 1.5
"""Beside twice the bend of a row."""


class Cone(NamedTuple):
    """All rays that pass a point at less than some distance."""

    x: float
    y: float
    z: float
    """The point in the camera's frame."""
    tangent2: float
    """Squared length of a tangent to the sphere of that radius; infinite for no ray, 0 for all."""


class Rim(NamedTuple):
    """What may have changed between two looks at the ball."""

    before: Cone
    now: Cone
    inner: Cone
    """No ray outside of both changed; none in this has to be looked at."""


NO_RAY = Cone(0.0, 0.0, 0.0, math.inf)
NO_RIM = Rim(NO_RAY, NO_RAY, NO_RAY)


@njit(error_model="numpy")
def ball_rim_between(maps, width, box, before, now, skip_deep):
    """The rim between two rows of BALL_COLUMNS for a box of the picture: columns [box[0], box[2]), rows likewise."""
    middle, last = (box[0] + box[2]) // 2, box[2] - 1
    row = (box[1] + box[3]) // 2 * width
    each = bend = 0.0
    for axis in (RAY_X, RAY_Y):
        a, m, b = maps[row + box[0], axis], maps[row + middle, axis], maps[row + last, axis]
        share = (middle - box[0]) / max(last - box[0], 1)
        bend = max(bend, abs(m - a - share * (b - a)))
        each = max(each, abs(b - a) / max(last - box[0], 1))
    margin = MARGIN_PX * each + 2.0 * bend
    inner = NO_RAY
    if skip_deep and now[16] < math.inf:
        inner = _cone(now, now[16], -margin)
    return Rim(_cone(before, before[15], margin), _cone(now, now[15], margin), inner)


@njit(error_model="numpy")
def _cone(ball, tangent2, margin):
    """The cone of a sphere round the ball, wider by a margin per metre of camera z."""
    x, y, z = ball[0], ball[1], ball[2]
    distance2 = x * x + y * y + z * z
    reach = math.sqrt(max(distance2 - tangent2, 0.0)) + margin * z
    if z <= 0.0 or reach <= 0.0:
        return Cone(x, y, z, math.inf)
    return Cone(x, y, z, max(distance2 - reach * reach, 0.0))


@njit(error_model="numpy")
def rim_columns(maps, row, x0, x1, rim):
    """(first, left, right, end): of columns [x0, x1) only [first, left) and [right, end) may have changed.

    `row` is the number of the row's first pixel.
    """
    n = x1 - 1 - x0
    if n < 1:
        return x0, x1, x1, x1
    x, y = float(maps[row + x0, RAY_X]), float(maps[row + x0, RAY_Y])
    line = x, y, (maps[row + x1 - 1, RAY_X] - x) / n, (maps[row + x1 - 1, RAY_Y] - y) / n
    a, b = _within(rim.before, line, n)
    c, d = _within(rim.now, line, n)
    low, high = min(a, c), max(b, d)
    if low > high:
        return x0, x0, x0, x0
    first, end = x0 + max(math.floor(low), 0), x0 + min(math.ceil(high), n) + 1
    low, high = _within(rim.inner, line, n)
    if low > high:
        return first, end, end, end
    left, right = x0 + math.ceil(low), x0 + math.floor(high) + 1
    return (first, end, end, end) if right <= left else (first, max(left, first), min(right, end), end)


@njit(error_model="numpy")
def _within(cone, line, n):
    """Between which places 0 ... n of a line of rays (first x and y, and their steps) they are in a cone."""
    x, y, dx, dy = line
    if cone.tangent2 == math.inf:
        return math.inf, -math.inf
    p, q = x * cone.x + y * cone.y + cone.z, dx * cone.x + dy * cone.y
    # (p + q i)^2 > tangent2 |ray|^2, as a i^2 + 2 b i + c > 0.
    a = q * q - cone.tangent2 * (dx * dx + dy * dy)
    b = p * q - cone.tangent2 * (x * dx + y * dy)
    c = p * p - cone.tangent2 * (x * x + y * y + 1.0)
    if a >= 0.0:  # so near that its outline is no ellipse
        return 0.0, float(n)
    root2 = b * b - a * c
    if root2 < 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root2)
    low, high = (-b + root) / a, (-b - root) / a
    return (max(low, 0.0), min(high, float(n))) if low <= n and high >= 0.0 else (math.inf, -math.inf)


Array = NDArray[np.float64]

STEP_PX = 0.35
"""Most motion in the picture per substep: a fifth of an edge."""
LONGEST_SHADOW_STRIDE = 8
BOX_POINTS = 8
TO_LIGHT_X, TO_LIGHT_Y, TO_LIGHT_Z = TO_LIGHT_WORLD.tolist()
HALF_LENGTH_M, HALF_WIDTH_M = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2


def ball_shading_rows(camera: Camera, scene: SceneConfig, states: BallStates, visible_range: VisibleRange) -> Array:
    """One row of BALL_COLUMNS per state; rows of an absent ball are far behind the camera."""
    rows = np.empty((len(states.present), BALL_COLUMNS))
    look = np.array([scene.ball, scene.ambient, scene.shadow, scene.edge_px])
    normal, offset = visible_range.normal_world, visible_range.offset_m
    _shading_rows(lens_of(camera), look, states.p_world_m, states.present, normal, offset, rows)
    return rows


def ball_and_shadow_boxes(camera: Camera, scene: SceneConfig, states: BallStates, boxes: NDArray[np.int64]) -> None:
    """Write where ball and shadow can be: `boxes` (N, 2 or more, 4), see `core.simulation.scenes.block_view`.

    Args:
        camera: lens and pose.
        scene: width of the edges.
        states: N balls.
        boxes: (N, 2 or more, 4) output: the ball's, the shadow's, px.
    """
    _boxes(lens_of(camera), 0.5 * scene.edge_px, states.p_world_m, boxes)


def ball_circles_at(camera: Camera, ps_world: Array) -> BallCircles:
    """What `core.cameras.ball_circles` says, for many balls at once."""
    circles = np.empty((3, len(ps_world)))
    _circles(lens_of(camera), ps_world, circles)
    return BallCircles(*circles)


def shadow_stride(states: BallStates, rows: Array) -> int:
    """Substeps in which the shadow moves by as large a part of its own soft edge as the ball does of its sharp one."""
    with np.errstate(invalid="ignore"):
        softness = LIGHT_SIZE * states.p_world_m[:, 2] / rows[:, 4]
    return int(min(max(softness[states.present].min(), 1), LONGEST_SHADOW_STRIDE))


def picture_speed(camera: Camera, states: BallStates) -> float:
    """Fastest motion of the ball between neighbouring times, pixels per microsecond; 0 out of the picture."""
    return _speed(lens_of(camera), states.p_world_m, states.t_s)


@njit(error_model="numpy")
def _shading_rows(lens, look, ps, present, normals, offsets, rows):
    eye, R = lens.camera_m, lens.R
    focal = math.sqrt(lens.focal_px[0] * lens.focal_px[1])
    for index in range(len(ps)):
        row = rows[index]
        nx, ny, nz = normals[index]
        wx, wy, wz = eye
        x, y, z, shadow = 0.0, 0.0, -1e3, 0.0
        if present[index]:
            wx, wy, wz = ps[index]
            x, y, z = to_camera(lens, wx, wy, wz)
            shadow = look[2]
        distance2 = x * x + y * y + z * z
        obliquity = distance2 / max(z, 1e-3) ** 2
        edge = look[3] / (focal * obliquity**0.75 / math.sqrt(distance2))
        row[0], row[1], row[2], row[3], row[4] = x, y, z, distance2 - BALL_RADIUS_M**2, edge
        for axis in range(3):
            row[5 + axis] = R[axis, 0] * nx + R[axis, 1] * ny + R[axis, 2] * nz
        row[8] = offsets[index] - (nx * eye[0] + ny * eye[1] + nz * eye[2])
        row[9], row[10], row[11], row[12], row[13], row[14] = wx, wy, wz, shadow, look[0], look[1]
        row[15] = distance2 - (BALL_RADIUS_M + 0.5 * edge) ** 2
        # At the launcher's mouth the inner part changes fast too.
        whole = nx * wx + ny * wy + nz * wz - offsets[index] > 2 * BALL_RADIUS_M
        inner = BALL_RADIUS_M - (0.5 + INNER_STRIDE * STEP_PX / look[3]) * edge
        row[16] = distance2 - inner**2 if whole and inner > 0 else math.inf


@njit(error_model="numpy")
def _boxes(lens, margin_px, ps, boxes):
    points = np.empty((BOX_POINTS, 2))
    for index in range(len(ps)):
        x, y, z = ps[index]
        ball_rim(lens, x, y, z, points)
        box_round(points, margin_px, lens.size_px, boxes[index, 0])
        _shadow_rim(lens, x, y, z, points)
        box_round(points, margin_px, lens.size_px, boxes[index, 1])


@njit(error_model="numpy")
def _circles(lens, ps, circles):
    points = np.empty((OUTLINE_POINTS, 2))
    for index in range(len(ps)):
        ball_rim(lens, ps[index, 0], ps[index, 1], ps[index, 2], points)
        circles[0, index], circles[1, index], circles[2, index] = circle_round(points)


@njit(error_model="numpy")
def ball_rim(lens, x_world, y_world, z_world, points):
    """Write points of the ball's outline (K, 2), like `core.cameras.ball_outline`."""
    x, y, z = to_camera(lens, x_world, y_world, z_world)
    distance2 = x * x + y * y + z * z
    if not (distance2 > BALL_RADIUS_M**2 and z > BALL_RADIUS_M):
        points[:] = math.nan
        return
    shrink = 1.0 - BALL_RADIUS_M**2 / distance2
    rim, distance = BALL_RADIUS_M * math.sqrt(shrink), math.sqrt(distance2)
    ux, uy, uz = x / distance, y / distance, z / distance
    ax, ay, az = (0.0, uz, -uy) if abs(ux) < 0.9 else (-uz, 0.0, ux)  # across the line of sight
    length = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / length, ay / length, az / length
    bx, by, bz = uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax
    for k in range(len(points)):
        angle = k * (2 * math.pi / len(points))
        c, s = rim * math.cos(angle), rim * math.sin(angle)
        px, py, pz = x * shrink + c * ax + s * bx, y * shrink + c * ay + s * by, z * shrink + c * az + s * bz
        points[k, 0], points[k, 1] = project_from_camera(lens, px, py, pz)


@njit(error_model="numpy")
def _shadow_rim(lens, x, y, z, points):
    """Points round the shadow on the plane where its middle falls: the table's, or else the floor's."""
    slope_x, slope_y = TO_LIGHT_X / TO_LIGHT_Z, TO_LIGHT_Y / TO_LIGHT_Z
    on_table = abs(x - slope_x * z) < HALF_LENGTH_M and abs(y - slope_y * z) < HALF_WIDTH_M and z > 0
    height = z + (0.0 if on_table else TABLE_HEIGHT_M)
    reach = (BALL_RADIUS_M + 0.5 * LIGHT_SIZE * height) / TO_LIGHT_Z
    for k in range(len(points)):
        angle = k * (2 * math.pi / len(points))
        px = x - slope_x * height + reach * math.cos(angle)
        py = y - slope_y * height + reach * math.sin(angle)
        cx, cy, cz = to_camera(lens, px, py, z - height)
        points[k, 0], points[k, 1] = project_from_camera(lens, cx, cy, cz)


@njit(error_model="numpy")
def _speed(lens, ps, t_s):
    width, height = lens.size_px
    fastest, before_u, before_v, was_near = 0.0, 0.0, 0.0, False
    for index in range(len(ps)):
        x, y, z = to_camera(lens, ps[index, 0], ps[index, 1], ps[index, 2])
        u, v = project_from_camera(lens, x, y, z)
        near = abs(u - width / 2) < width and abs(v - height / 2) < height
        if near and was_near:
            moved = math.sqrt((u - before_u) ** 2 + (v - before_v) ** 2)
            fastest = max(fastest, moved / ((t_s[index] - t_s[index - 1]) * 1e6))
        before_u, before_v, was_near = u, v, near
    return fastest
