"""Pictures of ordinary cameras: what they are called, and one of them as a picture that can be drawn on."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.pictures.canvas import TARGET_WIDTH_PX, Canvas, Region
from app.pictures.palette import PaletteIndex
from core.events import SensorSize
from core.recordings import Recording
from core.recordings.frames import FrameStream, frames_of
from core.recordings.reader import FileRecording

NO_PICTURE: Final = -1
"""What `FrameStream.newest` says before the first picture."""
OF_EVENT_CAMERA: Final = "{} frames"
"""Title of the pictures that have an event camera's name: `simulate --frames-hz` takes them through its lens."""


def titled_frames(recording: Recording) -> dict[str, FrameStream]:
    """`shown_frames` of a file; none of a live rally: its pictures change while one looks into them or labels."""
    return shown_frames(recording) if isinstance(recording, FileRecording) else {}


def shown_frames(recording: Recording) -> dict[str, FrameStream]:
    """Every ordinary camera of a recording that has pictures, by the title that the app shows."""
    events = recording.cameras
    known = {name: frames for name, frames in frames_of(recording).items() if len(frames)}
    return {OF_EVENT_CAMERA.format(name) if name in events else name: frames for name, frames in known.items()}


def frame_title(title: str, frames: FrameStream, number: int) -> str:
    """Words over a picture: of which camera, which one, and when it was taken."""
    if number == NO_PICTURE:
        return f"{title}: no picture yet"
    return f"{title}: picture {number}, mid exposure {int(frames.t_us[number - frames.first]) / 1e3:.3f} ms"


def picture_or_blank(frames: FrameStream, number: int) -> NDArray[np.uint8]:
    """A picture; before the first, or if it is forgotten, something of the same size."""
    if number >= frames.first:
        return frames.image(number)
    if len(frames) or frames.calibration is None:
        return frames.image(frames.first)
    size = frames.calibration.sensor
    return np.zeros((size.height_px, size.width_px), np.uint8)


def frame_size(frame: NDArray[np.uint8]) -> SensorSize:
    """Size of a picture (height, width) or (height, width, 3)."""
    return SensorSize(frame.shape[1], frame.shape[0])


def whole_frame(frame: NDArray[np.uint8], width_px: int = TARGET_WIDTH_PX, *, across: int = 1) -> Canvas:
    """A canvas with all of a picture; one that is wider than `width_px` is made smaller."""
    size = frame_size(frame)
    binning = -(-size.width_px // width_px)
    if binning > 1:
        rows, columns = -(-size.height_px // binning), -(-size.width_px // binning)
        clear = np.full((rows, columns), PaletteIndex.BACKGROUND, np.uint8)
        canvas = Canvas.of_binned(clear, size, binning, across=across)
    else:
        canvas = Canvas(Region.of_sensor(size), across=across, width_px=width_px)
    canvas.paint_frame(frame)
    return canvas


def newest_frame(title: str, frames: FrameStream, t_us: int, width_px: int, *, across: int) -> Canvas:
    """A canvas of at most about `width_px` with the newest picture whose exposure is over, empty before the first.

    Args:
        title: of the camera, for the caption.
        frames: its pictures.
        t_us: the cursor.
        width_px: of the other pictures.
        across: pictures that stand beside each other.
    """
    number = frames.newest(t_us)
    canvas = whole_frame(picture_or_blank(frames, number), width_px, across=across)
    if number == NO_PICTURE:
        canvas.under = None
    canvas.caption(frame_title(title, frames, number))
    return canvas
