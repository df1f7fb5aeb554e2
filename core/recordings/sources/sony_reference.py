"""The 3D reference of Sony's rallies: metadata/<camera>/seq_*.csv above the events, a row for each millisecond.

Columns pos_{x,y,z}_label in m and vel_{x,y,z}_label in m/s; `timestamps` in s count on the clock of the reference, so
row k is taken for millisecond k after t0, like the labels. In which frame the positions are is not said: they are
projected and compared with the labels beside the events, which were made from them.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.geometry import invert_transform
from core.recordings.hdf5 import dataset_at, read_whole
from core.recordings.truth import BallTruth

LABEL_SUFFIX: Final = "_label.h5"
INSTANT_US: Final = 500
"""A row's instant within its millisecond, as that of a label."""
FOLDER: Final = "metadata"
UP: Final = 4
"""Folders above the events in which that one may lie."""
NEAR_PX: Final = 3.0
"""Median distance from the labels that were made from the reference."""
LEAST_ROWS: Final = 5
ROW_S: Final = 0.001
LARGEST_BYTES: Final = 1 << 28
_COLUMNS: Final = tuple(f"{kind}_{axis}_label" for kind in ("pos", "vel") for axis in "xyz")
Move = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Positions (N, 3) of one frame in the world of the recording."""
_BROKEN: Final = (OSError, KeyError, ValueError, TypeError, IndexError, RuntimeError, csv.Error, RecordingError)


def read_reference(
    events: Path, name: str, camera: Camera | None, T_WO: NDArray[np.float64] | None, t0_us: int, notes: list[str]
) -> BallTruth | None:
    """The ball in the frame of the camera's world, on the clock of the events; None without one, and a note says why.

    Args:
        events: the file of events, whose labels are beside it.
        name: of the camera.
        camera: its calibration; its world is the table's frame where there is a `T_WO`.
        T_WO: the table's frame in the frame W of the calibration.
        t0_us: the clock of the events at millisecond 0.
        notes: what was found is added here.
    """
    path = _reference_file(events, name)
    if path is None:
        return None
    where = f"The 3D reference {FOLDER}/{name}/{path.name}"
    try:
        seconds, p, v = _read_table(path)
        points = _label_points(events)
    except _BROKEN as error:
        notes.append(f"{where} is left out: {' '.join(str(error).split())[:200]}.")
        return None
    if camera is None:
        notes.append(f"{where} is left out: without a calibration its frame cannot be told.")
        return None
    steps = np.diff(seconds)
    if len(steps) and not np.allclose(steps, ROW_S, atol=ROW_S / 10):
        notes.append(f"{where} is left out: its rows are not 1 ms apart.")
        return None
    frames: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
        "the world of the recording": lambda q: q
    }
    if T_WO is not None:
        T_OW = invert_transform(T_WO)
        frames["the calibration's frame W"] = lambda q: q @ T_OW[:3, :3].T + T_OW[:3, 3]
    distances = {frame: _distance_px(camera, move(p), points) for frame, move in frames.items()}
    best = min(distances, key=lambda frame: distances[frame])
    if not distances[best] <= NEAR_PX:
        notes.append(f"{where} is left out: in no frame it fits the labels beside the events.")
        return None
    origin = frames[best](np.zeros((1, 3)))
    rows = np.flatnonzero(np.isfinite(p).all(axis=1))
    t_us = t0_us + rows.astype(np.int64) * 1000 + INSTANT_US
    moved = frames[best](p[rows])
    turned = frames[best](v[rows]) - origin
    notes.append(
        f"{where} is the ground truth of the ball: the authors' frame cameras, not the events; {len(rows)} rows in "
        f"{best}, {distances[best]:.2f} px from the labels in the median; row k is taken for millisecond k."
    )
    return BallTruth(t_us, moved, turned, np.full((len(rows), 3), np.nan), np.ones(len(rows), np.bool_))


def _reference_file(events: Path, name: str) -> Path | None:
    for folder in list(events.resolve().parents)[:UP]:
        path = folder / FOLDER / name / f"{events.stem}.csv"
        if path.is_file():
            return path
    return None


def _read_table(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Seconds (N,), positions and velocities (N, 3); nan where a row has none."""
    if path.stat().st_size > LARGEST_BYTES:
        raise ValueError(f"larger than {LARGEST_BYTES >> 20} MiB")
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file))
    wanted = ("timestamps", *_COLUMNS)
    if not rows or any(name not in rows[0] for name in wanted):
        raise ValueError(f"expected the columns {', '.join(wanted)}")
    table = np.array([[float(row[name] or "nan") for name in wanted] for row in rows])
    return table[:, 0], table[:, 1:4], table[:, 4:7]


def _label_points(events: Path) -> NDArray[np.float64]:
    """Centres (M, 2), px, of the labels beside the events."""
    path = events.with_name(events.stem + LABEL_SUFFIX)
    if not path.is_file():
        raise ValueError(f"{path.name}, which tells its frame, is not beside the events")
    with h5py.File(path, "r") as file:
        points = np.asarray(read_whole(dataset_at(file, "points")), np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points of shape {points.shape} in {path.name}")
    return points


def _distance_px(camera: Camera, ps_world: NDArray[np.float64], points: NDArray[np.float64]) -> float:
    """Median distance of the projected rows from the labels of the same rows; infinite if there are too few."""
    count = min(len(ps_world), len(points))
    known = np.isfinite(ps_world[:count]).all(axis=1) & np.isfinite(points[:count]).all(axis=1)
    if np.count_nonzero(known) < LEAST_ROWS:
        return float("inf")
    uvs = camera.project(ps_world[:count][known])
    off = np.hypot(*(uvs - points[:count][known]).T)
    return float(np.median(np.where(np.isfinite(off), off, np.inf)))
