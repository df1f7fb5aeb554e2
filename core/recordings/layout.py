"""Names in our recording file, and how values of the project are laid out under them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.distortion import LensModel
from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.hdf5 import dataset_at, kind_at, names_in, place_of, read_whole
from core.recordings.log.growing import Json
from core.recordings.ms_index import MAX_TIME_US as MAX_TIME_US
from core.recordings.recording import Triggers
from core.recordings.truth import BallTruth, PixelTruth

FORMAT: Final = "rallyscope-recording"
VERSION: Final = 1
LARGEST_CALIBRATED: Final = 1e9
"""Largest number of a calibration."""
FISHEYE_DISTORTION: Final = "fisheye_distortion"
"""Dataset of the four coefficients of a fisheye lens, instead of `distortion`."""
LENS_MODEL: Final = "lens_model"
"""Attribute of a calibration group; absent for a pinhole."""

Rows = dict[str, NDArray]
"""Equally long columns of one group; the first axis is the row."""


def check_camera_name(name: str) -> None:
    """Names become groups of a recording, and parts of the names of files.

    Raises:
        RecordingError: if this one must not.
    """
    if not name or not name.replace("_", "").replace("-", "").isalnum() or name == "ball":
        raise RecordingError("not a camera name", expected="letters, digits, - and _, not 'ball'", got=repr(name))


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


def calibration_values(camera: Camera) -> Json:
    """The datasets of `/cameras/<name>/calibration`.

    A fisheye lens has its coefficients in a dataset of another name: who knows only the pinhole, finds no distortion
    and does not take them for that of one. The group's attribute `lens_model` says the same.
    """
    distortion = FISHEYE_DISTORTION if camera.model == "fisheye" else "distortion"
    return {
        "K": camera.K.tolist(),
        distortion: camera.distortion.tolist(),
        "T_world_camera": camera.T_world_camera.tolist(),
    }


def read_calibration(group: h5py.Group, sensor: SensorSize) -> Camera:
    """The camera of `/cameras/<name>/calibration`.

    Raises:
        RallyscopeError: if it is not one.
    """
    model: LensModel = "fisheye" if FISHEYE_DISTORTION in names_in(group) else "pinhole"
    distortion_name = FISHEYE_DISTORTION if model == "fisheye" else "distortion"
    columns = [read_whole(dataset_at(group, name)) for name in ("K", distortion_name, "T_world_camera")]
    for column in columns:
        if column.dtype.kind not in "fiu" or not (np.abs(column) < LARGEST_CALIBRATED).all():
            raise RecordingError("the calibration is no numbers of a camera", got=column.dtype, where=place_of(group))
    K, distortion, T_world_camera = (_column(column, np.float64) for column in columns)
    return Camera(sensor, K, distortion, T_world_camera, model)


def _column(values: NDArray, dtype: type) -> NDArray:
    column = np.ascontiguousarray(values, dtype)
    if column.flags.writeable:
        column = column.view()
        column.flags.writeable = False
    return column


@dataclass(frozen=True, slots=True)
class ColumnKind:
    """What a column holds."""

    kinds: str
    """Permitted letters of `numpy.dtype.kind`."""
    row_shape: tuple[int, ...] = ()
    required: bool = True


WHOLE: Final = ColumnKind("iu")
REAL: Final = ColumnKind("fiu")
FLAG: Final = ColumnKind("biu")
TEXT: Final = ColumnKind("S")
VECTOR: Final = ColumnKind("fiu", (3,))
TURN: Final = ColumnKind("fiu", (4,))
_MAYBE: Final = {width: ColumnKind("fiu", (width,), required=False) for width in (2, 3, 4, 6)}

Columns = Mapping[str, ColumnKind]
_POSE: Final[Columns] = {"t_us": WHOLE, "p_world_m": VECTOR, "q_world_wxyz": TURN}
_PIXEL_TRUTH: Final[Columns] = {"t_us": WHOLE, "u_px": REAL, "v_px": REAL, "r_px": REAL, "visible": FLAG}
_TRIGGERS: Final[Columns] = {"t": WHOLE, "p": FLAG, "id": WHOLE}
_READOUT: Final[Columns] = {"delayed": WHOLE, "dropped": WHOLE, "longest_us": WHOLE}
_EXACTLY: Final[Mapping[str, Columns]] = {
    "/ground_truth/ball": {
        "t_us": WHOLE,
        "p_world_m": VECTOR,
        "v_world_mps": VECTOR,
        "spin_radps": VECTOR,
        "visible": FLAG,
    },
    "/racket": {**_POSE, "v_world_mps": _MAYBE[3]},
    "/predictions": {
        "t_us": WHOLE,
        "stage": TEXT,
        "t_hit_us": WHOLE,
        "p_hit_m": VECTOR,
        "v_hit_mps": VECTOR,
        "cov": ColumnKind("fiu", (6, 6)),
        "cameras": ColumnKind("S", required=False),  # not in files of older versions
    },
    "/racket_targets": {
        **_POSE,
        "stage": TEXT,
        "t_hit_us": WHOLE,
        "v_world_mps": VECTOR,
        "a": VECTOR,
        "g": ColumnKind("fiu", (2,)),
    },
    "/hit_choices": {
        "t_us": WHOLE,
        "t_hit_us": WHOLE,
        "p_hit_m": VECTOR,
        "sigma_m": VECTOR,
        "chance": REAL,
        "landing_sigma_m": REAL,
        "chosen": FLAG,
        "why_not": TEXT,
    },
    "/episodes": {
        "serve_us": WHOLE,
        "speed_mps": REAL,
        "case": WHOLE,
        "f": VECTOR,
        "s": _MAYBE[6],
        "g": _MAYBE[2],
        "a": _MAYBE[3],
        "q_wxyz": _MAYBE[4],
        "s_next": _MAYBE[6],
    },
    "/scenes": {"t_us": WHOLE, "zero_us": WHOLE, "seed": WHOLE, "name": TEXT},
}


def check_known_rows(group: str, rows: Mapping[str, NDArray]) -> None:
    """Check the columns of a group that the project knows; of any other nothing is asked.

    Raises:
        RecordingError: if a column is missing, holds something else, or times run backwards or are absurd.
    """
    for name, kind in _columns_of(group).items():
        column = rows.get(name)
        if column is None:
            if kind.required:
                raise RecordingError(f"column {name} is missing", where=group)
            continue
        if column.dtype.kind not in kind.kinds or column.shape[1:] != kind.row_shape:
            expected, got = f"rows of shape {kind.row_shape}, type {kind.kinds}", f"{column.dtype}{column.shape}"
            raise RecordingError(f"column {name} holds something else", expected=expected, got=got, where=group)
        if name in ("t", "t_us", "serve_us", "t_hit_us", "zero_us", "seed") and column.dtype.kind in "iu":
            _check_whole(name, column, group)


def _columns_of(group: str) -> Columns:
    parts = group.strip("/").split("/")
    if group in _EXACTLY:
        return _EXACTLY[group]
    if len(parts) == 2 and parts[0] in ("ground_truth", "readout"):
        return _PIXEL_TRUTH if parts[0] == "ground_truth" else _READOUT
    return _TRIGGERS if len(parts) == 3 and (parts[0], parts[2]) == ("cameras", "triggers") else {}


def _check_whole(name: str, column: NDArray, group: str) -> None:
    """Times are within ten years, and those of the rows themselves never decrease; a seed is not negative."""
    largest = 2**63 - 1 if name == "seed" else 315_576_000 * 1_000_000
    smallest = 0 if name == "seed" else -largest
    if len(column) and not smallest <= int(column.min()) <= int(column.max()) <= largest:
        got = f"{column.min()} to {column.max()}"
        raise RecordingError(
            f"column {name} is out of range", expected=f"{smallest} to {largest}", got=got, where=group
        )
    if name in ("t", "t_us") and bool(np.any(column[1:] < column[:-1])):
        raise RecordingError(f"column {name} runs backwards", expected="times that never decrease", where=group)
