"""The racket in the picture: a matt black cylinder, as thick as the physics has it, that hides and is hidden.

Its light does not change as it turns, so that a moving racket makes events at its outline only. It casts no shadow and
the ball casts none on it. Its outline, that of the two rims and of the lines that join them, says row by row which
pixels may have changed; it is a little rough, and what a pixel sees there is computed from the body itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.scenes.lens import lens_of, project_from_camera, to_camera

Array = NDArray[np.float64]

RACKET_COLUMNS = 14
"""A row that describes the racket at one instant to one camera: 0-2 middle of its face in the camera's frame, 3-5
normal of the face there, 6 its light, 7 width of an edge at it in metres, 8 radius, 9 thickness, 10-12 middle of its
body, 13 squared length of a tangent to the sphere round the body and its edge."""


@dataclass(frozen=True, slots=True, eq=False)
class RacketPoses:
    """The racket at N times: the middle of its face and the face's normal, away from the body."""

    p_world_m: Array
    """(N, 3)."""
    normal_world: Array
    """(N, 3) unit vectors."""


class RacketPath(Protocol):
    """Where the racket is at any time."""

    @property
    def radius_m(self) -> float:
        """Radius of the racket's face."""
        ...

    @property
    def thickness_m(self) -> float:
        """Thickness of the body behind the face."""
        ...

    def at(self, t_s: ArrayLike) -> RacketPoses:
        """The racket at the times `t_s` (N,)."""
        ...


def racket_shading_rows(camera: Camera, light: float, edge_px: float, path: RacketPath, poses: RacketPoses) -> Array:
    """The racket at each time, as rows (N, RACKET_COLUMNS).

    Args:
        camera: lens and pose.
        light: of the face, as a share of white.
        edge_px: width of the edges.
        path: radius and thickness of the racket.
        poses: N centres and normals, world.
    """
    rows = np.empty((len(poses.p_world_m), RACKET_COLUMNS))
    body = light, edge_px, float(path.radius_m), float(path.thickness_m)
    _shading_rows(lens_of(camera), body, poses.p_world_m, poses.normal_world, rows)
    return rows


@njit(error_model="numpy")
def _shading_rows(lens, body, ps, normals, rows):
    (light, edge_px, radius, thickness), R = body, lens.R
    focal = math.sqrt(lens.focal_px[0] * lens.focal_px[1])
    for index in range(len(ps)):
        row = rows[index]
        x, y, z = to_camera(lens, ps[index, 0], ps[index, 1], ps[index, 2])
        row[0], row[1], row[2], row[6], row[8], row[9] = x, y, z, light, radius, thickness
        for axis in range(3):
            row[3 + axis] = (
                normals[index, 0] * R[axis, 0] + normals[index, 1] * R[axis, 1] + normals[index, 2] * R[axis, 2]
            )
            row[10 + axis] = row[axis] - 0.5 * thickness * row[3 + axis]
        row[7] = edge_px / (focal / max(abs(row[12]), 1e-3))
        distance2 = row[10] * row[10] + row[11] * row[11] + row[12] * row[12]
        row[13] = distance2 - (math.hypot(radius, 0.5 * thickness) + row[7]) ** 2


@njit(error_model="numpy")
def racket_gap(racket, x, y):
    """(how far the ray of a pixel stays outside the body, negative inside; camera z where it enters or passes).

    The gap at a point is the largest of its distances beyond the side, the face and the back, a convex function along
    the ray; its least value is 0 exactly at the outline.
    """
    length2 = x * x + y * y + 1.0
    along = x * racket[10] + y * racket[11] + racket[12]
    if along <= 0.0 or along * along <= racket[13] * length2:
        return 1.0, 0.0
    nd = racket[3] * x + racket[4] * y + racket[5]
    nc = racket[3] * racket[0] + racket[4] * racket[1] + racket[5] * racket[2]
    dc = x * racket[0] + y * racket[1] + racket[2]
    cc = racket[0] * racket[0] + racket[1] * racket[1] + racket[2] * racket[2]
    # Squared distance from the axis at camera z = t: A t^2 - 2 B t + C.
    A, B, C = max(length2 - nd * nd, 1e-12), dc - nd * nc, max(cc - nc * nc, 0.0)
    t, radius, thickness = B / A, racket[8], racket[9]
    height = t * nd - nc
    gap, beyond = math.sqrt(max(C - B * B / A, 0.0)) - radius, max(height, -thickness - height)
    if beyond > gap:
        # Nearest to the axis it is before the face or behind the back: go along the ray until the side is as far.
        slope, start = (nd, -nc) if height >= -thickness - height else (-nd, nc - thickness)
        gap, t = _meet(A, B, C, radius, slope, start, t, beyond)
        gap = max(gap, -0.5 * thickness)
    if gap < 0.0:
        enter = (B - math.sqrt(max(B * B - A * (C - radius * radius), 0.0))) / A
        if abs(nd) > 1e-9:
            enter = max(enter, nc / nd if nd < 0.0 else (nc - thickness) / nd)
        t = enter
    return gap, t


@njit(error_model="numpy")
def _meet(A, B, C, radius, slope, start, t0, at_t0):
    """Least of the larger of (distance from the axis - radius) and (start + slope t), on the falling side of t0."""
    if abs(slope) < 1e-9:
        return at_t0, t0
    k = radius + start
    a, b, c = A - slope * slope, B + k * slope, C - k * k
    if abs(a) < 1e-12:
        t = c / (2.0 * b) if b != 0.0 else t0
    else:
        root = math.sqrt(max(b * b - a * c, 0.0))
        low, high = (b - root) / a, (b + root) / a
        if low > high:
            low, high = high, low
        before, after = high if high <= t0 else low, low if low >= t0 else high
        t = before if slope > 0.0 else after
    return start + slope * t, t


RIM_POINTS = 16
MARGIN_PX = 2
"""Half an edge (0.8 px, a half more where the rim is seen at a slant) and the roughness of the outline."""
NOWHERE = 1e9


def racket_outline(camera: Camera, path: RacketPath, poses: RacketPoses) -> Array:
    """(N, 2 RIM_POINTS, 2) pixels of points on the front rim, then the back rim; nan behind the camera."""
    points = np.empty((len(poses.p_world_m), 2 * RIM_POINTS, 2))
    _rims(lens_of(camera), poses.p_world_m, poses.normal_world, path.radius_m, path.thickness_m, points)
    return points


@njit(error_model="numpy")
def most_moved(outlines, seen):
    """(farthest that a point of the outlines (N, K, 2) is from where it was in `seen`, most from one to the next)."""
    away = step = 0.0
    for index in range(len(outlines)):
        for k in range(outlines.shape[1]):
            for axis in range(2):
                at = outlines[index, k, axis]
                away = max(away, abs(at - seen[k, axis]))
                if index:
                    step = max(step, abs(at - outlines[index - 1, k, axis]))
    return away, step


@njit(error_model="numpy")
def _rims(lens, ps, normals, radius, thickness, points):
    # A polygon round the circle, so that nothing of the rim is outside.
    reach = radius / math.cos(math.pi / RIM_POINTS)
    for i in range(len(ps)):
        nx, ny, nz = normals[i]
        ux, uy, uz = (ny, -nx, 0.0) if abs(nz) < 0.9 else (0.0, nz, -ny)
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / length, uy / length, uz / length
        vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        for k in range(RIM_POINTS):
            c, s = reach * math.cos(2 * math.pi * k / RIM_POINTS), reach * math.sin(2 * math.pi * k / RIM_POINTS)
            x, y, z = ps[i, 0] + c * ux + s * vx, ps[i, 1] + c * uy + s * vy, ps[i, 2] + c * uz + s * vz
            points[i, k] = _project(lens, x, y, z)
            points[i, RIM_POINTS + k] = _project(lens, x - thickness * nx, y - thickness * ny, z - thickness * nz)


@njit(error_model="numpy")
def _project(lens, x, y, z):
    x, y, z = to_camera(lens, x, y, z)
    return project_from_camera(lens, x, y, z)


@njit(error_model="numpy")
def rows_for_spans(boxes):
    """(1 + rows, 2) room for the first and last column of the outline in each row that the boxes (S + 1, 4) reach.

    Row 0 holds the number of the first row of pixels and how many there are.
    """
    low, high = 1 << 30, 0
    for box in boxes:
        if box[2] > box[0]:
            low, high = min(low, box[1] - MARGIN_PX - 1), max(high, box[3] + MARGIN_PX + 1)
    spans = np.empty((1 + max(high - low, 0), 2))
    spans[0, 0], spans[0, 1] = low, max(high - low, 0)
    return spans


@njit(error_model="numpy")
def outline_spans(outline, spans):
    """Write the outline's first and last column in every row."""
    for row in range(1, len(spans)):
        spans[row, 0], spans[row, 1] = NOWHERE, -NOWHERE
    half = len(outline) // 2
    for k in range(half):
        following = (k + 1) % half
        _add_edge(outline[k], outline[following], spans)
        _add_edge(outline[half + k], outline[half + following], spans)
        _add_edge(outline[k], outline[half + k], spans)


@njit(error_model="numpy")
def _add_edge(a, b, spans):
    first, count = spans[0, 0], int(spans[0, 1])
    x0, y0, x1, y1 = a[0], a[1], b[0], b[1]
    if y0 > y1:
        x0, y0, x1, y1 = x1, y1, x0, y0
    slope = (x1 - x0) / (y1 - y0) if y1 > y0 else 0.0
    for row in range(max(int(y0 - first), 0), min(int(y1 - first) + 2, count)):
        # The edge within half a row of the middle of this one.
        top, bottom = max(row + first - 0.5, y0), min(row + first + 0.5, y1)
        if top > bottom:
            continue
        left, right = x0 + slope * (top - y0), x0 + slope * (bottom - y0)
        spans[1 + row, 0] = min(spans[1 + row, 0], left, right)
        spans[1 + row, 1] = max(spans[1 + row, 1], left, right)


@njit(error_model="numpy")
def unchanged_columns(before, now, y, x0, x1):
    """(first, left, right, end): of a row of pixels only [first, left) and [right, end) may have changed.

    Between them the racket hid everything and hides it still, outside of them it never was.
    """
    row, count = y - int(before[0, 0]), int(before[0, 1])
    first, left, right, end = NOWHERE, -NOWHERE, NOWHERE, -NOWHERE
    for spans in (before, now):
        for near in range(max(row - MARGIN_PX, 0), min(row + MARGIN_PX + 1, count)):
            first, left = min(first, spans[1 + near, 0]), max(left, spans[1 + near, 0])
            right, end = min(right, spans[1 + near, 1]), max(end, spans[1 + near, 1])
    if first > end:
        return x0, x0, x0, x0
    first_px, end_px = max(int(first) - MARGIN_PX, x0), min(int(end) + MARGIN_PX + 2, x1)
    left_px, right_px = min(int(left) + MARGIN_PX + 2, end_px), max(int(right) - MARGIN_PX, first_px)
    if left + MARGIN_PX >= right - MARGIN_PX:
        return first_px, end_px, end_px, end_px
    return first_px, max(left_px, first_px), min(right_px, end_px), end_px
