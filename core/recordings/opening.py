"""Opens whatever is a recording: ours, one whose writer was killed, or an event file of any other format."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import h5py

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import layout
from core.recordings.hdf5 import HDF5_ERRORS
from core.recordings.import_feeds import ImportOrder
from core.recordings.importing import import_recording
from core.recordings.log.assemble import assemble
from core.recordings.log.growing import is_growing
from core.recordings.reader import FileRecording
from core.recordings.sources.piped_sources import is_pipe


def open_recording(
    path: Path | str, *, sensor: SensorSize | None = None, progress: Callable[[float], None] = lambda share: None
) -> FileRecording:
    """The recording in a file, recognised by content.

    A recording whose writer was killed is finished first. A foreign file is decoded once, into a temporary recording
    that goes when this one is closed; `sensor` overrides what it says of its size, `progress` follows the decoding.

    Raises:
        RecordingError: if it cannot be read.
    """
    path = Path(path)
    if not path.is_file() and not path.is_dir() and not is_pipe(path):
        raise RecordingError("no such file", where=path)
    try:
        if path.is_file() and is_growing(path):
            return _open_abandoned(path)
        if is_recording(path):
            return FileRecording(path)
    except OSError as error:
        raise RecordingError("the recording cannot be read", got=error, where=path) from error
    folder = tempfile.TemporaryDirectory(prefix="rallyscope-")
    try:
        decoded = Path(folder.name) / "decoded.h5"
        import_recording(ImportOrder([path], sensor=sensor), decoded, progress=progress)
        return FileRecording(decoded, on_close=folder.cleanup)
    # Ctrl-C, too, leaves no temporary folder.
    except BaseException:
        folder.cleanup()
        raise


def is_recording(path: Path) -> bool:
    """Whether it is a finished recording of ours."""
    if not path.is_file() or not h5py.is_hdf5(path):
        return False
    try:
        with h5py.File(path, "r") as file:
            stated = file.attrs.get("format")
            return isinstance(stated, str) and stated == layout.FORMAT
    except HDF5_ERRORS:
        return False


def _open_abandoned(path: Path) -> FileRecording:
    if os.access(path.parent, os.W_OK):
        assemble(path)
        return FileRecording(path)
    folder = tempfile.TemporaryDirectory(prefix="rallyscope-")
    try:
        finished = Path(folder.name) / "recovered.h5"
        assemble(path, destination=finished)
        return FileRecording(finished, on_close=folder.cleanup)
    except BaseException:
        folder.cleanup()
        raise
