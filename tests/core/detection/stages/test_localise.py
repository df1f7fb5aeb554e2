import math

import numpy as np
import pytest

from core.detection.stages.localise import Circle, LocaliseConfig, circle_reason, enclosing_circle


@pytest.mark.parametrize(
    ("xy", "circle"),
    [
        ([[7, 9]], (7, 9, 0)),
        ([[0, 0], [6, 8]], (3, 4, 5)),
        ([[0, 0], [10, 0], [5, 1]], (5, 0, 5)),
        ([[0, 0], [4, 0], [2, 2 * math.sqrt(3)]], (2, 2 / math.sqrt(3), 4 / math.sqrt(3))),
        ([[600, 300], [620, 300], [600, 320], [620, 320], [611, 309]], (610, 310, 10 * math.sqrt(2))),
    ],
)
def test_known_points_have_their_circle(xy: list[list[float]], circle: tuple[float, float, float]) -> None:
    found = enclosing_circle(np.array(xy, np.float64))
    assert (found.u_px, found.v_px, found.r_px) == pytest.approx(circle, abs=3e-4)


def test_every_point_lies_inside_and_at_least_two_on_the_circle() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        xy = rng.integers(0, 40, (12, 2)).astype(float)
        circle = enclosing_circle(xy)
        off = np.hypot(xy[:, 0] - circle.u_px, xy[:, 1] - circle.v_px) - circle.r_px
        assert off.max() < 1e-3 and (np.abs(off) < 1e-3).sum() >= 2


def test_a_radius_at_its_limit_passes_and_beyond_it_is_rejected_with_the_numbers() -> None:
    config = LocaliseConfig(radius_min_px=4.0, radius_max_px=24.0)
    assert circle_reason(Circle(0, 0, 4.0), config) is None and circle_reason(Circle(0, 0, 24.0002), config) is None
    small, large = circle_reason(Circle(0, 0, 3.9), config), circle_reason(Circle(0, 0, 24.2), config)
    assert small is not None and small.text == "radius 3.9 px < 4.0"
    assert large is not None and large.text == "radius 24.2 px > 24.0"
