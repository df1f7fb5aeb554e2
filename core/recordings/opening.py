"""Opens whatever is a recording."""

from __future__ import annotations

import tempfile
from pathlib import Path

import h5py

from core.errors import RecordingError
from core.recordings import layout
from core.recordings.assemble import assemble
from core.recordings.growing import is_growing
from core.recordings.reader import FileRecording
from core.recordings.recording import Recording


def open_recording(path: Path | str) -> Recording:
    """A recording of ours, one whose writer was killed.

    Raises:
        RecordingError: if it cannot be read.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError("no such file", where=path)
    if is_growing(path):
        return _open_abandoned(path)
    if _is_ours(path):
        return FileRecording(path)
    raise RecordingError("not a recording", where=path)


def _is_ours(path: Path) -> bool:
    if not h5py.is_hdf5(path):
        return False
    with h5py.File(path, "r") as file:
        return file.attrs.get("format") == layout.FORMAT


def _open_abandoned(path: Path) -> FileRecording:
    try:
        assemble(path)
        return FileRecording(path)
    except PermissionError:  # a read-only folder: finish it elsewhere
        folder = tempfile.TemporaryDirectory(prefix="rallyscope-")
        finished = Path(folder.name) / "recovered.h5"
        assemble(path, destination=finished)
        return FileRecording(finished, on_close=folder.cleanup)
