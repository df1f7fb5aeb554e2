"""Pictures of an ordinary camera to be recorded beside the events: from a video or a folder of images."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.foreign_tables import UNIT_NAMES, UNITS_US, split_unit
from core.text import decode_text

FRAME_CAMERA: Final = "rgb"
"""The name of the camera that the pictures belong to."""
_TEXT_AND_NUMBER: Final = re.compile(r"(\D*)(\d*)")
_TIME: Final = "t|time|timestamp|ts"
_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True, slots=True)
class FrameInput:
    """Where the pictures are and when they were taken."""

    images: Path
    """A video, or a folder whose image files are taken in order of their names, see `picture_files`."""
    times: Path
    """Text, one line a picture: its time (mid exposure) on the first event source's clock, see `read_frame_times`."""
    exposure_us: int


def read_frame_times(path: Path) -> NDArray[np.int64]:
    """The times in a text file in us: one number a line, or the column t_us (t_ms, t_s, t_ns) that a heading names.

    Raises:
        RecordingError: if a line is not a time, times decrease, or which column has them cannot be told.
    """
    try:
        text = decode_text(path.read_bytes())
    except UnicodeDecodeError as error:
        raise RecordingError("not a table of frame times", got=error.reason, where=path) from error
    except OSError as error:
        raise RecordingError("the frame times cannot be read", got=error, where=path) from error
    heading: tuple[int, str] | None = None
    times: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", line)]
        if not any(cells):
            continue
        if heading is None and not times and (heading := _heading(cells, path)) is not None:
            continue
        place, unit = heading or (0, "us")
        word = cells[place] if place < len(cells) else ""
        try:
            times.append(int(word) if unit == "us" else round(float(word) * UNITS_US[unit]))
        except (ValueError, OverflowError) as error:
            expected = "whole microseconds" if unit == "us" else UNIT_NAMES[unit]
            got, where = repr(word), f"{path}, line {number}"
            raise RecordingError("not a frame time", expected=expected, got=got, where=where) from error
    t_us = np.array(times, np.int64)
    if bool((np.diff(t_us) < 0).any()):
        raise RecordingError("frame times run backwards", where=path)
    return t_us


def _heading(cells: list[str], path: Path) -> tuple[int, str] | None:
    """Place and unit of the times that a line of names states; None for a line of one number.

    Raises:
        RecordingError: if there are several columns, and not one that is named as a time.
    """
    found = [(at, unit) for at, cell in enumerate(cells) if (unit := split_unit(cell, _TIME))]
    if len(found) == 1:
        ((at, (_, unit)),) = found
        return at, unit or "us"
    if len([cell for cell in cells if cell]) > 1:
        expected, got = "one number a line, or one column t_us (t_ms, t_s, t_ns) in a first line", ",".join(cells)[:60]
        raise RecordingError("which column has the frame times cannot be told", expected=expected, got=got, where=path)
    return (0, "us") if re.search(r"[A-Za-z]", cells[0]) else None


def read_images(path: Path) -> Iterator[NDArray[np.uint8]]:
    """RGB pictures (height, width, 3), one after the other.

    Raises:
        RecordingError: if there are none.
    """
    count = 0
    for image in _folder_images(path) if path.is_dir() else _video_images(path):
        count += 1
        yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    if not count:
        raise RecordingError("no pictures", expected="a video or a folder of images", where=path)


def first_image_size(path: Path) -> SensorSize:
    """The size of the first picture."""
    height, width = next(read_images(path)).shape[:2]
    return SensorSize(width, height)


def picture_files(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """The picture files of a folder in the order of their names, numbers in them by value: 2.png before 10.png.

    Hidden ones are no pictures: macOS leaves a `._NAME` beside every file that it copies to a foreign disk.
    """
    pictures = (item for item in folder.iterdir() if item.suffix.lower() in suffixes and not item.name.startswith("."))
    return sorted(pictures, key=lambda item: (_by_number(item.stem), item.name))


def _by_number(name: str) -> list[tuple[str, int]]:
    """Parts of a name, each with the number behind it, for sorting."""
    return [(text, int(number or -1)) for text, number in _TEXT_AND_NUMBER.findall(name)]


def _folder_images(path: Path) -> Iterator[NDArray[np.uint8]]:
    for file in picture_files(path, _SUFFIXES):
        image = cv2.imread(str(file), cv2.IMREAD_COLOR)
        if image is None:
            raise RecordingError("not an image", where=file)
        yield np.asarray(image, np.uint8)


def _video_images(path: Path) -> Iterator[NDArray[np.uint8]]:
    video = cv2.VideoCapture(str(path))
    try:
        while True:
            found, image = video.read()
            if not found:
                return
            yield np.asarray(image, np.uint8)
    finally:
        video.release()
