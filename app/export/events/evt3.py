"""Prophesee RAW with EVT3 words, a file per camera, as the vendor's tools read them.

Single events only (no vectors): see `core/recordings/evt3_encoder.py`.
"""

from __future__ import annotations

from pathlib import Path

from app.export.events.event_slices import check_cameras, event_slices, share_of
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, unfinished_folder
from core.errors import CommandError
from core.recordings import CameraStream, Recording
from core.recordings.evt3_encoder import LARGEST_PX, Evt3Encoder, evt3_header


def export_evt3(
    recording: Recording,
    folder: Path,
    span: Span,
    *,
    overwrite: bool = False,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> tuple[Path, ...]:
    """Write `<camera>.raw` for every camera; times count from the span's start.

    Raises:
        CommandError: if a file exists, cannot be written, or a sensor is too large.
        ExportCancelledError: if `cancelled()` is true; nothing is written then.
    """
    names = check_cameras(recording)
    for name in names:
        sensor = recording.cameras[name].sensor
        if max(sensor.width_px, sensor.height_px) > LARGEST_PX:
            raise CommandError("too large a sensor for EVT3", expected=f"up to {LARGEST_PX}", got=sensor, where=name)
    with unfinished_folder(folder, [f"{name}.raw" for name in names], overwrite=overwrite) as unfinished:
        for number, name in enumerate(names):
            share = share_of(number, len(names), progress)
            _write_camera(recording.cameras[name], unfinished / f"{name}.raw", span, share, cancelled)
    return tuple(folder / f"{name}.raw" for name in names)


def _write_camera(stream: CameraStream, path: Path, span: Span, progress: Progress, cancelled: Cancelled) -> None:
    encoder = Evt3Encoder()
    with path.open("wb") as file:
        file.write(evt3_header(stream.sensor))
        for events in event_slices(stream, span, progress, cancelled):
            file.write(encoder.encode(events).astype("<u2").tobytes())
