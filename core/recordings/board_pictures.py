"""Grey pictures of a calibration board, whatever they come from: a folder, a video, frames, or the events of a camera.

A board shows in events only when it changes as a whole: when it blinks, on a screen or under a lamp. The picture is
then the number of events per pixel of the polarity that prevails, in the window with most events of each stretch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import Events
from core.events.events import count_image
from core.recordings.frame_import import picture_files, read_images
from core.recordings.frames import FrameStream
from core.recordings.opening import open_recording
from core.recordings.recording import CameraStream

VIDEO_SUFFIXES: Final = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".mjpg", ".m4v")
IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
BRIGHT_PERCENTILE: Final = 99.0
"""White is this percentile of the counts above 0."""
BLINK_SHARE: Final = 0.01
"""Least share of the pixels that must blink; a ball has a tenth of that in 5 ms, a board that is worth finding fills
several times as much."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPicture:
    """One picture of a calibration board."""

    name: str
    grey: NDArray[np.uint8]
    """(height, width)."""
    share: float
    """How much of the source has been read, 0..1."""


def read_board_pictures(
    source: Path, *, camera: str | None = None, at_most: int = 40, window_us: int = 5000
) -> Iterator[BoardPicture]:
    """At most so many pictures, spread evenly over the source.

    `camera` is needed where a recording has several; `window_us` is the length of an event picture.

    Raises:
        RecordingError: if there are none, or it is not clear of which camera.
    """
    if source.is_dir():
        yield from _folder(source, at_most)
    elif source.suffix.lower() in VIDEO_SUFFIXES:
        yield from _video(source, at_most)
    else:
        recording = open_recording(source)
        try:
            known: dict[str, FrameStream | CameraStream] = {**recording.cameras, **recording.frames}
            # Pictures show a board better than events do.
            chosen = recording.frames or recording.cameras
            if camera is None and len(chosen) == 1:
                camera = next(iter(chosen))
            if camera not in known:
                what = "which camera?" if camera is None else f"no camera {camera!r}"
                raise RecordingError(what, expected=f"--camera with one of {', '.join(known)}", where=source)
            stream = recording.frames.get(camera) or recording.cameras[camera]
            if isinstance(stream, FrameStream):
                yield from _frames(stream, at_most)
            else:
                yield from _event_pictures(stream, at_most, window_us)
        finally:
            recording.close()


def _folder(source: Path, at_most: int) -> Iterator[BoardPicture]:
    files = picture_files(source, IMAGE_SUFFIXES)
    if not files:
        raise RecordingError("no pictures in the folder", expected=", ".join(IMAGE_SUFFIXES), where=source)
    for done, number in enumerate(spread_evenly(len(files), at_most)):
        grey = cv2.imread(str(files[number]), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise RecordingError("not an image", where=files[number])
        yield BoardPicture(files[number].name, np.asarray(grey, np.uint8), (done + 1) / min(at_most, len(files)))


def _video(source: Path, at_most: int) -> Iterator[BoardPicture]:
    if not source.is_file():
        raise RecordingError("no such file", where=source)
    total = sum(1 for _ in read_images(source))  # what the header says of their number is often wrong
    wanted = set(spread_evenly(total, at_most))
    for number, image in enumerate(islice(read_images(source), total)):
        if number in wanted:
            yield BoardPicture(f"picture {number}", _grey(image), (number + 1) / total)


def _frames(stream: FrameStream, at_most: int) -> Iterator[BoardPicture]:
    for number in spread_evenly(len(stream), at_most):
        yield BoardPicture(f"frame {number}", _grey(stream.image(number)), (number + 1) / len(stream))


def _event_pictures(stream: CameraStream, at_most: int, window_us: int) -> Iterator[BoardPicture]:
    window_ms = max(1, window_us // 1000)
    counts = stream.counts_per_ms()
    in_window = np.convolve(counts, np.ones(window_ms, np.int64), "valid") if len(counts) >= window_ms else counts
    edges = np.linspace(0, len(in_window), at_most + 1).astype(int)
    for number, (first, last) in enumerate(pairwise(edges.tolist())):
        if last <= first:
            continue
        start_us = 1000 * (first + int(np.argmax(in_window[first:last])))
        grey = _brightness(stream.slice(start_us, start_us + 1000 * window_ms))
        yield BoardPicture(f"events at {start_us} us", grey, (number + 1) / at_most)


def newest_blink(
    stream: CameraStream, t_us: int, *, over_us: int = 1_000_000, window_us: int = 5000
) -> NDArray[np.uint8] | None:
    """The grey picture (height, width) of the window with most events of the last second before `t_us`.

    None if too little of the picture changed together for a board that blinked: a ball, or noise.
    """
    window_ms = max(1, window_us // 1000)
    end_ms = max(t_us, 0) // 1000
    start_ms = max(0, end_ms - over_us // 1000)
    counts = stream.counts_per_ms()[start_ms:end_ms]
    if len(counts) < window_ms:
        return None
    first = start_ms + int(np.argmax(np.convolve(counts, np.ones(window_ms, np.int64), "valid")))
    grey = _brightness(stream.slice(1000 * first, 1000 * (first + window_ms)))
    return grey if np.count_nonzero(grey) >= BLINK_SHARE * grey.size else None


def _brightness(events: Events) -> NDArray[np.uint8]:
    """The counts of the polarity that prevails as a grey picture, single noisy pixels smoothed away."""
    prevailing = events.rows(events.on if 2 * int(events.on.sum()) >= len(events) else ~events.on)
    counts = count_image(prevailing)
    white = float(np.percentile(counts[counts > 0], BRIGHT_PERCENTILE)) if counts.any() else 1.0
    grey = np.asarray(np.clip(counts * (255.0 / white), 0, 255), np.uint8)
    return np.asarray(cv2.GaussianBlur(cv2.medianBlur(grey, 3), (3, 3), 0), np.uint8)


def _grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def spread_evenly(total: int, at_most: int) -> list[int]:
    """Up to `at_most` whole numbers below `total`, ascending and evenly spaced."""
    if total <= at_most:
        return list(range(total))
    return np.round((np.arange(at_most) + 0.5) * total / at_most - 0.5).astype(int).tolist()
