import numpy as np
import pytest

from core.detection.fe_fusion import Clusters, possible_balls
from core.detection.fe_fusion_config import FeFusionConfig

pytestmark = pytest.mark.numeric
CONFIG = FeFusionConfig(size_min=30, radius_min_px=3.0, radius_max_px=15.0, elongation_max=2.0)


def clusters(*rows: tuple[int, float, float, float, float], fresh: float = 0.33) -> Clusters:
    """Clusters of events, u, v, r, elongation, with this share of new events."""
    events, u, v, r, elongation = np.array(rows, np.float64).T
    return Clusters(events.astype(np.int64), u, v, r, elongation, np.full(len(rows), fresh))


@pytest.mark.parametrize(
    ("events", "r_px", "elongation", "possible"),
    [
        (30, 3.0, 2.0, True), (29, 9.0, 1.0, False), (300, 15.0, 1.0, True), (300, 15.1, 1.0, False),
        (300, 2.9, 1.0, False), (300, 9.0, 2.1, False),
    ],
)  # fmt: skip
def test_a_ball_has_events_spread_and_shape_within_the_limits(events, r_px, elongation, possible: bool) -> None:
    found = possible_balls(clusters((500, 0, 0, 90, 1), (events, 10, 10, r_px, elongation)), CONFIG)
    assert found.tolist() == ([1] if possible else [])


@pytest.mark.parametrize(("fresh", "possible"), [(0.15, True), (0.14, False), (0.0, False)])
def test_a_cluster_without_new_events_is_a_trail_and_no_ball(fresh: float, possible: bool) -> None:
    assert (len(possible_balls(clusters((300, 10, 10, 9, 1), fresh=fresh), CONFIG)) == 1) is possible


def test_of_several_the_one_with_most_events_comes_first() -> None:
    three = clusters((50, 100, 100, 8, 1), (90, 20, 20, 8, 1), (70, 104, 100, 8, 1))
    assert possible_balls(three, CONFIG).tolist() == [1, 2, 0]
