"""The identity of an imported recording: the same sources imported the same way are the same recording.

Labels refer to a recording by its uuid, so one that is imported again, or opened without being imported, keeps them.
"""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Final

_NAMESPACE: Final = uuid.UUID("9b1d7f5e-6a43-4d0e-9f0b-3f5d4f1f6c11")
_SAMPLES: Final = 64
_SAMPLE_BYTES: Final = 64 << 10


def files_of(path: Path) -> list[Path]:
    """The files of a source, which may be a folder."""
    return [path] if not path.is_dir() else sorted(item for item in path.rglob("*") if item.is_file())


def source_uuid(paths: Sequence[Path], *choices: object) -> str:
    """From the size and 64 samples of each file, and from the choices that change what is made of them."""
    digest = hashlib.sha256(repr(choices).encode())
    for path in [file for source in paths for file in files_of(source)]:
        size = path.stat().st_size
        digest.update(size.to_bytes(8, "little"))
        with path.open("rb") as file:
            for number in range(_SAMPLES):
                file.seek(max(0, size - _SAMPLE_BYTES) * number // (_SAMPLES - 1))
                digest.update(file.read(_SAMPLE_BYTES))
                if size <= _SAMPLE_BYTES:
                    break
    return str(uuid.uuid5(_NAMESPACE, digest.hexdigest()))
