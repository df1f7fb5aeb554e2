"""Sony's public rallies of table tennis: a file of events per rally and camera, on one clock through t0.

h5/<camera>/seq_<NNN>_<name>.h5 with /events/{x, y, p, t} (t in us after t0), /t0, /ms_to_idx; _label.h5 beside it. The
size of the sensor is in no attribute: it comes from the calibration beside the folders (a .yaml of the cameras' names
with resolution, camera_matrix, distortion_coeffs, T_CW), or has to be given. The table's frame, T_WO, is the world.

The 3D reference is metadata/<camera>/seq_*.csv above the events, a row for each millisecond: pos_{x,y,z}_label in m and
vel_{x,y,z}_label in m/s. `timestamps` in s count on the clock of the reference, so row k is taken for millisecond k
after t0, like the labels. In which frame the positions are is not said: they are projected and compared with the labels
beside the events, which were made from them.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import h5py
import numpy as np
import yaml
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.calibration_values import CalibrationNode
from core.cameras.lens_names import find_lens
from core.cameras.plausible import check_lenses
from core.errors import CalibrationError, EventsError, RecordingError
from core.events import SensorSize
from core.geometry import invert_transform
from core.recordings.hdf5 import dataset_at, group_at, read_whole
from core.recordings.sources.hdf5_reading import read_in_parts
from core.recordings.sources.making import make_table_source
from core.recordings.sources.source import DecodeReport, EventSource, FactOrigin, RawColumns
from core.recordings.truth import BallTruth

LABEL_SUFFIX: Final = "_label.h5"
INSTANT_US: Final = 500
"""Instant of a row, and of a label, within its millisecond."""
FOLDER: Final = "metadata"
UP: Final = 4
"""Folders above the events in which that one may lie."""
NEAR_PX: Final = 3.0
"""Median distance from the labels that were made from the reference."""
LEAST_ROWS: Final = 5
ROW_S: Final = 0.001
LARGEST_BYTES: Final = 1 << 28
_LABEL_COLUMNS: Final = tuple(f"{kind}_{axis}_label" for kind in ("pos", "vel") for axis in "xyz")
Move = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Positions (N, 3) of one frame in the world of the recording."""
_BROKEN_REFERENCE: Final = (
    OSError,
    KeyError,
    ValueError,
    TypeError,
    IndexError,
    RuntimeError,
    csv.Error,
    RecordingError,
)


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
    except _BROKEN_REFERENCE as error:
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
    # The file does not say its frame: the one whose projection lies on the labels is taken.
    distances = {frame: _distance_px(camera, move(p), points) for frame, move in frames.items()}
    best = min(distances, key=lambda frame: distances[frame])
    if not distances[best] <= NEAR_PX:
        notes.append(f"{where} is left out: in no frame it fits the labels beside the events.")
        return None
    origin = frames[best](np.zeros((1, 3)))
    rows = np.flatnonzero(np.isfinite(p).all(axis=1))
    t_us = t0_us + rows.astype(np.int64) * 1000 + INSTANT_US
    moved = frames[best](p[rows])
    # A velocity turns with the frame, but does not move with its origin.
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
    wanted = ("timestamps", *_LABEL_COLUMNS)
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


_COLUMNS: Final = ("t", "x", "y", "p")
_LARGEST_YAML: Final = 1 << 20
_UP: Final = 3
"""Folders above the file in which the calibration may lie: <camera>, h5, and that of the capture."""
_BROKEN: Final = (OSError, yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError, RecursionError)


def is_sony_file(file: h5py.File) -> bool:
    """Whether an HDF5 file has Sony's layout of events."""
    return "t0" in file and all(f"events/{name}" in file for name in _COLUMNS)


def is_sony_folder(path: Path) -> bool:
    """Whether a folder holds rallies of one camera, or folders of cameras that do."""
    return any(_is_rally(file) for file in _candidates(path))


def open_sony_file(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """One camera of a rally.

    Raises:
        RecordingError: if the size of the sensor is not known, or the columns do not fit together.
    """
    return [_open_camera(path, _camera_name(path), sensor)]


def open_sony_folder(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """Every camera of the only rally in the folder.

    Raises:
        RecordingError: if there are several rallies, or one cannot be read.
    """
    files = [file for file in _candidates(path) if _is_rally(file)]
    rallies = sorted({file.name for file in files})
    if len(rallies) != 1:
        shown = ", ".join(rallies[:4]) + (", ..." if len(rallies) > 4 else "")
        remedy = "name one by the files of its cameras: import evs1/SEQ.h5 [evs2/SEQ.h5] REC.h5"
        raise RecordingError("several rallies", got=f"{len(rallies)}: {shown}", where=path, remedy=remedy)
    return [_open_camera(file, file.parent.name, sensor) for file in files]


def read_t0_us(path: Path) -> int:
    """The time of a rally's events that counts as 0, on the clock of all cameras.

    Raises:
        RecordingError: if the file is no rally.
    """
    try:
        with h5py.File(path, "r") as file:
            return int(np.asarray(dataset_at(file, "t0")[()]).reshape(-1)[0])
    except (OSError, KeyError, ValueError, IndexError, RecordingError) as error:
        raise RecordingError("not the events of a rally", got=error, where=path) from error


def _candidates(path: Path) -> list[Path]:
    found = [*path.glob("*.h5"), *path.glob("*/*.h5")]
    return sorted(file for file in found if file.is_file() and not file.name.endswith(LABEL_SUFFIX))


def _is_rally(path: Path) -> bool:
    with suppress(OSError, KeyError, ValueError, RuntimeError), h5py.File(path, "r") as file:
        return is_sony_file(file)
    return False


def _camera_name(path: Path) -> str:
    """The folder of the file, where the calibration has a camera of that name."""
    return path.parent.name if _calibration(path, path.parent.name)[0] is not None else "camera"


def _open_camera(path: Path, name: str, sensor: SensorSize | None) -> EventSource:
    size, camera, remark = _calibration(path, name)
    # A calibration is for one picture size.
    if sensor is not None and sensor != size:
        size, camera = sensor, None
    if size is None:
        remedy = "give --width and --height, or put the calibration (.yaml) beside it"
        raise RecordingError("the file does not say how large the sensor is", where=path, remedy=remedy)
    with h5py.File(path, "r") as file:
        lengths = {column: len(dataset_at(group_at(file, "events"), column)) for column in _COLUMNS}
    if len(set(lengths.values())) != 1:
        raise RecordingError("event columns differ in length", expected="equal lengths", got=lengths, where=path)
    t0_us = read_t0_us(path)

    def rows(file: h5py.File, first: int, last: int) -> RawColumns:
        return RawColumns(*(dataset_at(group_at(file, "events"), column)[first:last] for column in _COLUMNS))

    source = make_table_source(
        path, name, "rally of Sony's", size, lambda report: read_in_parts(path, rows, lengths["t"], report),
        unit="us", unit_from=FactOrigin.FORMAT, sensor_from=FactOrigin.CALIBRATION, shift_us=t0_us,
        remarks=(remark,) if remark else (),
    )  # fmt: skip

    def reference(report: DecodeReport) -> BallTruth | None:
        return read_reference(path, name, camera, _world_frame(path, name), t0_us, report.notes)

    return replace(source, calibration=camera, reference=reference)


def _world_frame(path: Path, name: str) -> np.ndarray | None:
    """The pose T_WO of the table's frame in that of the calibration; None if the file has none."""
    tree, _ = _calibration_tree(path, name)
    with suppress(*_BROKEN):
        return _rigid(np.asarray(tree["T_WO"], np.float64))
    return None


def _calibration(path: Path, name: str) -> tuple[SensorSize | None, Camera | None, str | None]:
    """Size and lens of a camera from a .yaml beside or above its file, and a remark about it."""
    tree, file = _calibration_tree(path, name)
    return (None, None, None) if file is None else _camera(tree[name], tree.get("T_WO"), name, file)


def _calibration_tree(path: Path, name: str) -> tuple[dict, Path | None]:
    """The content of the nearest .yaml that has the camera, and where it is; empty if none has."""
    for folder in list(path.resolve().parents)[:_UP]:
        for file in sorted(folder.glob("*.yaml")):
            with suppress(*_BROKEN):
                if file.stat().st_size > _LARGEST_YAML:
                    continue
                tree = yaml.safe_load(file.read_text(encoding="utf-8"))
                if not isinstance(tree, dict):
                    continue
                entry = tree.get(name)
                if isinstance(entry, dict) and "camera_matrix" in entry and "resolution" in entry:
                    return tree, file
    return {}, None


def _camera(
    entry: dict[str, object], T_WO: object, name: str, file: Path
) -> tuple[SensorSize | None, Camera | None, str | None]:
    try:
        width, height = (int(side) for side in np.asarray(entry["resolution"], np.int64)[:2])
        size = SensorSize(width, height)
    except (*_BROKEN, EventsError):
        return None, None, None
    try:
        coefficients = np.asarray(entry["distortion_coeffs"], np.float64).reshape(-1)
        lens = find_lens(CalibrationNode(entry, name), coefficients, default="radtan")
        T_CW = np.asarray(entry["T_CW"], np.float64)
        T_camera_world = _rigid(T_CW) @ (_rigid(np.asarray(T_WO, np.float64)) if T_WO is not None else np.eye(4))
        K = np.asarray(entry["camera_matrix"], np.float64)
        camera = Camera(size, K, lens.distortion, invert_transform(T_camera_world), lens.model)
        check_lenses({name: camera}, file.name)
    except (*_BROKEN, CalibrationError) as error:
        return size, None, f"The calibration of {name} in {file.name} is left out: {error}."
    world = "the table's frame, T_WO" if T_WO is not None else "the frame W of its T_CW"
    return size, camera, f"Size and calibration are those of {name} in {file.name}; the world is {world}."


def _rigid(T: np.ndarray) -> np.ndarray:
    """The nearest rigid transform: files hold seven digits."""
    U, _, V = np.linalg.svd(T[:3, :3])
    R = U @ V
    if not np.allclose(R, T[:3, :3], atol=1e-3):
        raise ValueError("not a rigid transform")
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = R, T[:3, 3]
    return rigid
