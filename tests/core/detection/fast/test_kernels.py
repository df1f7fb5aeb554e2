import cv2
import numpy as np
import pytest

from core.detection.fast.kernels import area_and_perimeter, circle_of_hull, hull_of_rows
from core.detection.stages.geometry import measure_shape
from core.detection.stages.localise import enclosing_circle

pytestmark = pytest.mark.numeric


def hull_of(xy: np.ndarray) -> np.ndarray:
    first, last = np.full(400, 1 << 30), np.full(400, -1)
    np.minimum.at(first, xy[:, 1], xy[:, 0])
    np.maximum.at(last, xy[:, 1], xy[:, 0])
    hull = np.zeros((802, 2), np.int64)
    return hull[: hull_of_rows(first, last, xy[:, 1].min(), xy[:, 1].max(), hull)]


def random_points() -> list[np.ndarray]:
    """Clouds, slanted lines, rows and columns, single points."""
    rng = np.random.default_rng(0)
    sets = []
    for number in range(600):
        xy = rng.integers(0, rng.integers(1, 40), (rng.integers(1, 40), 2)) + np.array([500, 300])
        if number % 5 == 0:
            xy[:, 0] = 100 + 2 * xy[:, 1] // 3
        if number % 7 == 0:
            xy[:, number % 2] = 377
        sets.append(xy.astype(np.int32))
    return sets


def test_the_hull_has_opencvs_corners_and_the_same_circularity_area_and_circle() -> None:
    for xy in random_points():
        hull = hull_of(xy)
        assert {*map(tuple, hull)} == {*map(tuple, cv2.convexHull(xy.reshape(-1, 1, 2)).reshape(-1, 2))}
        area, perimeter = area_and_perimeter(hull, len(hull))
        shape = measure_shape(xy)
        assert (4 * np.pi * area / perimeter**2 if area else 0.0) == pytest.approx(shape.circularity, abs=1e-12)
        circle = enclosing_circle(shape.hull_px)
        assert circle_of_hull(hull, len(hull)) == pytest.approx((circle.u_px, circle.v_px, circle.r_px), abs=3e-4)


def test_the_circle_is_exact_on_known_corners() -> None:
    square = np.array([[0, 0], [0, 2], [2, 2], [2, 0]])
    assert circle_of_hull(square, 4) == pytest.approx((1, 1, np.sqrt(2)), abs=1e-15)
    assert circle_of_hull(np.array([[0, 0], [3, 1], [10, 0]]), 3) == (5.0, 0.0, 5.0)
    assert circle_of_hull(np.array([[4, 5]]), 1) == (4.0, 5.0, 0.0)
