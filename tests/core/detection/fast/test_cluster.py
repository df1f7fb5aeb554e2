import numpy as np
import pytest

from core.detection.fast.cluster import grid_labels
from core.detection.stages.cluster import ClusterConfig, cluster_labels
from core.events import Events, SensorSize
from tests.core.detection.fast.exactness import compare_labels

pytestmark = pytest.mark.numeric


def test_labels_are_array_equal_to_scikit_learns_on_random_sets() -> None:
    assert compare_labels(200, np.random.default_rng(7)) == 0


def test_a_border_point_goes_to_the_lowest_numbered_cluster_that_reaches_it() -> None:
    """Two lines of core points and one point between them, within reach of both but no core."""
    line = [(x, 0) for x in range(4)]
    other = [(x, 0) for x in range(9, 13)]
    for first, second in ((line, other), (other, line)):
        x, y = zip(*first, (6, 0), *second, strict=True)
        events = Events.from_columns(np.zeros(9), x, y, np.ones(9), SensorSize(20, 3))
        config = ClusterConfig(eps_px=3.0, min_samples=4)
        expected = cluster_labels(events, config)
        assert expected.tolist() == [0, 0, 0, 0, 0, 1, 1, 1, 1]
        assert np.array_equal(grid_labels(events, config), expected)


@pytest.mark.parametrize("time_scale", [0.0, 2.0])
@pytest.mark.parametrize("eps_px", [1.0, 3.0, 12.0])
def test_dense_shapes_wider_than_a_machine_word_are_flooded_whole(eps_px: float, time_scale: float) -> None:
    y, x = (axis.ravel() for axis in np.mgrid[:5, :180])
    events = Events.from_columns(np.zeros(len(x)), x, y, np.ones(len(x)), SensorSize(200, 7))
    config = ClusterConfig(eps_px=eps_px, min_samples=3, time_scale_px_per_ms=time_scale)
    assert grid_labels(events, config).tolist() == [0] * len(x) == cluster_labels(events, config).tolist()


def test_no_events_have_no_labels() -> None:
    assert grid_labels(Events.empty(SensorSize(4, 4)), ClusterConfig()).shape == (0,)
