"""Labels as files of another tool, with their pictures: for the command line and for the app."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2

from app.export.unfinished import Cancelled, Progress, check_cancelled, unfinished_file
from app.modes.label.sources import LabelSource
from core.errors import CommandError, LabelError
from labels.formats import FORMATS, ExportOptions, LabelSet
from labels.formats.exchange import picture_name, write_bytes
from labels.formats.pictures import write_pictures
from labels.model import Label
from labels.store_contents import copy_store

PICTURES_SHARE: Final = 0.7
"""Of the time, where there are pictures; the rest is packing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelFilesRequest:
    """What is to be written."""

    format: str
    """A name in `labels.formats.FORMATS`."""
    recording_uuid: str
    annotator: str
    source: LabelSource
    labels: tuple[Label, ...]
    """By time."""
    frames_us: tuple[int, ...] | None = None
    """Every picture of the clip, for formats that have a row for each; None: the labelled ones."""
    pictures: bool = False
    window_us: int = 2000
    """Of a picture of events, where a label does not know its own."""
    options: ExportOptions = field(default_factory=ExportOptions)


@dataclass(frozen=True, slots=True)
class LabelFiles:
    """What was written, and what the format could not hold: a line for each kind of loss."""

    labels: int
    files: tuple[Path, ...]
    pictures: tuple[Path, ...]
    losses: tuple[str, ...]


def write_label_files(
    request: LabelFilesRequest, out: Path, progress: Callable[[float], None] = lambda share: None
) -> LabelFiles:
    """Write them into a folder (for `hdf5` into a file).

    Raises:
        CommandError: if pictures are asked of a format without any.
        LabelError: if they cannot be written, or the format cannot hold them.
    """
    kind, source, labels = FORMATS[request.format], request.source, request.labels
    if request.pictures and not kind.pictures:
        raise CommandError(f"{kind.name} has no pictures", where="--pictures")
    frames_us = request.frames_us if source.frames_us is None else tuple(source.frames_us.tolist())
    of_set = LabelSet(request.recording_uuid, source.name, request.annotator, source.size, labels, frames_us)
    written = kind.write(of_set, out, request.options)
    pictures: tuple[Path, ...] = ()
    if request.pictures and source.stream is not None:
        pictures = write_pictures(source.stream, labels, out, window_us=request.window_us, progress=progress)
    elif request.pictures:
        pictures = write_frames(source, labels, out, progress)
    return LabelFiles(len(labels), written.files, pictures, written.losses)


def zip_label_files(request: LabelFilesRequest, path: Path, progress: Progress, cancelled: Cancelled) -> LabelFiles:
    """Write them into one ZIP file, which appears when it is complete.

    Raises:
        CommandError: if it exists already, or cannot be written.
        LabelError: if there are no labels, or the format cannot hold them.
        ExportCancelledError: if `cancelled()` is true; there is no file then.
    """
    if not request.labels:
        remedy = "label something first, or choose another annotator or camera"
        raise LabelError("no labels to export", got=f"camera {request.source.name}, {request.annotator}", remedy=remedy)

    def drawn(share: float) -> None:
        check_cancelled(cancelled)
        progress(PICTURES_SHARE * share)

    with (
        unfinished_file(path, overwrite=False) as unfinished,
        tempfile.TemporaryDirectory(dir=unfinished.parent) as folder,
    ):
        root = Path(folder) / path.stem
        made = write_label_files(request, root, drawn)
        files = sorted(file for file in root.rglob("*") if file.is_file())
        with zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED) as archive:
            for number, file in enumerate(files, start=1):
                check_cancelled(cancelled)
                archive.write(file, file.relative_to(root.parent))
                progress(PICTURES_SHARE + (1 - PICTURES_SHARE) * number / len(files))
    return made


def copy_label_store(folder: Path, recording_uuid: str, path: Path) -> LabelFiles:
    """Write the label store of a recording as one file: every camera and annotator, with all changes.

    Raises:
        CommandError: if the file exists already, or cannot be written.
        LabelError: if there are no labels, or they cannot be read.
    """
    with unfinished_file(path, overwrite=False) as unfinished:
        count = copy_store(folder, recording_uuid, unfinished)
    return LabelFiles(count, (path,), (), ())


def write_frames(
    source: LabelSource, labels: tuple[Label, ...], folder: Path, progress: Callable[[float], None]
) -> tuple[Path, ...]:
    """The frame under each label as a PNG."""
    files = []
    for number, label in enumerate(labels):
        frame = source.frame_at(label.t_us)
        assert frame is not None
        image = source.frame(frame)
        fine, content = cv2.imencode(".png", image if image.ndim == 2 else image[:, :, ::-1])
        assert fine
        files.append(write_bytes(folder / f"{picture_name(source.name, label.t_us)}.png", content.tobytes()))
        progress((number + 1) / len(labels))
    return tuple(files)
