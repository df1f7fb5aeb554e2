"""HDF5 files of data sets and simulators whose events do not lie in a group called events.

/events (N, 4): t in us, x, y, polarity           v2e; /frame (M, height, width), if there, tells the size
/prophesee/{left, right}/{x, y, t, p}, calib/...  M3ED: t in us, ms_map_idx holds it against the time; calibrated
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.calibration_values import CalibrationNode
from core.cameras.lens_names import find_lens
from core.cameras.plausible import check_lenses
from core.errors import CalibrationError, RecordingError
from core.events import SensorSize
from core.recordings.hdf5 import dataset_at, group_at
from core.recordings.sources.checking import check_table
from core.recordings.sources.hdf5_reading import read_in_parts
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource
from core.recordings.sources.table_columns import addresses_from_column

_WRAPPED_OFF: Final = (255, 65_535, 2**32 - 1)
"""A polarity of -1 in an unsigned column."""
_INDEX_TOLERANCE: Final = 2.0
"""By this factor the time of an event may be off its place in the index before its unit is another one."""


def open_hdf5_data_set(path: Path, sensor: SensorSize | None) -> list[EventSource] | None:
    """The cameras of the file if it has one of these layouts, else None.

    Raises:
        RecordingError: if its columns do not fit together or its times have another unit.
    """
    with h5py.File(path, "r") as file:
        if isinstance(file.get("events"), h5py.Dataset):
            return [_open_v2e(path, file, sensor)]
        if "prophesee" in file and any(f"prophesee/{side}/t" in file for side in ("left", "right")):
            return _open_m3ed(path, group_at(file, "prophesee"), sensor)
    return None


def polarity_is_on(p: NDArray, *, where: str) -> NDArray[np.bool_]:
    """Which events are ON, from polarities of 0 and 1, of -1 and 1, or of 1 and a -1 that wrapped around.

    Raises:
        RecordingError: if there is any other value.
    """
    on = p == 1
    off = np.isin(p, (0, -1)) | (np.isin(p, _WRAPPED_OFF) if p.dtype.kind in "ui" else False)
    odd = p[~(on | off)]
    if len(odd):
        found = ", ".join(str(value) for value in np.unique(odd)[:5])
        raise RecordingError("polarities that are not known", expected="0 and 1, or -1 and 1", got=found, where=where)
    return on


def _open_v2e(path: Path, file: h5py.File, sensor: SensorSize | None) -> EventSource:
    events = dataset_at(file, "events")
    if events.ndim != 2 or events.shape[1] != 4 or events.dtype.kind not in "iu":
        got = f"{events.dtype}{events.shape}"
        raise RecordingError("/events is not v2e's", expected="whole numbers (N, 4): t, x, y, p", got=got, where=path)
    frames = file.get("frame")
    if sensor is None and isinstance(frames, h5py.Dataset) and frames.ndim == 3:
        sensor = SensorSize(int(frames.shape[2]), int(frames.shape[1]))

    def rows(file: h5py.File, first: int, last: int) -> Columns:
        t, x, y, p = np.asarray(dataset_at(file, "events")[first:last]).T
        on = polarity_is_on(p, where=f"{path}, /events")
        return Columns(t.astype(np.int64), addresses_from_column(x), addresses_from_column(y), on)

    def decode(report: DecodeReport) -> Iterator[Columns]:
        report.notes.append(f"{path.name}: the columns of /events are taken for v2e's: t in us, x, y, polarity.")
        return read_in_parts(path, rows, count, report)

    count = len(events)
    return make_source(path, "camera", "v2e HDF5", sensor, decode, check_table)


def _open_m3ed(path: Path, cameras: h5py.Group, sensor: SensorSize | None) -> list[EventSource]:
    sources: list[EventSource] = []
    for side in ("left", "right"):
        if f"{side}/t" not in cameras:
            continue
        group = group_at(cameras, side)
        lengths = {name: len(dataset_at(group, name)) for name in ("t", "x", "y", "p")}
        if len(set(lengths.values())) != 1:
            raise RecordingError("event columns differ in length", expected="equal lengths", got=lengths, where=path)
        _check_microseconds(path, group)
        size = sensor or _m3ed_sensor(group)
        sources.append(_m3ed_source(path, side, size, lengths["t"], _m3ed_camera(path, group, size)))
    return sources


def _m3ed_source(
    path: Path, side: str, sensor: SensorSize | None, count: int, camera: Camera | str | None
) -> EventSource:
    def rows(file: h5py.File, first: int, last: int) -> Columns:
        group = group_at(file, f"prophesee/{side}")
        t, x, y, p = (dataset_at(group, name)[first:last] for name in ("t", "x", "y", "p"))
        on = polarity_is_on(p, where=f"{path}, {side}")
        return Columns(np.asarray(t).astype(np.int64), addresses_from_column(x), addresses_from_column(y), on)

    def decode(report: DecodeReport) -> Iterator[Columns]:
        if isinstance(camera, str):
            report.notes.append(camera)
        return read_in_parts(path, rows, count, report)

    source = make_source(path, side, "M3ED HDF5", sensor, decode, check_table)
    return dataclasses.replace(source, calibration=camera) if isinstance(camera, Camera) else source


def _check_microseconds(path: Path, group: h5py.Group) -> None:
    """`ms_map_idx[k]` is the first event of millisecond k: so the times count microseconds, or something else."""
    if "ms_map_idx" not in group:
        return
    marks, t = dataset_at(group, "ms_map_idx"), dataset_at(group, "t")
    last = len(marks) - 1
    if last < 10 or not len(t):
        return
    at = min(int(marks[last]), len(t) - 1)
    ms = float(t[at]) / 1000
    if not last / _INDEX_TOLERANCE <= ms <= last * _INDEX_TOLERANCE:
        got = f"{ms:,.0f} ms at the index of millisecond {last:,}"
        where = f"{path}, {group.name}"
        raise RecordingError("the times of the events do not count microseconds", got=got, where=where)


def _m3ed_sensor(group: h5py.Group) -> SensorSize | None:
    if "calib/resolution" not in group:
        return None
    width, height = (int(value) for value in np.asarray(dataset_at(group_at(group, "calib"), "resolution")[:2]))
    return SensorSize(width, height)


def _m3ed_camera(path: Path, group: h5py.Group, sensor: SensorSize | None) -> Camera | str | None:
    """The camera that /calib tells, or why it cannot be used; the left camera is the world."""
    if "calib/intrinsics" not in group or sensor is None:
        return None
    calib = group_at(group, "calib")
    stated: dict[str, object] = {
        key: text for key in ("camera_model", "distortion_model") if (text := _text(calib, key)) is not None
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


def _text(group: h5py.Group, name: str) -> str | None:
    if name not in group:
        return None
    value = dataset_at(group, name)[()]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
