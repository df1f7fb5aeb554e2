"""What a file seems to be, told from its first bytes without decoding it: for lists of files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import h5py

from core.recordings import layout
from core.recordings.log.growing import MAGIC
from core.recordings.sources.prophesee_header import read_prophesee_header
from core.recordings.sources.readers import HEAD_BYTES, READERS, recognised

RECORDING: Final = "Rallyscope recording"
_HDF5: Final = b"\x89HDF\r\n\x1a\n"


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
        if head.startswith(MAGIC) or (head.startswith(_HDF5) and _is_recording(path)):
            return RECORDING
        reader = recognised(path, head) if head else None
        if reader is None or (reader.only_named and path.suffix.lower() not in reader.only_named):
            return None
        # The only format whose versions people know by name: what one of their cameras writes, another tool refuses.
        version = read_prophesee_header(path).version if reader is READERS.get("prophesee-raw") else None
        return reader.label if version is None else f"Prophesee {version}"
    except (OSError, RuntimeError, KeyError, ValueError):
        return None


def _is_recording(path: Path) -> bool:
    with h5py.File(path, "r") as file:
        return file.attrs.get("format") == layout.FORMAT
