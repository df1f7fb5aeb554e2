import numpy as np
import pytest

from core.detection.yolo.letterbox import GREY, letterbox, shrink
from core.errors import RecordingError


@pytest.mark.parametrize("size", [(720, 1280), (1280, 1280), (100, 90), (384, 640), (1, 64), (700, 3)])
def test_a_pixel_of_the_picture_comes_back_from_the_input(size: tuple[int, int]) -> None:
    whole, place = letterbox(np.zeros((*size, 3), np.uint8), 640, 384)
    assert whole.shape == (384, 640, 3) and 0 < place.scale <= 1
    for u, v, r in ((0.0, 0.0, 3.0), (size[1] - 1.0, size[0] - 1.0, 9.0), (17.25, 4.5, 6.5)):
        x, y = (u + 0.5) * place.scale + place.left_px, (v + 0.5) * place.scale + place.top_px
        assert place.to_picture(x, y, r * place.scale) == pytest.approx((u, v, r))


def test_a_bright_pixel_lies_where_the_letterbox_says() -> None:
    image = np.zeros((720, 1280, 3), np.uint8)
    image[200:202, 600:602] = 255
    whole, place = letterbox(image, 640, 384)
    row, column = np.argwhere((whole == 255).all(axis=2))[0]
    assert place.to_picture(column + 0.5, row + 0.5, 1.0)[:2] == (600.5, 200.5)
    assert place.scale == 0.5 and (whole[:12] == GREY).all() and (whole[-12:] == GREY).all()


def test_a_picture_is_never_made_larger() -> None:
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    small, scale = shrink(image, 640, 384)
    assert scale == 1.0 and np.array_equal(small, image)


def test_a_grey_picture_is_as_good_as_one_in_colour() -> None:
    grey = np.random.default_rng(0).integers(0, 255, (720, 1280), np.uint8)
    assert np.array_equal(letterbox(grey, 640, 384)[0], letterbox(np.repeat(grey[:, :, None], 3, axis=2), 640, 384)[0])


@pytest.mark.parametrize("image", [np.zeros((4, 4, 3)), np.zeros((4, 4, 4), np.uint8), np.zeros(4, np.uint8)])
def test_what_is_no_picture_is_refused_in_one_line(image: np.ndarray) -> None:
    with pytest.raises(RecordingError, match=r"not a picture.*uint8"):
        letterbox(image, 640, 384)
