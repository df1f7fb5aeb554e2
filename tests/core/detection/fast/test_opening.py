import cv2
import numpy as np
import pytest

from core.detection.config import DetectorConfig
from core.detection.fast.detector import _allocate
from core.detection.fast.kernels import _survivors
from core.detection.stages.denoise import DenoiseConfig
from core.events import SensorSize

pytestmark = pytest.mark.numeric


def opened_by_events(picture: np.ndarray, kernel_px: int) -> np.ndarray:
    height, width = picture.shape
    y, x = np.nonzero(picture)
    order = np.random.default_rng(0).permutation(len(x))
    y, x = y[order].astype(np.uint16), x[order].astype(np.uint16)
    config = DetectorConfig(denoise=DenoiseConfig(kernel_px=kernel_px))
    memory = _allocate(config, SensorSize(width, height), max(1, len(x)))
    memory.rows[0, : len(x)] = np.arange(len(x))
    kept = memory.rows[1, : _survivors(x, y, len(x), memory)]
    assert not memory.picture.any(), "it is empty for the next window"
    opened = np.zeros(picture.shape, np.uint8)
    opened[y[kept], x[kept]] = 1
    return opened


@pytest.mark.parametrize("kernel_px", [1, 3, 5, 7, 9])
@pytest.mark.parametrize("shape", [(1, 1), (1, 200), (40, 64), (33, 65), (50, 127), (20, 300)])
def test_it_equals_opencv_on_a_padded_picture(kernel_px: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(kernel_px * 1000 + shape[1])
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))
    survived = 0
    for density in (0.6, 0.8, 0.95):
        picture = cv2.blur((rng.random(shape) < density).astype(np.float32), (3, 3)) > 0.5
        padded = np.pad(picture.astype(np.uint8), 1)
        expected = cv2.morphologyEx(padded, cv2.MORPH_OPEN, kernel)[1:-1, 1:-1]
        assert np.array_equal(opened_by_events(picture, kernel_px), expected)
        survived += expected.sum()
    assert survived or min(shape) < kernel_px
