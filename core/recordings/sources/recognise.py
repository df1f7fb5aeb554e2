"""Which format a file is, by its content; file names are not looked at."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import h5py

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.dat import open_dat
from core.recordings.sources.faery_formats import open_aedat4, open_es
from core.recordings.sources.hdf5_errors import explain
from core.recordings.sources.hdf5_tables import open_hdf5_table
from core.recordings.sources.metavision_hdf5 import open_metavision_hdf5
from core.recordings.sources.numpy_files import open_numpy
from core.recordings.sources.prophesee_header import read_prophesee_header
from core.recordings.sources.prophesee_raw import open_prophesee_raw
from core.recordings.sources.source import EventSource
from core.recordings.sources.text import open_text

FORMATS: Final = (
    "Prophesee RAW and DAT, AEDAT4, Event Stream, HDF5 (Metavision, DSEC, MVSEC and others), npz, npy or CSV"
)
_Opener = Callable[[Path, SensorSize | None], list[EventSource]]
_SIGNATURES: Final[tuple[tuple[bytes, _Opener], ...]] = (
    (b"#!AER-DAT4", open_aedat4),
    (b"Event Stream", open_es),
    (b"PK\x03\x04", open_numpy),
    (b"\x93NUMPY", open_numpy),
)


def open_sources(path: Path, sensor: SensorSize | None = None) -> list[EventSource]:
    """One source for each camera in an event file of any format but ours; `sensor` overrides what the file says.

    Raises:
        RecordingError: if the file is missing, empty, of no known format, or damaged at its very beginning.
    """
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise RecordingError("the file cannot be opened", got=error.strerror, where=path) from error
    if not head:
        raise RecordingError("the file is empty", where=path)
    for signature, opener in _SIGNATURES:
        if head.startswith(signature):
            return opener(path, sensor)
    if head.startswith(b"#!AER-DAT"):
        got = head.split(b"\n", 1)[0].decode("ascii", "replace").strip()
        raise RecordingError("an older AEDAT version", expected="AEDAT4", got=got, where=path)
    if head.startswith(b"%"):
        header = read_prophesee_header(path)
        if header.is_dat:
            return open_dat(path, sensor)
        if header.version is not None or header.sensor is not None:
            return open_prophesee_raw(path, sensor)
    if h5py.is_hdf5(path):
        return _open_hdf5(path, sensor)
    if _is_text(head) or (head.startswith((b"\xff\xfe", b"\xfe\xff")) and b"\x00" in head[:16]):
        return open_text(path, sensor)
    raise RecordingError("the format is not recognised", expected=FORMATS, where=path)


def _open_hdf5(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    try:
        with h5py.File(path, "r") as file:
            groups = ", ".join(map(str, file)) or "nothing"
            if "rallyscope" in str(file.attrs.get("format", "")):
                raise RecordingError("it is a recording already", where=path, remedy="open it as it is")
            metavision = "CD/events" in file
        found = open_metavision_hdf5(path, sensor) if metavision else open_hdf5_table(path, sensor)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise RecordingError("the HDF5 file cannot be read", got=explain(error), where=path) from error
    if found is None:
        raise RecordingError("no events in a layout that is known", got=f"an HDF5 file of {groups}", where=path)
    return found


def _is_text(head: bytes) -> bool:
    return all(byte >= 32 or byte in b"\t\r\n\f" for byte in head) and 127 not in head
