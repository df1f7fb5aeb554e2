"""Sony's public rallies of table tennis: a file of events per rally and camera, on one clock through t0.

h5/<camera>/seq_<NNN>_<name>.h5 with /events/{x, y, p, t} (t in us after t0), /t0, /ms_to_idx; _label.h5 beside it. The
size of the sensor is in no attribute: it comes from the calibration beside the folders (a .yaml of the cameras' names
with resolution, camera_matrix, distortion_coeffs, T_CW), or has to be given. The table's frame, T_WO, is the world.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

import h5py
import numpy as np
import yaml

from core.cameras import Camera
from core.cameras.calibration_values import CalibrationNode
from core.cameras.lens_names import find_lens
from core.cameras.plausible import check_lenses
from core.errors import CalibrationError, EventsError, RecordingError
from core.events import SensorSize
from core.geometry import invert_transform
from core.recordings.hdf5 import dataset_at, group_at
from core.recordings.sources.checking import check_table
from core.recordings.sources.hdf5_data_sets import polarity_is_on
from core.recordings.sources.hdf5_reading import read_in_parts
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource
from core.recordings.sources.table_columns import addresses_from_column

LABEL_SUFFIX: Final = "_label.h5"
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
        remedy = "give the file of one camera, or a folder with the cameras of one rally"
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

    def rows(file: h5py.File, first: int, last: int) -> Columns:
        t, x, y, p = (dataset_at(group_at(file, "events"), column)[first:last] for column in _COLUMNS)
        on = polarity_is_on(np.asarray(p), where=f"{path}, /events/p")
        return Columns(np.asarray(t).astype(np.int64) + t0_us, addresses_from_column(x), addresses_from_column(y), on)

    def decode(report: DecodeReport) -> Iterator[Columns]:
        if remark:
            report.notes.append(remark)
        return read_in_parts(path, rows, lengths["t"], report)

    source = make_source(path, name, "rally of Sony's", size, decode, check_table)
    return EventSource(source.name, source.format, source.sensor, source.read, calibration=camera)


def _calibration(path: Path, name: str) -> tuple[SensorSize | None, Camera | None, str | None]:
    """Size and lens of a camera from a .yaml beside or above its file, and a remark about it."""
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
                    return _camera(entry, tree.get("T_WO"), name, file)
    return None, None, None


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
