"""Labels as files of another tool: written with their pictures, for the command line and the app; and files in the
workspace: which there are, what would be taken of them, and pictures of that.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app import theme
from app.export.unfinished import Cancelled, Progress, check_cancelled, unfinished_file
from app.formatting import html_text, note_html, table_row
from app.modes.label.sources import LabelSource
from core.errors import CommandError, LabelError
from core.files import file_stem
from core.recordings import Recording
from labels.formats import FORMATS, ExportOptions, LabelSet
from labels.formats.exchange import Imported
from labels.formats.import_check import ImportChoices, import_context, import_labels
from labels.formats.import_report import ImportReport, describe_label, report_of
from labels.formats.picture_names import own_camera
from labels.formats.picture_times import FrameTimes, read_frame_times
from labels.formats.pictures import draw_events, write_pictures, write_pngs
from labels.model import ContactLabel, Label
from labels.store_contents import copy_store

PICTURES_SHARE: Final = 0.7
"""Share of the time that pictures take, where there are any; the rest is packing."""


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
    """Length of a picture of events, where a label does not know its own."""
    options: ExportOptions = field(default_factory=ExportOptions)
    contacts: tuple[ContactLabel, ...] = ()
    """Bounces, hits and net touches, by time."""


@dataclass(frozen=True, slots=True)
class LabelFiles:
    """What was written, and what the format could not hold: a line for each kind of loss."""

    labels: int
    files: tuple[Path, ...]
    pictures: tuple[Path, ...]
    losses: tuple[str, ...]
    contacts: int = 0
    earlier: tuple[Path, ...] = ()
    """Files of this camera that an earlier export has left there, and an import would read."""


def write_label_files(
    request: LabelFilesRequest, out: Path, progress: Callable[[float], None] = lambda share: None
) -> LabelFiles:
    """Write them into a folder (for `hdf5` into a file).

    Raises:
        CommandError: if pictures are asked of a format without any.
        LabelError: if they cannot be written, or the format cannot hold them.
    """
    kind, source, labels = FORMATS[request.format], request.source, request.labels
    before = _files_of_camera(out, source.name)
    if request.pictures and not kind.pictures:
        raise CommandError(f"{kind.name} has no pictures", where="--pictures")
    frames_us = request.frames_us if source.frames_us is None else tuple(source.frames_us.tolist())
    contacts = request.contacts if kind.contacts else ()
    of_set = LabelSet(request.recording_uuid, source.name, request.annotator, source.size, labels, frames_us, contacts)
    written = kind.write(of_set, out, request.options)
    lost = len(request.contacts) - len(contacts)
    losses = (*written.losses, *((f"{lost} x contact (bounce, hit, net)",) if lost else ()))
    pictures: tuple[Path, ...] = ()
    if request.pictures and source.stream is not None:
        pictures = write_pictures(source.stream, labels, out, window_us=request.window_us, progress=progress)
    elif request.pictures:
        pictures = write_frames(source, labels, out, progress)
    earlier = tuple(sorted(before - {*written.files, *pictures}))
    return LabelFiles(len(labels), written.files, pictures, losses, len(contacts), earlier)


def _files_of_camera(folder: Path, camera: str) -> set[Path]:
    """The files that are named for one label of a camera, or for its contacts."""
    contacts = f"{file_stem(camera)}.contacts.csv"
    files = folder.rglob("*") if folder.is_dir() else ()
    return {file for file in files if own_camera(file.stem) == camera or file.name == contacts}


def zip_label_files(request: LabelFilesRequest, path: Path, progress: Progress, cancelled: Cancelled) -> LabelFiles:
    """Write them into one ZIP file, which appears when it is complete.

    Raises:
        CommandError: if it exists already, or cannot be written.
        LabelError: if there are no labels, or the format cannot hold them.
        ExportCancelledError: if `cancelled()` is true; there is no file then.
    """
    if not request.labels and not request.contacts:
        remedy = "label something first, or choose another annotator or camera"
        raise LabelError("no labels to export", got=f"camera {request.source.name}, {request.annotator}", remedy=remedy)

    def drawn(share: float) -> None:
        check_cancelled(cancelled)
        progress(PICTURES_SHARE * share)

    with (
        unfinished_file(path, overwrite=False) as unfinished,
        # Beside the result: /tmp may be too small for pictures.
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

    def under(label: Label) -> NDArray[np.uint8]:
        frame = source.frame_at(label.t_us)
        assert frame is not None
        return source.frame(frame)

    return write_pngs(source.name, labels, under, folder, progress)


FOLDER: Final = "labels-to-import"
"""In the workspace: a file or a folder of each export."""
MAX_ENTRIES: Final = 200
SIDE_PX: Final = 260
"""Side of one picture of a label, on the screen."""
RADII: Final = 4.0
"""Radii of the ball from the middle of a picture to its edge."""
LEAST_PX: Final = 24
WINDOW_US: Final = 2000
BESIDE: Final = 40
"""Grey of what lies outside the sensor."""
RING: Final = (64, 255, 160)
"""A colour that no other thing in the window has."""
MAX_REJECTED: Final = 4
"""Examples of what was rejected."""
ONE_LINE: Final = "font-size:12.5px;padding:1px 8px 1px 0"


def files_to_import(workspace: Path) -> dict[str, Path]:
    """What lies in the folder for it, by name: files and folders, nothing hidden."""
    found: dict[str, Path] = {}
    try:
        with os.scandir(workspace / FOLDER) as entries:
            for entry in sorted(entries, key=lambda entry: entry.name):
                if not entry.name.startswith(".") and not entry.is_symlink() and len(found) < MAX_ENTRIES:
                    found[entry.name] = Path(entry.path)
    except OSError:  # there is none, or it may not be read
        return {}
    return found


@dataclass(frozen=True, slots=True, eq=False)
class ImportAsk:
    """What is to be looked at."""

    path: Path
    format: str
    times: Path | None
    """A table of the times of the pictures."""
    ball_class: str
    scale_pictures: bool
    empty_is_no_ball: bool
    recording: Recording
    source: LabelSource


@dataclass(frozen=True, slots=True, eq=False)
class ImportPreview:
    """What an import would take."""

    ask: ImportAsk
    found: Imported
    report: ImportReport
    picture: NDArray[np.uint8] | None
    """Three of the labels over their events, (height, width, 3); None if nothing would be taken."""


def preview_import(ask: ImportAsk) -> ImportPreview:
    """Read the files, without taking anything.

    Raises:
        LabelError: if the table of times cannot be read.
    """
    times = FrameTimes(ask.source.frames_us) if ask.times is None else read_frame_times(ask.times)
    choices = ImportChoices(
        times=times,
        ball_class=ask.ball_class.strip() or None,
        scale_pictures=ask.scale_pictures,
        empty_is_no_ball=ask.empty_is_no_ball,
    )
    context = import_context(ask.recording, ask.source.name, ask.source.size, ask.format, choices)
    if not ask.path.exists():
        raise LabelError("it is no longer there", got=ask.path.name)
    found = import_labels(ask.format, ask.path, context)
    report = report_of(found)
    pictures = [picture_of_label(ask.source, label) for label in report.examples]
    return ImportPreview(ask, found, report, np.concatenate(pictures, axis=1) if pictures else None)


def picture_of_label(source: LabelSource, label: Label) -> NDArray[np.uint8]:
    """What is round a label at its time, (SIDE_PX, SIDE_PX, 3), with its circle; without one the whole picture."""
    image = _image_at(source, label.t_us)
    if label.x_px is None or label.y_px is None:
        shown = _resized(image, cv2.INTER_AREA)
        return _framed(shown, "no ball" if label.state.value == "no_ball" else label.state.value)
    half = max(LEAST_PX, round(RADII * (label.r_px or LEAST_PX / RADII)))
    x0, y0 = round(label.x_px) - half, round(label.y_px) - half
    side = 2 * half + 1
    part = np.full((side, side, 3), BESIDE, np.uint8)
    rows, columns = (
        (max(first, 0), min(first + side, size)) for first, size in ((y0, image.shape[0]), (x0, image.shape[1]))
    )
    if rows[0] < rows[1] and columns[0] < columns[1]:
        part[rows[0] - y0 : rows[1] - y0, columns[0] - x0 : columns[1] - x0] = image[slice(*rows), slice(*columns)]
    scale = SIDE_PX / side
    shown = _resized(part, cv2.INTER_NEAREST)
    centre = tuple(round((value - first + 0.5) * scale) for value, first in ((label.x_px, x0), (label.y_px, y0)))
    if label.r_px is not None:
        cv2.circle(shown, centre, max(1, round(label.r_px * scale)), RING, 2, cv2.LINE_AA)
    cv2.drawMarker(shown, centre, RING, cv2.MARKER_CROSS, 14, 2)
    return _framed(shown, f"{label.t_us / 1000:.1f} ms")


def _image_at(source: LabelSource, t_us: int) -> NDArray[np.uint8]:
    frame = source.frame_at(t_us)
    if frame is None:
        image = draw_events(source.events(max(t_us - WINDOW_US // 2, 0), t_us + WINDOW_US // 2))
    else:
        image = source.frame(frame)
    return image.copy() if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)


def _resized(image: NDArray[np.uint8], interpolation: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(image, (SIDE_PX, SIDE_PX), interpolation=interpolation), np.uint8)


def _framed(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    cv2.putText(image, text, (8, SIDE_PX - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.putText(image, text, (8, SIDE_PX - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA)
    cv2.rectangle(image, (0, 0), (SIDE_PX - 1, SIDE_PX - 1), (70, 70, 70), 1)
    return image


def preview_html(preview: ImportPreview, folder: Path) -> str:
    """The table of an import: files, taken, rejected by reason; examples of both, and what was noted."""
    report = preview.report
    rows = "".join(table_row((number, html_text(what)), ONE_LINE) for what, number in report.rows)
    lines = [html_text(describe_label(label)) for label in report.examples]
    of_each = 3 if len(report.rejected) == 1 else 1
    rejected = [example for reason in report.rejected for example in reason.examples[:of_each]]
    lines += [html_text(example.replace(f"{folder}{os.sep}", "")) for example in rejected[:MAX_REJECTED]]
    lines += [html_text(note.replace(f"{folder}{os.sep}", "")) for note in report.notes]
    colour = theme.MUTED if report.taken or report.contacts else theme.BAD
    return f"<table style='margin:2px 12px'>{rows}</table>" + "".join(note_html(line, colour) for line in lines)
