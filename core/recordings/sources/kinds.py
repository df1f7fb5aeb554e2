"""What a file seems to be, told from its first bytes without decoding it: for lists of files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import h5py

from core.recordings import layout
from core.recordings.log.growing import MAGIC
from core.recordings.sources.prophesee_header import read_prophesee_header
from core.recordings.sources.readers import HEAD_BYTES, recognised_by_plugin

RECORDING: Final = "Rallyscope recording"
_ZIP: Final = b"PK\x03\x04"
_HDF5: Final = b"\x89HDF\r\n\x1a\n"
_STARTS: Final = (
    (MAGIC, RECORDING),
    (b"#!AER-DAT4", "AEDAT4"),
    (b"Event Stream", "Event Stream"),
    (b"\x93NUMPY", "NumPy"),
    (b"#ROSBAG V", "ROS 1 bag"),
    (b"\x89MCAP0\r\n", "MCAP"),
)
_HDF5_ENDS: Final = (".h5", ".hdf5")


def kind_of(path: Path) -> str | None:
    """What an event file or a recording is called; None for anything else.

    Archives and text can hold anything, so of these the name has to say that it is events. Only opening a file tells
    whether it can really be read.
    """
    try:
        if not path.is_file():  # a pipe would never answer
            return None
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        kind = _kind_of(path, head)
        reader = recognised_by_plugin(path, head) if head and kind != RECORDING else None
        return kind if reader is None else reader.label
    except (OSError, RuntimeError, KeyError, ValueError):
        return None


def _kind_of(path: Path, head: bytes) -> str | None:
    for start, kind in _STARTS:
        if head.startswith(start):
            return kind
    if head.startswith(b"%"):
        return _prophesee_kind(path)
    if head.startswith(_HDF5):
        return _hdf5_kind(path)
    if head.startswith(b"SQLite format 3") and path.suffix.lower() == ".db3":
        return "ROS 2 bag"
    if head.startswith(_ZIP):
        return "NumPy" if path.suffix.lower() == ".npz" else None
    return "CSV" if head and path.suffix.lower() == ".csv" and b"\x00" not in head else None


def _prophesee_kind(path: Path) -> str | None:
    header = read_prophesee_header(path)
    if header.is_dat:
        return "Prophesee DAT"
    if header.version is not None:
        return f"Prophesee {header.version}"
    return None if header.sensor is None else "Prophesee RAW"


def _hdf5_kind(path: Path) -> str | None:
    with h5py.File(path, "r") as file:
        if file.attrs.get("format") == layout.FORMAT:
            return RECORDING
        if "CD/events" in file:
            return "Metavision HDF5"
    return "HDF5" if path.suffix.lower() in _HDF5_ENDS else None
