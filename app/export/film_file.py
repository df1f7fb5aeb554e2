"""Writing a film, H.264 in MP4, under a temporary name until it is complete."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Final

import av
import av.error
import numpy as np
from av.container import OutputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from app.export.unfinished import unfinished_file
from core.errors import CommandError

QUALITY: Final = {"crf": "18", "preset": "veryfast"}
"""Settings of x264: visually lossless."""
TIME_BASE: Final = 90_000


class FilmEncoder:
    """Encodes pictures one by one."""

    def __init__(self, container: OutputContainer, stream: VideoStream, frames_per_s: float) -> None:
        self._container, self._stream = container, stream
        self._ticks = Fraction(TIME_BASE) / Fraction(frames_per_s).limit_denominator(1001)
        self.frames = 0
        """Number of pictures written so far."""

    def write(self, image: NDArray[np.uint8]) -> None:
        """Append a picture (height, width, 3) RGB.

        Raises:
            CommandError: if it is of another size than the film.
        """
        size = (self._stream.height, self._stream.width, 3)
        if image.shape != size:
            raise CommandError("a picture of another size than the film", expected=size, got=image.shape)
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        frame.pts, frame.time_base = round(self.frames * self._ticks), Fraction(1, TIME_BASE)
        self.frames += 1
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def finish(self) -> None:
        """Flush the encoder."""
        for packet in self._stream.encode(None):
            self._container.mux(packet)


@contextmanager
def film_file(
    path: Path, *, width_px: int, height_px: int, frames_per_s: float, overwrite: bool = False
) -> Iterator[FilmEncoder]:
    """Context manager with the encoder; at the end of the block the film is complete. If the block raises, there is
    none.

    Args:
        path: the film.
        width_px: even.
        height_px: even.
        frames_per_s: of the film.
        overwrite: whether a file there may be replaced.

    Raises:
        CommandError: if the size is odd, the file exists and `overwrite` is not set, or it cannot be written.
    """
    if width_px % 2 or height_px % 2:
        raise CommandError("not the size of a film", expected="even numbers", got=f"{width_px}x{height_px}")
    with unfinished_file(path, overwrite=overwrite) as unfinished:
        try:
            with av.open(str(unfinished), "w", format="mp4", options={"movflags": "faststart"}) as container:
                rate = Fraction(frames_per_s).limit_denominator(1001)
                stream = container.add_stream("libx264", rate=rate, options=QUALITY)
                stream.width, stream.height, stream.pix_fmt = width_px, height_px, "yuv420p"
                stream.time_base = Fraction(1, TIME_BASE)
                encoder = FilmEncoder(container, stream, frames_per_s)
                yield encoder
                encoder.finish()
        except av.error.FFmpegError as error:
            raise CommandError("the film could not be encoded", got=error, where=path) from error
