"""Names in our recording file, and how values of the project are laid out under them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.hdf5 import dataset_at, kind_at, names_in, place_of, read_whole
from core.recordings.ms_index import MAX_TIME_US as MAX_TIME_US
from core.recordings.recording import Triggers
from core.recordings.truth import BallTruth, PixelTruth

FORMAT: Final = "rallyscope-recording"
VERSION: Final = 1
LARGEST_CALIBRATED: Final = 1e9
"""Of any number of a calibration."""

Rows = dict[str, NDArray]
"""Equally long columns of one group; the first axis is the row."""


def events_group(camera: str) -> str:
    return f"/cameras/{camera}/events"


def triggers_group(camera: str) -> str:
    return f"/cameras/{camera}/triggers"


def frames_group(camera: str) -> str:
    return f"/cameras/{camera}/frames"


def calibration_group(camera: str) -> str:
    return f"/cameras/{camera}/calibration"


def truth_group(camera: str) -> str:
    return f"/ground_truth/{camera}"


BALL_GROUP: Final = "/ground_truth/ball"


def trigger_rows(triggers: Triggers) -> Rows:
    return {"t": triggers.t_us, "p": triggers.rising.astype(np.uint8), "id": triggers.channel}


def triggers_from_rows(rows: Rows) -> Triggers:
    return Triggers(_column(rows["t"], np.int64), _column(rows["p"], np.bool_), _column(rows["id"], np.int16))


def pixel_truth_rows(truth: PixelTruth) -> Rows:
    return {"t_us": truth.t_us, "u_px": truth.u_px, "v_px": truth.v_px, "r_px": truth.r_px, "visible": truth.visible}


def pixel_truth_from_rows(rows: Rows) -> PixelTruth:
    u_px, v_px, r_px = (_column(rows[name], np.float64) for name in ("u_px", "v_px", "r_px"))
    return PixelTruth(_column(rows["t_us"], np.int64), u_px, v_px, r_px, _column(rows["visible"], np.bool_))


def ball_rows(ball: BallTruth) -> Rows:
    return {
        "t_us": ball.t_us,
        "p_world_m": ball.p_world_m,
        "v_world_mps": ball.v_world_mps,
        "spin_radps": ball.spin_radps,
        "visible": ball.visible,
    }


def ball_from_rows(rows: Rows) -> BallTruth:
    p, v, spin = (_column(rows[name], np.float64) for name in ("p_world_m", "v_world_mps", "spin_radps"))
    return BallTruth(_column(rows["t_us"], np.int64), p, v, spin, _column(rows["visible"], np.bool_))


def check_rows(rows: Mapping[str, NDArray], *, where: str) -> int:
    """The number of rows.

    Raises:
        RecordingError: if columns differ in length, hold something else than numbers, or time decreases.
    """
    lengths = {name: len(column) for name, column in rows.items()}
    if len(set(lengths.values())) != 1:
        raise RecordingError("columns differ in length", expected="equal lengths", got=lengths or "none", where=where)
    for name, column in rows.items():
        if column.dtype.kind not in "biufS":
            raise RecordingError(f"column {name} has no plain type", got=column.dtype, where=where)
        if name in ("t", "t_us") and bool((column[1:] < column[:-1]).any()):
            raise RecordingError(f"column {name} runs backwards", expected="times that never decrease", where=where)
    return next(iter(lengths.values()))


def read_rows(group: h5py.Group) -> Rows:
    """Every column of a group, read-only.

    Raises:
        RecordingError: if one cannot be read, or they do not fit together.
    """
    rows: Rows = {}
    for name in names_in(group):
        if kind_at(group, name) is not h5py.Group:
            dataset = dataset_at(group, name)
            if dataset.ndim:
                rows[name] = read_whole(dataset)
    if len({len(column) for column in rows.values()}) > 1:
        lengths = {name: len(column) for name, column in rows.items()}
        raise RecordingError("columns differ in length", expected="equal lengths", got=lengths, where=place_of(group))
    return rows


def read_calibration(group: h5py.Group, sensor: SensorSize) -> Camera:
    """The camera of `/cameras/<name>/calibration`.

    Raises:
        RallyscopeError: if it is not one.
    """
    columns = [read_whole(dataset_at(group, name)) for name in ("K", "distortion", "T_world_camera")]
    for column in columns:
        if column.dtype.kind not in "fiu" or not (np.abs(column) < LARGEST_CALIBRATED).all():
            raise RecordingError("the calibration is no numbers of a camera", got=column.dtype, where=place_of(group))
    K, distortion, T_world_camera = (_column(column, np.float64) for column in columns)
    return Camera(sensor, K, distortion, T_world_camera)


def _column(values: NDArray, dtype: type) -> NDArray:
    column = np.ascontiguousarray(values, dtype)
    if column.flags.writeable:
        column = column.view()
        column.flags.writeable = False
    return column
