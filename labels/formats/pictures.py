"""Pictures of the events under each label, for the tools that the label files are meant for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError
from core.events import Events, polarity_image
from core.events.events import OFF_EVENT, ON_EVENT
from core.recordings import CameraStream
from labels.formats.exchange import picture_name, write_bytes
from labels.model import Label

GREY, BLACK, WHITE = 128, 0, 255


def draw_events(events: Events) -> NDArray[np.uint8]:
    """(height, width) grey where nothing happened, white for ON, black for OFF: the latest event of each pixel."""
    image = polarity_image(events)
    drawn = np.full(image.shape, GREY, np.uint8)
    drawn[image == ON_EVENT] = WHITE
    drawn[image == OFF_EVENT] = BLACK
    return drawn


def write_pictures(
    stream: CameraStream,
    labels: Iterable[Label],
    folder: Path,
    *,
    window_us: int = 2000,
    progress: Callable[[float], None] | None = None,
) -> tuple[Path, ...]:
    """A PNG for each label: the window it was judged on, or `window_us` round its time.

    Raises:
        LabelError: if a picture cannot be written.
    """

    def under(label: Label) -> NDArray[np.uint8]:
        start, end = label.provenance.window_us or (label.t_us - window_us // 2, label.t_us + (window_us + 1) // 2)
        return draw_events(stream.slice(max(start, 0), max(end, 1)))

    return write_pngs(stream.name, labels, under, folder, progress)


def write_pngs(
    camera: str,
    labels: Iterable[Label],
    under: Callable[[Label], NDArray[np.uint8]],
    folder: Path,
    progress: Callable[[float], None] | None = None,
) -> tuple[Path, ...]:
    """A PNG for each label, named by its time.

    Args:
        camera: in the names of the files.
        labels: of that camera.
        under: gives what is under a label, (height, width) or (height, width, 3 = RGB).
        folder: is made if it is not there.
        progress: is told the share that is done.

    Raises:
        LabelError: if a picture cannot be written.
    """
    todo = tuple(labels)
    files = []
    for number, label in enumerate(todo, start=1):
        image = under(label)
        # Recordings hold RGB, OpenCV takes BGR.
        fine, content = cv2.imencode(".png", image if image.ndim == 2 else image[:, :, ::-1])
        if not fine:
            raise LabelError("cannot draw the picture", got=f"{image.shape} at {label.t_us} us", where=camera)
        files.append(write_bytes(folder / f"{picture_name(camera, label.t_us)}.png", content.tobytes()))
        if progress is not None:
            progress(number / len(todo))
    return tuple(files)
