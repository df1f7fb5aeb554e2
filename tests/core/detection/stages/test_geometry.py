import math

import numpy as np
import pytest

from core.detection.stages.geometry import GeometryConfig, Shape, measure_shape, shape_reasons


def filled(inside) -> np.ndarray:
    y, x = np.mgrid[:101, :101]
    return np.stack([x[inside(x, y)], y[inside(x, y)]], axis=1).astype(np.int32)


def test_known_shapes_have_their_known_circularity() -> None:
    disc = measure_shape(filled(lambda x, y: np.hypot(x - 50, y - 50) <= 40))
    half = measure_shape(filled(lambda x, y: (np.hypot(x - 50, y - 50) <= 40) & (y >= 50)))
    square = measure_shape(filled(lambda x, y: (x >= 20) & (x <= 80) & (y >= 20) & (y <= 80)))
    assert disc.circularity == pytest.approx(1.0, abs=0.01)
    assert half.circularity == pytest.approx(2 * math.pi**2 / (math.pi + 2) ** 2, abs=0.01)
    assert square.circularity == pytest.approx(math.pi / 4, abs=1e-12)


def test_solidity_is_pixels_per_area_and_exceeds_one_for_a_full_shape() -> None:
    square = measure_shape(filled(lambda x, y: (x < 10) & (y < 10)))
    assert square.solidity == pytest.approx(100 / 81)
    ring = measure_shape(filled(lambda x, y: np.abs(np.hypot(x - 50, y - 50) - 40) < 1))
    assert ring.solidity < 0.2


def test_several_events_on_a_pixel_count_once() -> None:
    xy = filled(lambda x, y: (x < 10) & (y < 10))
    assert measure_shape(np.concatenate([xy, xy])).solidity == measure_shape(xy).solidity


@pytest.mark.parametrize("xy", [[[3, 4]], [[3, 4], [3, 4]], [[0, 0], [5, 5]], [[0, 0], [1, 1], [2, 2], [9, 9]]])
def test_without_an_area_nothing_is_round_or_solid(xy: list[list[int]]) -> None:
    shape = measure_shape(np.array(xy, np.int32))
    assert shape.circularity == 0.0 and shape.solidity == 0.0 and 1 <= len(shape.hull_px) <= 2


def test_neither_order_nor_place_matter() -> None:
    rng = np.random.default_rng(0)
    xy = rng.integers(0, 30, (80, 2)).astype(np.int32)
    shape, moved = measure_shape(xy), measure_shape(rng.permutation(xy) + np.array([700, 400], np.int32))
    assert moved.circularity == pytest.approx(shape.circularity, abs=1e-12) and moved.solidity == shape.solidity


def test_the_reason_names_every_threshold_that_fails_with_both_numbers() -> None:
    config = GeometryConfig(circularity_min=0.75, solidity_min=0.5)
    both = shape_reasons(Shape(np.zeros((0, 2)), 0.62, 0.1), config)
    assert [one.text for one in both] == ["circularity 0.62 < 0.75", "solidity 0.10 < 0.50"]
    assert [one.text for one in shape_reasons(Shape(np.zeros((0, 2)), 0.80, 0.1), config)] == ["solidity 0.10 < 0.50"]
    assert not shape_reasons(Shape(np.zeros((0, 2)), 0.75, 0.5), config)
