"""Whether cameras from a file can be right: what cannot be is refused with the likely cause, what is odd is noted."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration_values import CalibrationNode, short_repr
from core.cameras.camera import Camera
from core.cameras.units import LIKELY_M
from core.errors import CalibrationError
from core.geometry import invert_transform

Array = NDArray[np.float64]

FOCAL_SHARES: Final = (0.1, 100.0)
"""Focal length per longer side of the picture. A fisheye lens of 180 degrees has .3, a lens of 100 mm 16."""
FOCAL_RATIO: Final = 2.0
"""Between fx and fy; pixels are square in all event cameras."""
ODD_RATIO: Final = 1.1
ODD_CENTRE: Final = 0.2
"""Distance of the principal point, as a share of the side, off the middle of the picture."""
ODD_EXCHANGED: Final = 0.1
EXCHANGED_SHARE: Final = 0.25
"""Farther off than `ODD_EXCHANGED`, cx and cy are exchanged if that leaves no more than this share of the distance."""
GRID: Final = (16, 12)
"""Pixels of the picture for which a ray is looked for."""
MOST_BLIND: Final = 0.5
ORIGIN_FAR_M: Final = 15.0
SAME_M: Final = 1e-6


def check_lenses(cameras: Mapping[str, Camera], where: object) -> None:
    """Raises CalibrationError if a focal length, a principal point or a distortion belongs to no picture of that size.

    The message names the likely cause.
    """
    for name, camera in cameras.items():
        width, height = camera.sensor.width_px, camera.sensor.height_px
        (fx, fy), (cx, cy) = np.diag(camera.K)[:2], camera.K[:2, 2]
        place = f"{where}: {name}"
        low, high = (share * max(width, height) for share in FOCAL_SHARES)
        if not (low <= fx <= high and low <= fy <= high):
            raise CalibrationError(
                "the focal length cannot be in pixels of this picture",
                expected=f"{low:.0f} to {high:.0f} px for {camera.sensor}",
                got=f"fx {fx:g}, fy {fy:g}",
                where=place,
                remedy="divide millimetres by the size of a pixel; multiply shares of the picture by its size",
            )
        if not 1 / FOCAL_RATIO <= fx / fy <= FOCAL_RATIO:
            remedy = "four numbers in a list are fx, fy, cx, cy"
            raise CalibrationError("fx and fy differ too much", got=f"fx {fx:g}, fy {fy:g}", where=place, remedy=remedy)
        if not (0 <= cx < width and 0 <= cy < height):
            turned = 0 <= cx < height and 0 <= cy < width
            raise CalibrationError(
                "the principal point is outside of the picture",
                expected=f"cx, cy in {camera.sensor}",
                got=f"{cx:g}, {cy:g}",
                where=place,
                remedy="width and height seem to be exchanged" if turned else "K may be for another picture size",
            )
        if (share := _blind_share(camera)) > MOST_BLIND:
            raise CalibrationError(
                "the distortion cannot be right",
                expected="a ray for every pixel",
                got=f"none for {100 * share:.0f} % of the picture",
                where=place,
                remedy="check the order and the number of its coefficients, and the lens model",
            )


def check_rows_downwards(tree: CalibrationNode) -> None:
    """Raises CalibrationError if a key of a file says that rows are counted from the bottom of the picture."""
    for key, value in tree.values.items():
        plain = re.sub(r"[^a-z]", "", key.lower())
        upwards = isinstance(value, str) and re.search(r"bottom|lower|\bup", value.lower()) is not None
        if (plain.endswith(("origin", "yaxis", "ydirection")) and upwards) or (plain == "yup" and value is True):
            raise CalibrationError(
                "the rows are counted from the bottom of the picture",
                expected="row 0 at the top, as cameras count it",
                got=f"{key}: {short_repr(value)}",
                where=tree.where,
                remedy="calibrate with pictures whose row 0 is at the top",
            )


def odd_lenses(cameras: Mapping[str, Camera]) -> list[str]:
    """Lines about lenses that may be right but seldom are."""
    notes: list[str] = []
    for name, camera in cameras.items():
        size = np.array([camera.sensor.width_px, camera.sensor.height_px])
        (fx, fy), centre = np.diag(camera.K)[:2], camera.K[:2, 2]
        if not 1 / ODD_RATIO <= fx / fy <= ODD_RATIO:
            notes.append(f"{name}: fx {fx:g} and fy {fy:g} differ; pixels of event cameras are square")
        off, exchanged = (float(np.abs(one / size - 0.5).max()) for one in (centre, centre[::-1]))
        if exchanged < EXCHANGED_SHARE * off and off > ODD_EXCHANGED:
            notes.append(
                f"{name}: cx {centre[0]:g} and cy {centre[1]:g} seem to be exchanged: {camera.sensor} is the size"
            )
        elif off > ODD_CENTRE:
            notes.append(
                f"{name}: the principal point {centre[0]:g}, {centre[1]:g} is far from the middle of "
                f"{camera.sensor}; K may be for another picture size"
            )
        if share := _blind_share(camera):
            notes.append(f"{name}: the distortion gives no ray for {100 * share:.1f} % of the picture")
    return notes


def odd_poses(cameras: Mapping[str, Camera], *, own_world: bool) -> list[str]:
    """Lines about poses that may be the other way round, or in another unit.

    `own_world`: the file knows no world but the frame of its first camera.
    """
    notes: list[str] = []
    if own_world:
        if len(cameras) > 1:
            first = next(iter(cameras))
            notes.append(f"The calibration does not say where the table is: the world is the frame of {first}")
    else:
        notes += _turned_away(cameras)
    for (first, a), (second, b) in combinations(cameras.items(), 2):
        apart_m = float(np.linalg.norm(a.position_world_m - b.position_world_m))
        if not apart_m:
            notes.append(f"{first} and {second} stand at the same place: no point can be placed in space by them")
        elif not LIKELY_M[0] <= apart_m <= LIKELY_M[1]:
            notes.append(f"{first} and {second} are {apart_m:.3g} m apart: if that is wrong, see --calibration-unit")
    if {"left", "right"} <= set(cameras):
        x, y, z = cameras["left"].to_camera(cameras["right"].position_world_m)[0]
        if x < 0 and -x > max(abs(y), abs(z)):
            notes.append(
                f"right stands {-x:.3g} m to the left of left: the two may be exchanged, or their pose the other way "
                "round (OpenCV's R and T take coordinates of the left camera to the right one)"
            )
    return notes


def _turned_away(cameras: Mapping[str, Camera]) -> list[str]:
    """Lines about cameras that do not see the middle of the table where the file states poses in a world."""
    positions = [camera.position_world_m for camera in cameras.values()]
    if any(float(np.linalg.norm(position)) < SAME_M for position in positions):
        return []  # a camera is the world
    notes: list[str] = []
    for name, camera in cameras.items():
        away_m = float(np.linalg.norm(camera.position_world_m))
        if away_m > ORIGIN_FAR_M:
            notes.append(f"{name} is {away_m:.3g} m from the world's origin: if that is wrong, see --calibration-unit")
        if _sees_origin(camera):
            continue
        if _sees_origin(replace(camera, T_world_camera=invert_transform(camera.T_world_camera))):
            notes.append(
                f"{name} does not see the world's origin, the middle of the table; with its pose the other way round "
                "(T_camera_world) it would"
            )
        elif camera.to_camera(np.zeros((1, 3)))[0, 2] <= 0:
            notes.append(f"{name} looks away from the world's origin, the middle of the table")
    return notes


def _sees_origin(camera: Camera) -> bool:
    uv = camera.project(np.zeros((1, 3)))[0]
    return bool(((uv >= 0) & (uv < (camera.sensor.width_px, camera.sensor.height_px))).all())


def check_against_essential(E: Array, T_right_left: Array, where: str) -> None:
    """Raises CalibrationError if the essential matrix of a file says that its R and T are the other way round."""
    if _fits_essential(E, T_right_left) or not _fits_essential(E, invert_transform(T_right_left)):
        return
    raise CalibrationError(
        "R and T are the other way round than E",
        expected="R and T that take coordinates of the left camera to the right one",
        where=where,
        remedy="write R' and -R' T, or exchange left and right",
    )


def _fits_essential(E: Array, T: Array) -> bool:
    x, y, z = T[:3, 3]
    expected = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ T[:3, :3]
    sizes = float(np.linalg.norm(E)) * float(np.linalg.norm(expected))
    return sizes > 0 and abs(float((E * expected).sum())) > 0.999 * sizes


def _blind_share(camera: Camera) -> float:
    """Share of the picture's pixels that no ray leads to."""
    if not camera.distortion.any():
        return 0.0
    columns = np.linspace(0, camera.sensor.width_px - 1, GRID[0])
    rows = np.linspace(0, camera.sensor.height_px - 1, GRID[1])
    uvs = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    blind = ~np.isfinite(camera.undistort(uvs)[:, 0])
    if camera.model == "fisheye":  # what is more than 90 degrees off the axis has no pinhole coordinates
        blind &= np.hypot(*((uvs - camera.K[:2, 2]) / np.diag(camera.K)[:2]).T) < 0.9 * _fisheye_edge(camera)
    return float(blind.mean())


def _fisheye_edge(camera: Camera) -> float:
    """Radius in the picture, over the focal length, of a ray 90 degrees off the axis; infinite if the model folds.

    Where the radius stops growing with the angle, what lies beyond is no picture of anything: nothing excuses it.
    """
    angles = np.linspace(0.0, np.pi / 2, 91)
    radii = angles * (1.0 + angles[:, None] ** np.array([2, 4, 6, 8]) @ camera.distortion)
    return float(radii[-1]) if (np.diff(radii) > 0).all() else math.inf
