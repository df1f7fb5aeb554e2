"""DSEC's layout, an HDF5 file per camera: /events/{x, y, p, t}, /ms_to_idx, /t_offset.

Source: the format description of the DSEC data set (Gehrig et al. 2021). Packed with gzip instead of DSEC's blosc, so
that plain h5py reads it; the sensor's size, which DSEC does not state, is in the attributes width and height.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import h5py
import numpy as np

from app.export.events.event_slices import check_cameras, event_slices, share_of
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, unfinished_folder
from core.errors import CommandError
from core.recordings import CameraStream, Recording

CHUNK_EVENTS: Final = 1 << 16
COLUMNS: Final = {"x": np.uint16, "y": np.uint16, "p": np.uint8, "t": np.uint32}


def export_dsec(
    recording: Recording,
    folder: Path,
    span: Span,
    *,
    overwrite: bool = False,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> tuple[Path, ...]:
    """Write `<camera>.h5` for every camera. t counts from the span's start, t_offset is where that is.

    Raises:
        CommandError: if a file exists, cannot be written, or the span is too long for 32 bits.
        ExportCancelledError: if `cancelled()` is true; nothing is written then.
    """
    if span.length_us >= 2**32:
        raise CommandError("too long for DSEC's 32-bit times", expected="under 71 minutes", remedy="give --end-us")
    names = check_cameras(recording)
    with unfinished_folder(folder, [f"{name}.h5" for name in names], overwrite=overwrite) as unfinished:
        for number, name in enumerate(names):
            share = share_of(number, len(names), progress)
            _write_camera(recording.cameras[name], unfinished / f"{name}.h5", span, share, cancelled)
    return tuple(folder / f"{name}.h5" for name in names)


def _write_camera(stream: CameraStream, path: Path, span: Span, progress: Progress, cancelled: Cancelled) -> None:
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
