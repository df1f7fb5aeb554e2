"""Morphological opening of a sparse binary image held as one bit per pixel, 64 pixels at a time."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.jit import njit

PAD_ROWS: Final = 4
"""Empty rows above and below the picture: half of the largest kernel."""
BLOCK_WORDS: Final = 1024
"""Eroded at a time: 8 kB, so that each pass stays in the fastest cache."""


def blank_bits(sensor: SensorSize) -> NDArray[np.uint64]:
    """An empty bit image: pixel (x, y) is bit x % 64 of word [y + PAD_ROWS, 1 + x // 64]; one empty word each side."""
    return np.zeros((sensor.height_px + 2 * PAD_ROWS, (sensor.width_px + 63) // 64 + 2), np.uint64)


def kernel_spans(kernel_px: int) -> NDArray[np.int64]:
    """(kernel_px,) half width of each row of OpenCV's elliptical kernel, which is symmetric for odd diameters."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))
    return (kernel.sum(axis=1, dtype=np.int64) - 1) // 2


@njit
def open_bits(bits, opened, spans, row_min, row_max):
    """Open `bits` into `opened` (empty before), when all set pixels lie in these rows of words.

    Returns the first and last row of `opened` that may hold a pixel; first > last when nothing survived.
    """
    half = len(spans) // 2
    stride = bits.shape[1]
    flat = bits.reshape(-1)  # the empty words at both ends of a row keep the rows apart
    block = np.empty(BLOCK_WORDS, np.uint64)
    first, last = bits.shape[0], -1
    stop = (row_max + 1) * stride
    for base in range(row_min * stride, stop, BLOCK_WORDS):
        eroded = block[: min(BLOCK_WORDS, stop - base)]
        if half == 1:
            _erode_cross(flat, stride, base, eroded)
        else:
            _erode(flat, stride, spans, base, eroded)
        for k in range(len(eroded)):
            if eroded[k]:
                row, word = (base + k) // stride, (base + k) % stride
                _dilate_word(opened, spans, row, word, eroded[k])
                first, last = min(first, row - half), max(last, row + half)
    return first, last


@njit
def _erode_cross(flat, stride, base, eroded):
    # The 3 x 3 cross in one pass over slices from 0: the compiler makes it eight words to an instruction.
    count = len(eroded)
    centre, above, below = flat[base:], flat[base - stride :], flat[base + stride :]
    before, after = flat[base - 1 :], flat[base + 1 :]
    one, top = np.uint64(1), np.uint64(63)
    for k in range(count):
        sides = ((centre[k] << one) | (before[k] >> top)) & ((centre[k] >> one) | (after[k] << top))
        eroded[k] = centre[k] & sides & above[k] & below[k]


@njit
def _erode(flat, stride, spans, base, eroded):
    half = len(spans) // 2
    eroded[:] = flat[base : base + len(eroded)]
    for number in range(len(spans)):
        line = base + (number - half) * stride
        centre, before, after = flat[line:], flat[line - 1 :], flat[line + 1 :]
        for shift in range(spans[number] + 1):
            if shift == 0:
                for k in range(len(eroded)):
                    eroded[k] &= centre[k]
            else:
                by, rest = np.uint64(shift), np.uint64(64 - shift)
                for k in range(len(eroded)):
                    eroded[k] &= ((centre[k] << by) | (before[k] >> rest)) & ((centre[k] >> by) | (after[k] << rest))


@njit
def _dilate_word(opened, spans, row, word, seeds):
    half = len(spans) // 2
    for number in range(len(spans)):
        line = opened[row + number - half]
        line[word] |= seeds
        for shift in range(1, spans[number] + 1):
            by, rest = np.uint64(shift), np.uint64(64 - shift)
            line[word] |= (seeds << by) | (seeds >> by)
            line[word + 1] |= seeds >> rest
            line[word - 1] |= seeds << rest
