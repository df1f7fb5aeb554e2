"""Morphological opening of a sparse binary image held as one bit per pixel, 64 pixels at a time."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.events import SensorSize

PAD_ROWS: Final = 4
"""Empty rows above and below the picture: half of the largest kernel."""
ONE: Final = np.uint64(1)
WORD: Final = np.uint64(64)


def blank_bits(sensor: SensorSize) -> NDArray[np.uint64]:
    """An empty bit image: pixel (x, y) is bit x % 64 of word [y + PAD_ROWS, 1 + x // 64]; one empty word each side."""
    return np.zeros((sensor.height_px + 2 * PAD_ROWS, (sensor.width_px + 63) // 64 + 2), np.uint64)


def kernel_spans(kernel_px: int) -> NDArray[np.int64]:
    """(kernel_px,) half width of each row of OpenCV's elliptical kernel, which is symmetric for odd diameters."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))
    return (kernel.sum(axis=1, dtype=np.int64) - 1) // 2


@njit(cache=True, nogil=True)
def open_bits(bits, opened, spans, row_min, row_max, word_min, word_max):
    """Open `bits` into `opened` (empty before) within the given rows and words, which hold all set pixels.

    Returns the number of words in which the erosion left a pixel: 0 means that nothing survived.
    """
    half = len(spans) // 2
    cross = half == 1
    eroded = np.empty(bits.shape[1], np.uint64)
    left = 0
    for row in range(row_min, row_max + 1):
        if cross:
            _erode_row_cross(bits, eroded, row, word_min, word_max)
        else:
            _erode_row(bits, eroded, spans, row, word_min, word_max)
        for word in range(word_min, word_max + 1):
            if eroded[word]:
                left += 1
                _dilate_word(opened, spans, row, word, eroded[word])
    return left


@njit(cache=True, nogil=True)
def _erode_row_cross(bits, eroded, row, word_min, word_max):
    # The 3 x 3 cross without a branch, so that the compiler makes vector instructions of it.
    above, middle, below = bits[row - 1], bits[row], bits[row + 1]
    top = WORD - ONE
    for word in range(word_min, word_max + 1):
        centre = middle[word]
        from_left = (centre << ONE) | (middle[word - 1] >> top)
        from_right = (centre >> ONE) | (middle[word + 1] << top)
        eroded[word] = centre & from_left & from_right & above[word] & below[word]


@njit(cache=True, nogil=True)
def _erode_row(bits, eroded, spans, row, word_min, word_max):
    half = len(spans) // 2
    for word in range(word_min, word_max + 1):
        left = bits[row, word]
        for number in range(len(spans)):
            if not left:
                break
            line = bits[row + number - half]
            left &= line[word]
            for shift in range(1, spans[number] + 1):
                by, rest = np.uint64(shift), np.uint64(64 - shift)
                left &= (line[word] << by) | (line[word - 1] >> rest)
                left &= (line[word] >> by) | (line[word + 1] << rest)
        eroded[word] = left


@njit(cache=True, nogil=True)
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
