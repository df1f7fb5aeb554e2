"""Where the labels of a recording are in a folder of labels, and whose they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from core.errors import LabelError
from core.files import file_stem
from core.text import encodable

FILE: Final = "labels.sqlite"
JOURNAL: Final = ".jsonl"
BLIND_JOURNAL: Final = ".blind.jsonl"


@dataclass(frozen=True, slots=True)
class Layer:
    """Whose labels of what. With `t_us` it is the identity of a label."""

    recording_uuid: str
    camera: str
    annotator: str
    blind: bool = False
    """The annotator's second look, made without seeing the first: it measures the annotator's own noise."""

    def __post_init__(self) -> None:
        for what, name in (("camera", self.camera), ("annotator", self.annotator)):
            if encodable(name) != name:
                raise LabelError(f"not a name of the {what}", expected="characters of Unicode", got=repr(name))

    def path(self, folder: Path) -> Path:
        """The store that it is in, together with all others of the recording."""
        return store_path(folder, self.recording_uuid)

    def journal(self, folder: Path) -> Path:
        """Where version 1 kept it."""
        suffix = BLIND_JOURNAL if self.blind else JOURNAL
        return folder / file_stem(self.recording_uuid) / file_stem(self.camera) / f"{file_stem(self.annotator)}{suffix}"


def store_path(folder: Path, recording_uuid: str) -> Path:
    """Where the store of a recording is or will be."""
    return folder / file_stem(recording_uuid) / FILE


def stores_in(folder: Path, recording_uuid: str | None = None) -> Iterator[Path]:
    """The stores that there are, of one recording or of all."""
    above = "*" if recording_uuid is None else file_stem(recording_uuid)
    return (path for path in sorted(folder.glob(f"{above}/{FILE}")) if path.is_file())


def journals_in(folder: Path, recording_uuid: str | None = None) -> Iterator[Layer]:
    """The layers that are still in journals of version 1."""
    above = "*" if recording_uuid is None else file_stem(recording_uuid)
    for path in sorted(folder.glob(f"{above}/*/*{JOURNAL}")):
        blind = path.name.endswith(BLIND_JOURNAL)
        stem = path.name.removesuffix(BLIND_JOURNAL if blind else JOURNAL)
        yield Layer(unquote(path.parent.parent.name), unquote(path.parent.name), unquote(stem), blind)
