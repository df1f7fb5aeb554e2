"""Morphological opening of a sparse binary image held as one bit per pixel, only where there are bits.

A window of a few thousand events sets bits in a tenth of the words of a picture. The list of those words is made while
the bits are set; nothing else is eroded, and nothing else is cleared afterwards.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection.fast.bits import LAST, ONE, SIX
from core.events import SensorSize
from core.jit import njit

PAD_ROWS: Final = 4
"""Empty rows above and below the picture: half of the largest kernel."""
PAD: Final = np.uint64(PAD_ROWS)


def blank_bits(sensor: SensorSize) -> NDArray[np.uint64]:
    """An empty bit image: pixel (x, y) is bit x % 64 of word [y + PAD_ROWS, 1 + x // 64]; one empty word each side."""
    return np.zeros((sensor.height_px + 2 * PAD_ROWS, (sensor.width_px + 63) // 64 + 2), np.uint64)


def kernel_spans(kernel_px: int) -> NDArray[np.int64]:
    """(kernel_px,) half width of each row of OpenCV's elliptical kernel, which is symmetric for odd diameters."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))
    return (kernel.sum(axis=1, dtype=np.int64) - 1) // 2


@njit
def set_bits(x_px, y_px, events, count, bits, touched):
    """Set the bits of events[:count] in an empty image; fills `touched` with the words, returns how many they are."""
    flat = bits.reshape(-1)
    stride = np.uint64(bits.shape[1])
    words = np.uint64(0)
    if count > len(flat) // 8:
        # Most of the picture will be needed: fetched in order it comes sooner than line by line as events ask for it.
        for place in range(0, len(flat), 8):
            words |= flat[place]  # stays 0, the picture is empty
    for k in range(count):
        i = np.uint64(events[k])
        x = np.uint64(x_px[i])
        place = (np.uint64(y_px[i]) + PAD) * stride + (x >> SIX) + ONE
        word = flat[place]
        touched[words] = place  # written always, kept or overwritten by the next: no branch to mispredict
        words += np.uint64(word == 0)
        flat[place] = word | (ONE << (x & LAST))
    return np.int64(words)


@njit
def box_of(touched, stride):
    """The box of words with pixels: first and last row, first and last word of a row."""
    row_first, row_last, word_first, word_last = 1 << 30, -1, stride, -1
    for k in range(len(touched)):
        row, word = np.int64(touched[k]) // stride, np.int64(touched[k]) % stride
        row_first, row_last = min(row_first, row), max(row_last, row)
        word_first, word_last = min(word_first, word), max(word_last, word)
    return row_first, row_last, word_first, word_last


@njit
def open_bits(bits, opened, spans, touched):
    """Open `bits`, whose words with pixels are `touched`, into `opened` (empty before).

    Returns the box of words of `opened` with pixels, see `box_of`; first row > last when nothing survived.
    """
    half = len(spans) // 2
    flat, stride = bits.reshape(-1), bits.shape[1]
    spill = np.uint64(64 - half)
    row_first, row_last, word_first, word_last = 1 << 30, -1, stride, -1
    for k in range(len(touched)):
        place = np.int64(touched[k])
        seeds = _erode_word(flat, place, stride, spans)
        if seeds:
            row, word = place // stride, place % stride
            _dilate_word(opened, spans, row, word, seeds)
            row_first, row_last = min(row_first, row - half), max(row_last, row + half)
            word_first = min(word_first, word - (1 if seeds << spill else 0))
            word_last = max(word_last, word + (1 if seeds >> spill else 0))
    return row_first, row_last, word_first, word_last


@njit(forceinline=True)
def _erode_word(flat, place, stride, spans):
    """Pixels of a word round which the whole kernel is set."""
    line = place - (len(spans) // 2) * stride
    seeds = flat[place] & flat[line]
    if not seeds:  # nearly always, in noise
        return seeds
    for number in range(len(spans)):
        centre, before, after = flat[line], flat[line - 1], flat[line + 1]
        seeds &= centre
        for shift in range(1, spans[number] + 1):
            by, rest = np.uint64(shift), np.uint64(64 - shift)
            seeds &= ((centre << by) | (before >> rest)) & ((centre >> by) | (after << rest))
        line += stride
    return seeds


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
