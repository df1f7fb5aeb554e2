import cv2
import numpy as np
import pytest

from core.detection.fast.opening import PAD_ROWS, blank_bits, box_of, kernel_spans, open_bits, set_bits
from core.events import SensorSize


def opened_by_words(picture: np.ndarray, kernel_px: int) -> np.ndarray:
    height, width = picture.shape
    bits, opened = blank_bits(SensorSize(width, height)), blank_bits(SensorSize(width, height))
    y, x = np.nonzero(picture)
    order = np.random.default_rng(0).permutation(len(x))
    touched = np.zeros(len(x) + 1, np.int32)
    words = set_bits(x[order].astype(np.uint16), y[order].astype(np.uint16), np.arange(len(x)), len(x), bits, touched)
    assert words == np.count_nonzero(bits) == len(set(touched[:words]))
    assert np.array_equal(pixels_of(bits, picture.shape), picture)
    box = open_bits(bits, opened, kernel_spans(kernel_px), touched[:words])
    assert box == box_of(np.flatnonzero(opened), opened.shape[1]), "it names exactly the words that hold something"
    return pixels_of(opened, picture.shape)


def pixels_of(bits: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return (bits[y + PAD_ROWS, 1 + x // 64] >> (x % 64).astype(np.uint64)) & np.uint64(1)


@pytest.mark.parametrize("kernel_px", [3, 5, 7, 9])
@pytest.mark.parametrize("shape", [(1, 1), (1, 200), (40, 64), (33, 65), (50, 127), (20, 300)])
def test_it_equals_opencv_on_a_padded_picture(kernel_px: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(kernel_px * 1000 + shape[1])
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))
    survived = 0
    for density in (0.6, 0.8, 0.95):
        picture = cv2.blur((rng.random(shape) < density).astype(np.float32), (3, 3)) > 0.5
        padded = np.pad(picture.astype(np.uint8), 1)
        expected = cv2.morphologyEx(padded, cv2.MORPH_OPEN, kernel)[1:-1, 1:-1]
        assert np.array_equal(opened_by_words(picture, kernel_px), expected)
        survived += expected.sum()
    assert survived or min(shape) < kernel_px
