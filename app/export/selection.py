"""The part of a recording to export, the time between pictures, and event pictures as PNG with two bits a pixel
(nothing, OFF, ON), which take a few kilobytes and a millisecond each.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Final

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from app.pictures.palette import PaletteIndex, palette
from core.errors import CommandError
from core.recordings import Recording

DEFAULT_STRIDE_US = 4000
"""Time between two pictures: 250 a second."""


@dataclass(frozen=True, slots=True)
class Span:
    """[start_us, end_us) on the recording's clock."""

    start_us: int
    end_us: int

    @property
    def length_us(self) -> int:
        """Length of the span."""
        return self.end_us - self.start_us


def span_of(recording: Recording, start_us: int | None = None, end_us: int | None = None) -> Span:
    """Span from the given bounds; None means from the start, or to the end.

    Raises:
        CommandError: if there is no such part, or nothing in the recording.
    """
    if recording.duration_us <= 0:
        raise CommandError("this recording is empty", remedy="choose another: there is nothing to export")
    start = 0 if start_us is None else start_us
    end = recording.duration_us if end_us is None else min(end_us, recording.duration_us)
    if not 0 <= start < end:
        raise CommandError(
            "no such part of the recording",
            expected=f"a start before the end, both within 0 and {recording.duration_us} us",
            got=f"{start} to {recording.duration_us if end_us is None else end_us} us",
            where="--start-us, --end-us",
        )
    return Span(start, end)


_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_INDEXED: Final = 3
_PIXELS_PER_BYTE: Final = 4
_COLOURS: Final = palette("orange / blue")[
    [PaletteIndex.BACKGROUND, PaletteIndex.OFF, PaletteIndex.ON, PaletteIndex.OUTSIDE]
].tobytes()
LEVEL: Final = 1


def polarity_png(picture: NDArray[np.uint8]) -> bytes:
    """The PNG of a picture (height, width) of values 0 to 3, as `core.events.polarity_image` makes them."""
    height, width = picture.shape
    padded = -(-width // _PIXELS_PER_BYTE) * _PIXELS_PER_BYTE
    if padded != width:
        picture = np.pad(picture, ((0, 0), (0, padded - width)))
    rows = np.zeros((height, 1 + padded // _PIXELS_PER_BYTE), np.uint8)  # the first byte: no filter
    quads = np.ascontiguousarray(picture).view("<u4")
    # The four bytes a b c d of a word become the bits aabbccdd: the leftmost pixel is the highest.
    rows[:, 1:] = (quads << 6 | quads >> 4 | quads >> 14 | quads >> 24) & 0xFF
    header = struct.pack(">IIBBBBB", width, height, 2, _INDEXED, 0, 0, 0)
    body = isal_zlib.compress(rows, LEVEL)
    chunks = ((b"IHDR", header), (b"PLTE", _COLOURS), (b"IDAT", body), (b"IEND", b""))
    return _SIGNATURE + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))
