"""PNG and MP4 of a recording: the 3D view as `drawn_scene` draws it, the cameras' event pictures in its corners."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
import faery
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.export.scenes.drawn_scene import SceneDrawing
from app.export.scenes.scene_file import SceneMoment, scene_moments
from app.export.selection import Span
from app.export.task import ExportTask
from app.export.unfinished import unfinished_file
from app.pictures.palette import PaletteIndex, palette
from app.scene.view_camera import standpoint
from core.chain import ChainConfig
from core.errors import CommandError
from core.events import SensorSize, polarity_image
from core.recordings import CameraStream, Recording

SIZE: Final = SensorSize(1280, 720)
INSET_PX: Final = 330
"""Width of a camera's picture."""
MARGIN_PX: Final = 12
EVENTS_US: Final = 5_000
"""Length of the events shown in a camera's picture."""
STRIDE_US: Final = 10_000
FRAMES_PER_S: Final = 25.0
"""Frame rate of the film: with the default stride a quarter of the real speed."""
WARM_UP_US: Final = 700_000
"""The chain runs this long before a single picture, so that it shows trail and prediction."""
FREE: Final = 0.13
"""Share of the picture that stays free on each side of the table: the insets stand there."""
COLOURS: Final = palette("orange / blue")


def export_mp4(task: ExportTask) -> tuple[Path, ...]:
    """Write a film, H.264, a frame every stride, 25 frames a second.

    Raises:
        CalibrationError: if the ball cannot be found in space.
        CommandError: if there is no frame in the part.
    """
    drawing = _drawing(task.order.chain)
    moments = scene_moments(task, task.order.stride_us or STRIDE_US)
    with unfinished_file(task.path, overwrite=task.order.overwrite) as unfinished:
        size = (SIZE.width_px, SIZE.height_px)
        frames = 0
        # 18: visually lossless in x264, so that thin lines keep their colours.
        with faery.mp4.Encoder(unfinished, size, FRAMES_PER_S, 18.0, "veryfast", "none", "high") as encoder:
            for moment in moments:
                encoder.write(_compose(drawing, task.recording, moment))
                frames += 1
        if not frames:
            raise CommandError("no frame in this part", remedy="take a longer part or a smaller --stride-us")
    return (task.path,)


def export_png(task: ExportTask) -> tuple[Path, ...]:
    """Write a picture of the span's end; the chain has processed the time before it.

    Raises:
        CalibrationError: if the ball cannot be found in space.
        CommandError: if there is nothing in the part.
    """
    # Trail and prediction need the flight before the moment.
    end_us = task.span.end_us
    before = replace(task, span=Span(max(0, end_us - WARM_UP_US), end_us))
    last: SceneMoment | None = None
    for moment in scene_moments(before, 1):
        last = moment
    if last is None:
        raise CommandError("nothing to see in this part", remedy="take a longer one")
    with unfinished_file(task.path, overwrite=task.order.overwrite) as unfinished:
        Image.fromarray(_compose(_drawing(task.order.chain), task.recording, last)).save(unfinished, "PNG")
    return (task.path,)


def _drawing(chain: ChainConfig) -> SceneDrawing:
    view = standpoint("Broadcast", SIZE.width_px / SIZE.height_px, margin=FREE)
    return SceneDrawing(SIZE, view, plane_x_m=chain.predictor.hit_x_m)


def _compose(drawing: SceneDrawing, recording: Recording, moment: SceneMoment) -> NDArray[np.uint8]:
    image = drawing.draw(moment.picture)
    for number, (name, stream) in enumerate(recording.cameras.items()):
        inset = _inset(stream, moment.t_us, moment.circles)
        left = MARGIN_PX if number % 2 == 0 else SIZE.width_px - MARGIN_PX - inset.shape[1]
        top = MARGIN_PX + number // 2 * (inset.shape[0] + MARGIN_PX)
        if top + inset.shape[0] <= SIZE.height_px:
            image[top : top + inset.shape[0], left : left + inset.shape[1]] = inset
            _write(image, name, (left + 8, top + inset.shape[0] - 10))
    _write(image, f"{moment.t_us / 1e6:.3f} s", (MARGIN_PX + 4, SIZE.height_px - MARGIN_PX - 4))
    return image


def _inset(stream: CameraStream, t_us: int, circles: Mapping[str, tuple[float, float, float]]) -> NDArray[np.uint8]:
    """Small picture of the events before a time, with the detected circle."""
    binning = max(1, round(stream.sensor.width_px / INSET_PX))
    picture = COLOURS[polarity_image(stream.slice(max(0, t_us - EVENTS_US), t_us), binning=binning)]
    circle = circles.get(stream.name)
    if circle is not None:
        u, v, r = (round(value / binning) for value in circle)
        cv2.circle(picture, (u, v), max(3, r + 1), COLOURS[PaletteIndex.CIRCLE].tolist(), 1, cv2.LINE_AA)
    cv2.rectangle(picture, (0, 0), (picture.shape[1] - 1, picture.shape[0] - 1), (90, 92, 98), 1)
    return picture


def _write(image: NDArray[np.uint8], text: str, at: tuple[int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (220, 220, 220), 1, cv2.LINE_AA)
