"""Formats of events: everything in a recording as plain tables, DSEC's layout, and Prophesee RAW.

DSEC: an HDF5 file per camera, /events/{x, y, p, t}, /ms_to_idx, /t_offset, after the format description of the DSEC
data set (Gehrig et al. 2021). Packed with gzip instead of DSEC's blosc, so that plain h5py reads it; the sensor's size,
which DSEC does not state, is in the attributes width and height. Prophesee RAW: EVT3 words, a file per camera, as the
vendor's tools read them; single events only (no vectors), see `core/recordings/evt3_encoder.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from app.export.selection import Span
from app.export.task import ExportTask
from app.export.unfinished import Cancelled, Progress, check_cancelled, unfinished_folder
from core.errors import CommandError
from core.events import Events
from core.recordings import CameraStream, Recording
from core.recordings.evt3_encoder import LARGEST_PX, Evt3Encoder, evt3_header
from core.recordings.layout import BALL_GROUP, Rows, truth_group

if TYPE_CHECKING:
    import pyarrow as pa

SLICE_US: Final = 100_000


def event_slices(stream: CameraStream, span: Span, progress: Progress, cancelled: Cancelled) -> Iterator[Events]:
    """Yield events slice by slice; times count from the start of the span."""
    for start in range(span.start_us, span.end_us, SLICE_US):
        check_cancelled(cancelled)
        events = stream.slice(start, min(start + SLICE_US, span.end_us))
        yield Events.from_columns(events.t_us - span.start_us, events.x_px, events.y_px, events.on, events.sensor)
        progress(min(1.0, (start + SLICE_US - span.start_us) / span.length_us))


def share_of(number: int, count: int, progress: Progress) -> Progress:
    """Progress function of part `number` of `count` equal parts."""
    return lambda share: progress((number + share) / count)


def check_cameras(recording: Recording) -> list[str]:
    """Names of the recording's event cameras.

    Raises:
        CommandError: if there is none.
    """
    if not recording.cameras:
        raise CommandError("the recording has no event camera")
    return list(recording.cameras)


Columns = dict[str, NDArray]
EXTRA_GROUPS: Final = {
    "/racket": "t_us",
    "/racket_targets": "t_us",
    "/predictions": "t_us",
    "/hit_choices": "t_us",
    "/episodes": "serve_us",
}
"""Groups of the chain and the names of their time columns."""


def export_csv(task: ExportTask) -> tuple[Path, ...]:
    """Write `<camera>.csv` (t_us,x_px,y_px,on) for every camera, and a table for each other group that there is.

    Times are the recording's.
    """
    recording, span, folder = task.recording, task.span, task.path
    cameras = check_cameras(recording)
    tables = _tables(cameras, span, task.groups)
    names = [f"{name}.csv" for name in [*cameras, *tables]]
    with unfinished_folder(folder, names, overwrite=task.order.overwrite) as unfinished:
        for number, name in enumerate(cameras):
            progress = share_of(number, len(cameras), task.progress)
            slices = event_slices(recording.cameras[name], span, progress, task.cancelled)
            parts = (
                {
                    "t_us": one.t_us + span.start_us,
                    "x_px": one.x_px,
                    "y_px": one.y_px,
                    # 0 and 1, which every reader takes, not True and False.
                    "on": one.on.astype(np.uint8),
                }
                for one in slices
            )
            _write(unfinished / f"{name}.csv", parts)
        for name, columns in tables.items():
            _write(unfinished / f"{name}.csv", [columns])
    return tuple(folder / name for name in names)


def _tables(cameras: list[str], span: Span, groups: Callable[[str], Rows | None]) -> dict[str, Columns]:
    clocks = {BALL_GROUP: "t_us", **{truth_group(name): "t_us" for name in cameras}, **EXTRA_GROUPS}
    tables: dict[str, Columns] = {}
    for group, clock in clocks.items():
        rows = groups(group)
        if rows is not None:
            inside = (span.start_us <= rows[clock]) & (rows[clock] < span.end_us)
            ordered = {clock: rows[clock], **rows}
            tables[group.strip("/").replace("/", "_")] = dict(
                _flat((name, column[inside]) for name, column in ordered.items())
            )
    return tables


def _flat(columns: Iterable[tuple[str, NDArray]]) -> Iterator[tuple[str, NDArray]]:
    """A column for each component: p_world_m of three becomes p_world_m_0, p_world_m_1, p_world_m_2."""
    for name, column in columns:
        if column.ndim == 1:
            yield name, column.astype(np.uint8) if column.dtype == np.bool_ else column
            continue
        wide = column.reshape(len(column), int(np.prod(column.shape[1:])))
        for k in range(wide.shape[1]):
            yield f"{name}_{k}", wide[:, k]


def _write(path: Path, parts: Iterable[Columns]) -> None:
    import pyarrow as pa  # late, as all of pyarrow here: it may not be installed, and other formats need none
    from pyarrow import csv

    options = csv.WriteOptions(include_header=False, quoting_style="none")  # its header would have quotes
    with path.open("wb") as file:
        for number, columns in enumerate(parts):
            if number == 0:
                file.write((",".join(columns) + "\n").encode())
            csv.write_csv(pa.table({name: _arrow(column) for name, column in columns.items()}), file, options)


def _arrow(column: NDArray) -> pa.Array:
    import pyarrow as pa

    if column.dtype.kind == "S":
        return pa.array([text.decode(errors="replace").replace(",", " ") for text in column.tolist()], pa.string())
    return pa.array(np.ascontiguousarray(column))


CHUNK_EVENTS: Final = 1 << 16
COLUMNS: Final = {"x": np.uint16, "y": np.uint16, "p": np.uint8, "t": np.uint32}


def export_dsec(task: ExportTask) -> tuple[Path, ...]:
    """Write `<camera>.h5` for every camera. t counts from the span's start, t_offset is where that is.

    Raises:
        CommandError: if the span is too long for 32 bits.
    """
    if task.span.length_us >= 2**32:
        raise CommandError("too long for DSEC's 32-bit times", expected="under 71 minutes", remedy="give --end-us")
    return _write_cameras(task, ".h5", _write_dsec)


def _write_dsec(stream: CameraStream, path: Path, span: Span, progress: Progress, cancelled: Cancelled) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("events")
        for item in (file, group):
            item.attrs["width"], item.attrs["height"] = stream.sensor.width_px, stream.sensor.height_px
        sets = {
            name: group.create_dataset(
                name, (0,), dtype, maxshape=(None,), chunks=(CHUNK_EVENTS,), compression="gzip", compression_opts=1,
                shuffle=True,
            )
            for name, dtype in COLUMNS.items()
        }  # fmt: skip
        counts = np.zeros(-(-span.length_us // 1000), np.int64)
        for events in event_slices(stream, span, progress, cancelled):
            columns = {"x": events.x_px, "y": events.y_px, "p": events.on, "t": events.t_us}
            for name, column in columns.items():
                dataset, start = sets[name], len(sets[name])
                dataset.resize((start + len(events),))
                dataset[start:] = column.astype(COLUMNS[name])
            counts += np.bincount(events.t_us // 1000, minlength=len(counts))
        file["ms_to_idx"] = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.uint64)
        file["t_offset"] = np.int64(span.start_us)


def export_evt3(task: ExportTask) -> tuple[Path, ...]:
    """Write `<camera>.raw` for every camera; times count from the span's start.

    Raises:
        CommandError: if a sensor is too large.
    """
    check_evt3_sensors(task.recording)
    return _write_cameras(task, ".raw", _write_evt3)


def check_evt3_sensors(recording: Recording) -> None:
    """Raise CommandError where the recording has no camera, or one that is too large for EVT3."""
    for name in check_cameras(recording):
        sensor = recording.cameras[name].sensor
        if max(sensor.width_px, sensor.height_px) > LARGEST_PX:
            raise CommandError("too large a sensor for EVT3", expected=f"up to {LARGEST_PX}", got=sensor, where=name)


def _write_evt3(stream: CameraStream, path: Path, span: Span, progress: Progress, cancelled: Cancelled) -> None:
    encoder = Evt3Encoder()
    with path.open("wb") as file:
        file.write(evt3_header(stream.sensor))
        for events in event_slices(stream, span, progress, cancelled):
            file.write(encoder.encode(events).astype("<u2").tobytes())


def _write_cameras(
    task: ExportTask, ending: str, write: Callable[[CameraStream, Path, Span, Progress, Cancelled], None]
) -> tuple[Path, ...]:
    """Write a file for every camera, named after it; none of them appears before all are written."""
    names, folder = check_cameras(task.recording), task.path
    with unfinished_folder(folder, [f"{name}{ending}" for name in names], overwrite=task.order.overwrite) as unfinished:
        for number, name in enumerate(names):
            share = share_of(number, len(names), task.progress)
            write(task.recording.cameras[name], unfinished / f"{name}{ending}", task.span, share, task.cancelled)
    return tuple(folder / f"{name}{ending}" for name in names)
