"""HDF5 files of data sets and simulators whose events do not lie in a group called events.

/events (N, 4): t in us, x, y, polarity           v2e, or another order that the values tell; /frame (M, height,
                                                  width), if there, tells the size
/prophesee/{left, right}/{x, y, t, p}, calib/...  M3ED: t in us, ms_map_idx holds it against the time; calibrated
"""

from __future__ import annotations

import dataclasses
import importlib
from contextlib import suppress
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from core.cameras import Camera
from core.cameras.calibration_values import CalibrationNode
from core.cameras.lens_names import find_lens
from core.cameras.plausible import check_lenses
from core.errors import CalibrationError, RecordingError
from core.events import SensorSize
from core.recordings.hdf5 import dataset_at, group_at
from core.recordings.sources.hdf5_reading import UNREADABLE, explain, read_in_parts, unit_by_index
from core.recordings.sources.making import make_table_source
from core.recordings.sources.source import EventSource, RawColumns, Whence
from core.recordings.sources.values.stated_sizes import size_in_attributes
from core.recordings.sources.values.table_order import TableOrder, guess_columns
from core.recordings.sources.values.table_values import UNIT_NAMES

_COLUMNS: Final = ("t", "x", "y", "p")
_V2E_ORDER: Final = TableOrder({"t": 0, "x": 1, "y": 2, "p": 3}, seconds=False)
_SAMPLE_ROWS: Final = 10_000


def open_hdf5_data_set(path: Path, sensor: SensorSize | None) -> list[EventSource] | None:
    """The cameras of the file if it has one of these layouts, else None.

    Raises:
        RecordingError: if its columns do not fit together or its times have another unit.
    """
    with h5py.File(path, "r") as file:
        events = file.get("events")
        if isinstance(events, h5py.Dataset):
            return None if events.dtype.names else [_open_rows(path, file, sensor)]
        if "prophesee" in file and any(f"prophesee/{side}/t" in file for side in ("left", "right")):
            return _open_m3ed(path, group_at(file, "prophesee"), sensor)
    return None


def _open_rows(path: Path, file: h5py.File, sensor: SensorSize | None) -> EventSource:
    """The rows of /events, four numbers each: v2e's t, x, y, polarity unless the values say otherwise."""
    events = dataset_at(file, "events")
    upright = events.ndim == 2 and events.shape[0] == 4 != events.shape[1]
    if events.ndim != 2 or 4 not in events.shape or events.dtype.kind not in "iuf":
        got = f"{events.dtype}{events.shape}"
        raise RecordingError(
            "/events holds no rows of events", expected="numbers (N, 4): t, x, y, p", got=got, where=path
        )
    count = events.shape[1] if upright else len(events)
    frames = file.get("frame")
    if sensor is None and isinstance(frames, h5py.Dataset) and frames.ndim == 3:
        sensor = SensorSize(int(frames.shape[2]), int(frames.shape[1]))
    sensor = sensor or size_in_attributes(dict(events.attrs)) or size_in_attributes(dict(file.attrs))
    with suppress(ImportError):
        importlib.import_module("hdf5plugin")
    try:
        sample = events[:, :_SAMPLE_ROWS].T if upright else events[:_SAMPLE_ROWS]
        order = guess_columns(sample, where=f"{path}, /events")
    except RecordingError:  # a few rows, or times that do not tell: then it is as v2e writes it
        order = _V2E_ORDER
    except UNREADABLE as error:
        raise RecordingError("the events cannot be read", got=explain(error), where=path) from error
    places = order.places

    def rows(file: h5py.File, first: int, last: int) -> RawColumns:
        events = dataset_at(file, "events")
        part = events[:, first:last] if upright else np.asarray(events[first:last]).T
        return RawColumns(*(part[places[name]] for name in _COLUMNS))

    label = "v2e HDF5" if order.places == _V2E_ORDER.places else "HDF5 of rows"
    return make_table_source(
        path, "camera", label, sensor, lambda report: read_in_parts(path, rows, count, report),
        assumed=(f"{path.name}: the columns of /events are taken for {order.text}.",),
    )  # fmt: skip


def _open_m3ed(path: Path, cameras: h5py.Group, sensor: SensorSize | None) -> list[EventSource]:
    sources: list[EventSource] = []
    for side in ("left", "right"):
        if f"{side}/t" not in cameras:
            continue
        group = group_at(cameras, side)
        lengths = {name: len(dataset_at(group, name)) for name in ("t", "x", "y", "p")}
        if len(set(lengths.values())) != 1:
            raise RecordingError("event columns differ in length", expected="equal lengths", got=lengths, where=path)
        size = sensor or _m3ed_sensor(group)
        sources.append(
            _m3ed_source(path, side, size, lengths["t"], _unit_by_index(path, group), _m3ed_camera(path, group, size))
        )
    return sources


def _m3ed_source(
    path: Path, side: str, sensor: SensorSize | None, count: int, unit: str, camera: Camera | str | None
) -> EventSource:
    def rows(file: h5py.File, first: int, last: int) -> RawColumns:
        group = group_at(file, f"prophesee/{side}")
        return RawColumns(*(dataset_at(group, name)[first:last] for name in _COLUMNS))

    remarks = (camera,) if isinstance(camera, str) else ()
    if unit != "us":
        remarks += (f"{path.name}: the times of {side} count {UNIT_NAMES[unit]} by their index.",)
    source = make_table_source(
        path, side, "M3ED HDF5", sensor, lambda report: read_in_parts(path, rows, count, report),
        unit=unit, unit_from=Whence.FORMAT if unit == "us" else Whence.FILE,
        sensor_from=Whence.CALIBRATION, remarks=remarks,
    )  # fmt: skip
    return dataclasses.replace(source, calibration=camera) if isinstance(camera, Camera) else source


def _unit_by_index(path: Path, group: h5py.Group) -> str:
    """The unit of the times: `ms_map_idx[k]` is the first event of millisecond k.

    Raises:
        RecordingError: if no unit fits the index.
    """
    if "ms_map_idx" not in group:
        return "us"
    marks, t = dataset_at(group, "ms_map_idx"), dataset_at(group, "t")
    unit = unit_by_index(marks, t)
    if unit is not None:
        return unit
    last = len(marks) - 1
    got = f"{float(t[min(int(marks[last]), len(t) - 1)]):,.0f} at the index of millisecond {last:,}"
    raise RecordingError("the times of the events do not fit their index", got=got, where=f"{path}, {group.name}")


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
