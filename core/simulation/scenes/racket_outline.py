"""The racket's outline in the picture, row by row: a look at a moving racket touches only pixels near it.

The outline is that of the two rims and of the lines that join them. It is a little rough, and only says where to look;
what a pixel sees there is computed from the body itself.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.scenes.lens import lens_of, project_from_camera, to_camera
from core.simulation.scenes.racket_shape import RacketPath, RacketPoses

Array = NDArray[np.float64]

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
