"""The message of an ordinary camera's picture."""

# ruff: noqa: RUF009  (`column` declares a field, as `dataclasses.field` does)

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.errors import LinkError
from core.events import CameraFrame
from core.live.link.fields import LONGEST_US, MESSAGE_BYTES, WALL_NS, column, text, whole


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PictureMessage:
    """A picture of an ordinary camera, told in the block in which its exposure ends, to those that ask for pictures."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    """Counts pictures alone, as not everybody gets them."""
    camera: str = text(64)
    t_us: int = whole(-LONGEST_US, LONGEST_US)
    """Mid exposure; it may be before the session began."""
    exposure_us: int = whole(0, LONGEST_US)
    width_px: int = whole(1, 8192)
    height_px: int = whole(1, 8192)
    pixels: NDArray[np.uint8] = column("|u1", most=MESSAGE_BYTES)
    """Row by row: grey, or red, green and blue of each pixel."""

    def __post_init__(self) -> None:
        size = self.width_px * self.height_px
        if len(self.pixels) not in (size, 3 * size):
            expected = f"{size} or {3 * size} bytes"
            raise LinkError("not the pixels of a picture", expected=expected, got=len(self.pixels), where="picture")

    @staticmethod
    def of(camera: str, frame: CameraFrame, session: str, seq: int) -> PictureMessage:
        """The message of a picture, which shares its pixels."""
        height, width = frame.image.shape[:2]
        return PictureMessage(
            session=session,
            seq=seq,
            camera=camera,
            t_us=frame.t_us,
            exposure_us=frame.exposure_us,
            width_px=width,
            height_px=height,
            pixels=frame.image.reshape(-1),
        )

    def frame(self) -> CameraFrame:
        """The picture with its times."""
        colours = () if len(self.pixels) == self.height_px * self.width_px else (3,)
        image = self.pixels.reshape(self.height_px, self.width_px, *colours)
        return CameraFrame(self.t_us, self.exposure_us, image)
