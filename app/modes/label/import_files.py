"""Label files of other tools in the workspace: which there are, what would be taken of them, and pictures of that."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app import theme
from app.formatting import html_text, note_html, table_row
from app.modes.label.sources import LabelSource
from core.errors import LabelError
from core.recordings import Recording
from labels.formats.exchange import Imported
from labels.formats.import_check import ImportChoices, import_context, import_labels
from labels.formats.import_report import ImportReport, describe_label, report_of
from labels.formats.picture_times import FrameTimes, read_frame_times
from labels.formats.pictures import draw_events
from labels.model import Label

FOLDER: Final = "labels-to-import"
"""In the workspace: a file or a folder of each export."""
MAX_ENTRIES: Final = 200
SIDE_PX: Final = 260
"""Of one picture of a label, on the screen."""
RADII: Final = 4.0
"""Of the ball, from the middle of a picture to its edge."""
LEAST_PX: Final = 24
WINDOW_US: Final = 2000
BESIDE: Final = 40
"""Grey of what lies outside the sensor."""
RING: Final = (64, 255, 160)
"""Of no other thing in the window."""
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
    colour = theme.MUTED if report.taken else theme.BAD
    return f"<table style='margin:2px 12px'>{rows}</table>" + "".join(note_html(line, colour) for line in lines)
