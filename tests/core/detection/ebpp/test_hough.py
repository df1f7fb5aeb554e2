import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from core.detection.ebpp import find_circles
from core.detection.ebpp_config import EbppConfig
from core.detection.ebpp_votes import voted_circles
from core.detection.stages.roi import Roi

pytestmark = pytest.mark.numeric
CONFIG = EbppConfig()


def painted_ring(u: float, v: float, r: float, shape=(120, 160)) -> np.ndarray:
    """A circle of pixels at 255."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.where(np.abs(np.hypot(x - u, y - v) - r) < 0.8, 255, 0).astype(np.uint8)


@pytest.mark.parametrize("roi", [None, Roi(40, 120, 10, 90), Roi(-30, 110, -40, 80)])
@pytest.mark.parametrize(("u", "v", "r"), [(80.0, 50.0, 8.0), (77.5, 42.25, 12.0)])
def test_a_painted_ring_is_found_within_a_pixel_wherever_the_region_begins(u, v, r, roi) -> None:
    circles = find_circles(painted_ring(u, v, r), roi, CONFIG)
    assert math.dist(circles[0, :2], (u, v)) < 1.0
    assert circles[0, 2] == pytest.approx(r, abs=1.5)


def test_the_circle_with_the_most_votes_comes_first() -> None:
    whole, part = painted_ring(110.0, 60.0, 10.0), painted_ring(40.0, 60.0, 10.0)
    part[60:] = 0
    circles = find_circles(whole | part, None, CONFIG)
    assert math.dist(circles[0, :2], (110.0, 60.0)) < 4.0


def test_a_ring_outside_the_region_is_not_found() -> None:
    assert not len(find_circles(painted_ring(40.0, 60.0, 8.0), Roi(80, 150, 0, 119), CONFIG))
    assert not len(find_circles(painted_ring(40.0, 60.0, 8.0), Roi(200, 260, 0, 119), CONFIG))


@pytest.mark.parametrize("seed", range(6))
def test_the_votes_of_the_best_circle_are_those_that_opencv_needs(seed: int) -> None:
    """OpenCV finds it if it is asked for fewer votes, and nothing if it is asked for as many."""
    rng = np.random.default_rng(seed)
    u, v, r = rng.uniform(40, 110), rng.uniform(40, 80), rng.uniform(7, 18)
    picture = painted_ring(u, v, r)
    picture[:, : int(u - r + 2 * r * rng.uniform(0.0, 0.7))] = 0  # a part of it only
    blurred = cv2.GaussianBlur(picture, (CONFIG.blur_px, CONFIG.blur_px), 0)
    best = voted_circles(blurred, CONFIG, 2.0)[0]
    fewer, more = (find_circles(picture, None, replace(CONFIG, votes_full=best[3] + step)) for step in (-1.5, 1.5))
    assert not len(more)
    assert np.hypot(*(fewer[:, :2] - best[:2]).T).min() < 2.0


@pytest.mark.parametrize("shape", [(1, 64), (64, 1), (3, 3), (40, 40)])
def test_an_empty_picture_has_no_circle_however_small_it_is(shape) -> None:
    assert find_circles(np.zeros(shape, np.uint8), None, CONFIG).shape == (0, 3)
