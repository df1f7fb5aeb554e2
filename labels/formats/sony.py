"""The label files of Sony's rallies: seq_<NNN>_<name>_label.h5 beside the events, one label a millisecond.

/points (M, 2), /radius (M,), /velocities (M, 2) in px/s, /timestamps in s on the clock of the reference, /points_orig
and /radius_orig before smoothing. Label k belongs to the events of millisecond k after t0, which the events file beside
it tells; which instant within it is not said: it is taken for the middle. The authors warn that labels may be shifted
against the events. What these columns cannot hold is in our own group /labels, which other readers pass over.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError, RecordingError
from core.files import file_stem, replacing
from core.recordings.hdf5 import HDF5_ERRORS, dataset_at, has_item, read_whole
from core.recordings.sources.sony_rallies import INSTANT_US, LABEL_SUFFIX, read_t0_us
from labels.formats.exchange import (
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
)
from labels.formats.recording_group import read_labels, write_group
from labels.model import LabelState

LATEST_US: Final = 7_200_000_000
"""A row for every millisecond has to fit into memory."""
_MS: Final = 1000


def write_sony(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`<camera>/seq_000_rally_label.h5`: a row for each millisecond up to the last label; without a ball it is nan.

    Raises:
        LabelError: if it cannot be written.
    """
    seen = [label for label in labels.labels if label.state.seen and label.x_px is not None]
    shown = [label for label in seen if label.t_us < LATEST_US]
    count = 1 + max((label.t_us // _MS for label in shown), default=-1)
    points, radius = np.full((count, 2), np.nan), np.full(count, np.nan)
    seconds = (np.arange(count) * _MS + INSTANT_US) / 1e6
    for label in shown:
        row = label.t_us // _MS
        points[row] = label.x_px, label.y_px
        radius[row] = np.nan if label.r_px is None else label.r_px
        seconds[row] = label.t_us / 1e6
    path = folder / file_stem(labels.camera) / f"seq_000_rally{LABEL_SUFFIX}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path, durable=True) as partial, h5py.File(partial, "w") as file:
            # The format has positions before and after its smoothing; ours are not smoothed.
            for name, values in (("points", points), ("points_orig", points)):
                file[name] = values
            for name, values in (("radius", radius), ("radius_orig", radius), ("timestamps", seconds)):
                file[name] = values
            file["velocities"] = _velocities(points, seconds)
            write_group(file, labels, path)
    except OSError as error:
        raise LabelError("cannot write the labels", got=error.strerror or error, where=path) from error
    late = len(seen) - len(shown)
    losses = (f"{late} x later than two hours: no row of its millisecond, only in our own group",) if late else ()
    return Exported((path,), losses)


def _velocities(points: NDArray[np.float64], seconds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Finite differences, px/s; nan beside a gap."""
    if len(points) < 2:
        return np.full_like(points, np.nan)
    return np.gradient(points, seconds, axis=0)


def read_sony(path: Path, context: ImportContext) -> Imported:
    """The labels of a file, or of the only label file of the camera in a folder; rejections count rows from 1."""
    collector = Collector()
    file = _label_file(path, context, collector)
    if file is not None:
        try:
            _read_file(file, context, collector)
        except (*HDF5_ERRORS, RecordingError) as error:
            collector.reject(file, 1, f"not a readable label file: {error}")
    return collector.done()


def _label_file(path: Path, context: ImportContext, collector: Collector) -> Path | None:
    """The file itself, or in a folder the one of this camera whose rally is that of the recording, by its t0."""
    if path.is_file():
        return path
    files = sorted({file for depth in ("*", "*/*", "*/*/*") for file in path.glob(depth + LABEL_SUFFIX)})
    own = file_stem(context.camera)
    files = [file for file in files if file.parent.name == own] or files
    if len(files) > 1 and context.camera:
        files = [file for file in files if _is_of_recording(file, context)] or files
    if len(files) != 1:
        collector.reject(path, 1, f"{len(files)} label files (*{LABEL_SUFFIX}) here, not one; give the file itself")
        return None
    return files[0]


def _is_of_recording(file: Path, context: ImportContext) -> bool:
    """Whether the rally beside a label file begins during the recording."""
    try:
        start_us = read_t0_us(events_file_of(file)) - context.clock_us
    except RecordingError:
        return False
    return 0 <= start_us <= (context.end_us or 0)


def events_file_of(labels: Path) -> Path:
    """The file of the events that labels are of."""
    return labels.with_name(labels.name.removesuffix(LABEL_SUFFIX) + ".h5")


def _read_file(path: Path, context: ImportContext, collector: Collector) -> None:
    with h5py.File(path, "r") as file:
        collector.files += 1
        if has_item(file, "labels"):  # our own, with every field
            read_labels(file, path, context, collector)
            return
        points, radius = (read_whole(dataset_at(file, name)) for name in ("points", "radius"))
    if points.ndim != 2 or points.shape[1] != 2 or len(radius) != len(points):
        collector.reject(path, 1, f"points {points.shape} and radius {radius.shape} do not fit together")
        return
    start_us = _start_us(path, context, collector)
    if start_us is None:
        return
    for row, ((x, y), r) in enumerate(zip(points.tolist(), radius.tolist(), strict=True)):
        if np.isnan(x) and np.isnan(y):
            continue  # a millisecond without a label
        with collector.entry(path, row + 1):
            inside = 0 <= x < context.sensor.width_px and 0 <= y < context.sensor.height_px
            state = LabelState.VISIBLE if inside else LabelState.OUT_OF_FRAME
            known = None if np.isnan(r) else r
            collector.add(context.make(start_us + row * _MS + INSTANT_US, state, x, y, known), path, row + 1)


def _start_us(path: Path, context: ImportContext, collector: Collector) -> int | None:
    """The recording's time of t0: 0 of the events file beside the labels, on the recording's clock."""
    events = events_file_of(path)
    if not events.is_file():
        if context.clock_us:
            collector.reject(path, 1, f"the events file {events.name}, which tells t0, is not beside it")
            return None
        return 0
    try:
        return read_t0_us(events) - context.clock_us
    except RecordingError as error:
        collector.reject(path, 1, error)
        return None
