"""What one camera saw of the swept point: pixels over time."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import CalibrationError

Array = NDArray[np.float64]

MAX_GAP_US: Final = 6000
"""Neighbours that are farther apart say nothing about each other: two 2 ms windows may fail in a row."""
STRAY_TIMES_MEDIAN: Final = 4.0
"""A sighting is a stray beyond this many median distances from where neighbours expect it: 3.4 sigma of plain noise in
two axes."""
LARGEST_FILE_BYTES: Final = 256 << 20


@dataclass(frozen=True, slots=True, eq=False)
class PointTrack:
    """N sightings, ascending in time within each marker."""

    t_us: NDArray[np.int64]
    """On the camera's own clock."""
    uvs_px: Array
    """(N, 2), distorted pixels as they were seen."""
    marker: NDArray[np.int64]
    """Which point it is: 0 for a ball, 0, 1, ... along a wand."""

    @staticmethod
    def of(t_us: ArrayLike, uvs_px: ArrayLike, marker: ArrayLike | None = None) -> PointTrack:
        """A track sorted by marker and time, rows that are not finite left out."""
        t, uvs = np.asarray(t_us, np.int64), np.asarray(uvs_px, np.float64).reshape(-1, 2)
        which = np.zeros(len(t), np.int64) if marker is None else np.asarray(marker, np.int64)
        keep = np.flatnonzero(np.isfinite(uvs).all(axis=1))
        order = keep[np.lexsort((t[keep], which[keep]))]
        return PointTrack(t[order], uvs[order], which[order])


def clean_track(track: PointTrack) -> PointTrack:
    """The sightings that lie where the parabola through their four neighbours expects them.

    A stray detection makes a steep stretch in the interpolated track. By chance it crosses the right place, and then
    it fixes the clocks' offset, wrongly, as firmly as many good ones. Bounces and the ends of a run go too.
    """
    near = (
        np.arange(len(track.t_us) - 4)[:, None] + np.array([0, 1, 3, 4])
        if len(track.t_us) > 4
        else np.empty((0, 4), int)
    )
    t = track.t_us[near] - track.t_us[2:-2, None] if len(near) else np.empty((0, 4))
    whole = (np.diff(t, axis=1) > 0).all(axis=1) & (t[:, 1] < 0) & (t[:, 2] > 0)
    whole &= (np.abs(t[:, [0, 3]]) <= 2 * MAX_GAP_US).all(axis=1)
    whole &= (track.marker[near] == track.marker[near[:, :1]]).all(axis=1)
    ms = 1e-3 * t[whole]
    design = np.stack([np.ones_like(ms), ms, ms * ms], axis=2)
    # The constant term: times count from the sighting that is judged.
    expected = (np.linalg.pinv(design) @ track.uvs_px[near[whole]])[:, 0]
    rows = np.flatnonzero(whole) + 2
    off = np.linalg.norm(track.uvs_px[rows] - expected, axis=1)
    keep = rows[off <= STRAY_TIMES_MEDIAN * np.median(off)] if len(rows) else rows
    return PointTrack(track.t_us[keep], track.uvs_px[keep], track.marker[keep])


def motion_directions(track: PointTrack) -> Array:
    """(N, 2) unit vectors along the motion in the picture, over two sightings to each side; 0 where there is none."""
    rows = np.arange(len(track.t_us))
    before, after = np.maximum(rows - 2, 0), np.minimum(rows + 2, len(rows) - 1)
    move = track.uvs_px[after] - track.uvs_px[before]
    size = np.linalg.norm(move, axis=1, keepdims=True)
    near = (track.marker[after] == track.marker[before]) & (track.t_us[after] - track.t_us[before] <= 4 * MAX_GAP_US)
    return np.where(near[:, None] & (size > 0), move / np.maximum(size, 1e-12), 0.0)


def read_point_track(path: Path) -> PointTrack:
    """A table as `detect` writes it: t_us, u_px, v_px and what else; a column `marker` numbers the points of a wand.

    Raises:
        CalibrationError: if it is no such table.
    """
    try:
        if path.stat().st_size > LARGEST_FILE_BYTES:
            raise CalibrationError("too large for a table of detections", expected="at most 256 MiB", where=path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [_row(row, f"{path}, line {number}") for number, row in enumerate(csv.DictReader(file), start=2)]
    except OSError as error:
        raise CalibrationError("cannot read the detections", got=error.strerror, where=path) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise CalibrationError("not a table", expected="CSV with t_us,u_px,v_px", where=path) from error
    columns = np.array(rows, np.float64).reshape(-1, 4)
    return PointTrack.of(columns[:, 0].astype(np.int64), columns[:, 1:3], columns[:, 3].astype(np.int64))


def _row(row: Mapping[str, str | None], where: str) -> tuple[float, float, float, float]:
    try:
        t_us, u_px, v_px = (float(row[name] or "") for name in ("t_us", "u_px", "v_px"))
        marker = float(row.get("marker") or 0)
    except (KeyError, ValueError) as error:
        raise CalibrationError("not a detection", expected="numbers t_us,u_px,v_px", where=where) from error
    if not (math.isfinite(t_us) and abs(t_us) < 2**53 and 0 <= marker < 100 and marker % 1 == 0):
        raise CalibrationError("not a detection", expected="a time in us, a marker 0 to 99", where=where)
    return t_us, u_px, v_px, marker
