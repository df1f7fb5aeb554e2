import cv2
import numpy as np
import pytest

from core.detection.fast.opening import PAD_ROWS, blank_bits, kernel_spans, open_bits
from core.events import SensorSize


def opened_by_words(picture: np.ndarray, kernel_px: int) -> np.ndarray:
    height, width = picture.shape
    bits, opened = blank_bits(SensorSize(width, height)), blank_bits(SensorSize(width, height))
    for y, x in np.argwhere(picture):
        bits[y + PAD_ROWS, 1 + x // 64] |= np.uint64(1) << np.uint64(x % 64)
    first, last = open_bits(bits, opened, kernel_spans(kernel_px), PAD_ROWS, PAD_ROWS + height - 1)
    outside = np.ones(len(opened), bool)
    outside[first : last + 1] = False
    assert not opened[outside].any(), "the rows it names hold everything"
    y, x = np.mgrid[:height, :width]
    return (opened[y + PAD_ROWS, 1 + x // 64] >> (x % 64).astype(np.uint64)) & np.uint64(1)


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
