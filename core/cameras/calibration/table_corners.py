"""Points of the table that a person clicked in the pictures: they place the cameras in the world."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.geometry import invert_transform, make_transform
from core.table import NET_HEIGHT_M, NET_OVERHANG_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

_X, _Y = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2
CORNERS: Final[dict[str, tuple[float, float, float]]] = {
    "robot-left": (-_X, _Y, 0.0),
    "robot-right": (-_X, -_Y, 0.0),
    "opponent-left": (_X, _Y, 0.0),
    "opponent-right": (_X, -_Y, 0.0),
    "net-left": (0.0, _Y, 0.0),
    "net-right": (0.0, -_Y, 0.0),
    "robot-centre": (-_X, 0.0, 0.0),
    "opponent-centre": (_X, 0.0, 0.0),
    "post-left": (0.0, _Y + NET_OVERHANG_M, NET_HEIGHT_M),
    "post-right": (0.0, -_Y - NET_OVERHANG_M, NET_HEIGHT_M),
}
"""In the world. Left and right as the robot sees them; net-*: where the net stands on the table's edge; *-centre: the
ends of the centre line; post-*: the top outer ends of the net."""
CLICKS_AT_LEAST: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class Clicks:
    """Named points in one camera's picture."""

    names: tuple[str, ...]
    uvs_px: Array
    """(K, 2)."""

    @property
    def ps_world_m(self) -> Array:
        """(K, 3) where they are."""
        return np.array([CORNERS[name] for name in self.names]).reshape(-1, 3)


def read_clicks(path: Path) -> dict[str, Clicks]:
    """A table with the columns camera,corner,u_px,v_px; the clicks of each camera.

    Raises:
        CalibrationError: if it is no such table, or a corner is unknown or named twice.
    """
    found: dict[str, dict[str, tuple[float, float]]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            for number, row in enumerate(csv.DictReader(file), start=2):
                where = f"{path}, line {number}"
                camera, corner, at = _click(row, where)
                if corner in found.setdefault(camera, {}):
                    raise CalibrationError(f"{corner} of {camera} is there twice", where=where)
                found[camera][corner] = at
    except OSError as error:
        raise CalibrationError("cannot read the corners", got=error.strerror, where=path) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise CalibrationError("not a table", expected="CSV with camera,corner,u_px,v_px", where=path) from error
    return {camera: Clicks(tuple(clicks), np.array(list(clicks.values()))) for camera, clicks in found.items()}


def _click(row: Mapping[str, str | None], where: str) -> tuple[str, str, tuple[float, float]]:
    camera, corner = row.get("camera"), row.get("corner")
    if not camera or not corner:
        raise CalibrationError("not a clicked corner", expected="camera,corner,u_px,v_px", where=where)
    if corner not in CORNERS:
        raise CalibrationError("no such corner", expected=", ".join(CORNERS), got=corner, where=where)
    try:
        u_px, v_px = float(row.get("u_px") or ""), float(row.get("v_px") or "")
    except ValueError as error:
        raise CalibrationError("not a pixel", expected="numbers u_px and v_px", where=where) from error
    if not (np.isfinite(u_px) and np.isfinite(v_px)):
        raise CalibrationError("not a pixel", expected="finite numbers", where=where)
    return camera, corner, (u_px, v_px)


def pose_from_clicks(camera: Camera, clicks: Clicks, name: str) -> Array:
    """`T_world_camera` (4, 4) that fits the clicks best (OpenCV's solvePnP): of a flat table's two, the one above it.

    Raises:
        CalibrationError: with fewer than four clicks, or none that a camera above the table could see.
    """
    if len(clicks.names) < CLICKS_AT_LEAST:
        raise CalibrationError(
            f"too few corners of {name}", expected=f"{CLICKS_AT_LEAST} or more", got=len(clicks.names)
        )
    ps = clicks.ps_world_m
    K, distortion, uvs_px = camera.K, camera.distortion, clicks.uvs_px
    if camera.model != "pinhole":  # solvePnP knows the pinhole only: to it, the straightened picture is given
        uvs_px, distortion = camera.undistort(uvs_px) @ np.diag(np.diag(K)[:2]) + K[:2, 2], np.zeros(5)
        if not np.isfinite(uvs_px).all():
            raise CalibrationError(f"a corner of {name} is where its lens leads no ray", remedy="check the lens")
    flags = cv2.SOLVEPNP_IPPE if not ps[:, 2].any() else cv2.SOLVEPNP_SQPNP
    try:
        _, rvecs, tvecs, _ = cv2.solvePnPGeneric(ps, uvs_px, K, distortion, flags=flags)
    except cv2.error as error:
        raise CalibrationError(f"the corners of {name} fix no pose", remedy="click corners of both halves") from error
    best: tuple[float, Array] | None = None
    for rvec, tvec in zip(rvecs, tvecs, strict=True):
        rvec, tvec = cv2.solvePnPRefineLM(ps, uvs_px, K, distortion, rvec, tvec)
        projected, _ = cv2.projectPoints(ps, rvec, tvec, K, distortion)
        error = float(np.linalg.norm(np.asarray(projected).reshape(-1, 2) - uvs_px))
        R_camera_world = np.asarray(cv2.Rodrigues(rvec)[0], np.float64)
        T_world_camera = invert_transform(make_transform(R_camera_world, np.ravel(tvec)))
        if T_world_camera[2, 3] > 0 and (best is None or error < best[0]):
            best = error, T_world_camera
    if best is None:
        raise CalibrationError(
            f"no camera above the table sees the corners of {name} there", remedy="check their names"
        )
    return best[1]
