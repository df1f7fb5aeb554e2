"""Indexed PNG: a tenth of the time of an RGB one, and no colour is ever changed."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.pictures.palette import PolarityColours, palette


def encode_png(picture: NDArray[np.uint8], colours: PolarityColours) -> bytes:
    """The PNG file of a picture (height, width) of palette indices."""
    image = Image.fromarray(picture).convert("P")
    image.putpalette(palette(colours).tobytes())
    buffer = io.BytesIO()
    image.save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
