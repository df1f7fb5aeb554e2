"""M3ED: `rallyscope import falcon_data.h5 DST.h5 --plugin m3ed_reader.py`.

/prophesee/{left, right}/{x, y, t, p} in HDF5, t in us; ms_map_idx holds it against the time; calib/... calibrates. The
left camera is the world.
"""

import dataclasses
from pathlib import Path

import h5py
import numpy as np

from core.cameras import Camera
from core.cameras.calibration_values import CalibrationNode
from core.cameras.lens_names import find_lens
from core.cameras.plausible import check_lenses
from core.errors import CalibrationError, RecordingError
from core.events import SensorSize
from core.foreign_tables import UNIT_NAMES
from core.recordings.hdf5 import HDF5_ERRORS, dataset_at, group_at
from core.recordings.sources import EventSource, FactOrigin, RawColumns, make_table_source, register_reader
from core.recordings.sources.hdf5_reading import explain, read_in_parts, unit_by_index

COLUMNS = ("t", "x", "y", "p")
SIDES = ("left", "right")


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file is HDF5 with the events of such a camera."""
    if not h5py.is_hdf5(path):
        return False
    try:
        with h5py.File(path, "r") as file:
            return any(f"prophesee/{side}/t" in file for side in SIDES)
    except HDF5_ERRORS:
        return False


def opens(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The cameras of the file, with their calibration."""
    try:
        with h5py.File(path, "r") as file:
            cameras = group_at(file, "prophesee")
            return [open_side(path, side, group_at(cameras, side), sensor) for side in SIDES if f"{side}/t" in cameras]
    except HDF5_ERRORS as error:
        raise RecordingError("the HDF5 file cannot be read", got=explain(error), where=path) from error


def open_side(path: Path, side: str, group: h5py.Group, sensor: SensorSize | None) -> EventSource:
    """One camera of the file."""
    lengths = {name: len(dataset_at(group, name)) for name in COLUMNS}
    if len(set(lengths.values())) != 1:
        raise RecordingError("event columns differ in length", expected="equal lengths", got=lengths, where=path)
    size = sensor or stated_size(group)
    unit, camera = unit_of_times(path, group), camera_of(path, group, size)

    def rows(file: h5py.File, first: int, last: int) -> RawColumns:
        columns = group_at(file, f"prophesee/{side}")
        return RawColumns(*(dataset_at(columns, name)[first:last] for name in COLUMNS))

    remarks = (camera,) if isinstance(camera, str) else ()
    if unit != "us":
        remarks += (f"{path.name}: the times of {side} count {UNIT_NAMES[unit]} by their index.",)
    source = make_table_source(
        path, side, "M3ED HDF5", size, lambda report: read_in_parts(path, rows, lengths["t"], report),
        unit=unit, unit_from=FactOrigin.FORMAT if unit == "us" else FactOrigin.FILE,
        sensor_from=FactOrigin.CALIBRATION, remarks=remarks,
    )  # fmt: skip
    return dataclasses.replace(source, calibration=camera) if isinstance(camera, Camera) else source


def unit_of_times(path: Path, group: h5py.Group) -> str:
    """The unit of the times: `ms_map_idx[k]` is the first event of millisecond k."""
    if "ms_map_idx" not in group:
        return "us"
    marks, t = dataset_at(group, "ms_map_idx"), dataset_at(group, "t")
    unit = unit_by_index(marks, t)
    if unit is not None:
        return unit
    last = len(marks) - 1
    got = f"{float(t[min(int(marks[last]), len(t) - 1)]):,.0f} at the index of millisecond {last:,}"
    raise RecordingError("the times of the events do not fit their index", got=got, where=f"{path}, {group.name}")


def stated_size(group: h5py.Group) -> SensorSize | None:
    """The size of the sensor that the calibration states."""
    if "calib/resolution" not in group:
        return None
    width, height = (int(value) for value in np.asarray(dataset_at(group_at(group, "calib"), "resolution")[:2]))
    return SensorSize(width, height)


def camera_of(path: Path, group: h5py.Group, sensor: SensorSize | None) -> Camera | str | None:
    """The camera that `calib` describes, or why it cannot be used."""
    if "calib/intrinsics" not in group or sensor is None:
        return None
    calib = group_at(group, "calib")
    stated: dict[str, object] = {
        key: text for key in ("camera_model", "distortion_model") if (text := text_at(calib, key)) is not None
    }
    T = np.eye(4)
    try:
        fx, fy, cx, cy = (float(value) for value in np.asarray(dataset_at(calib, "intrinsics")[:4]))
        coefficients = np.zeros(0)
        if "distortion_coeffs" in calib:
            coefficients = np.asarray(dataset_at(calib, "distortion_coeffs")[()], np.float64).reshape(-1)
        if "T_to_prophesee_left" in calib:
            T = np.asarray(dataset_at(calib, "T_to_prophesee_left")[()], np.float64)
        lens = find_lens(CalibrationNode(stated, "calib"), coefficients, default="radtan")
        camera = Camera(sensor, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), lens.distortion, T, lens.model)
        check_lenses({"calib": camera}, path.name)
    except (CalibrationError, ValueError, TypeError) as error:
        return f"{path.name}: the calibration is left out: {error}."
    return camera


def text_at(group: h5py.Group, name: str) -> str | None:
    """A text in a group; None if there is none."""
    if name not in group:
        return None
    value = dataset_at(group, name)[()]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


register_reader("m3ed", recognises, opens, "M3ED", only_named=(".h5", ".hdf5"))
