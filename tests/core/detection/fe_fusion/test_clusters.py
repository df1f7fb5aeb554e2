import numpy as np
import pytest

from core.detection.fast.cluster import allocate_clusters
from core.detection.fe_fusion import measure_clusters
from core.detection.stages.cluster import ClusterConfig, cluster_labels
from core.events import Events, SensorSize

pytestmark = pytest.mark.numeric
SENSOR = SensorSize(40, 30)


@pytest.mark.parametrize("seed", range(5))
def test_every_cluster_measures_what_its_events_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    memory = allocate_clusters(2.0, 6, SENSOR, 400)
    for count in (1, 60, 400):
        t, x, y = np.arange(count), rng.integers(0, 40, count), rng.integers(0, 30, count)
        events = Events.from_columns(t, x, y, t % 2 == 0, SENSOR)
        labels = cluster_labels(events, ClusterConfig(eps_px=2.0, min_samples=6))
        new = rng.random(count) < 0.4
        found = measure_clusters(events.x_px, events.y_px, new, memory)
        assert len(found.events) == labels.max(initial=-1) + 1
        for cluster in range(len(found.events)):
            mine = labels == cluster
            u, v = x[mine].mean(), y[mine].mean()
            assert found.events[cluster] == mine.sum()
            assert (found.u_px[cluster], found.v_px[cluster]) == pytest.approx((u, v))
            assert found.fresh[cluster] == pytest.approx(new[mine].mean())
            assert found.r_px[cluster] == pytest.approx(np.hypot(x[mine] - u, y[mine] - v).mean())
            sides = np.ptp(x[mine]) + 1, np.ptp(y[mine]) + 1
            assert found.elongation[cluster] == pytest.approx(max(sides) / min(sides))
    assert (memory.last_event == -1).all(), "empty for the next window"


def test_without_events_there_is_no_cluster() -> None:
    alone = Events.from_columns([0, 1], [3, 30], [4, 20], [True, True], SENSOR)
    found = measure_clusters(alone.x_px, alone.y_px, alone.on, allocate_clusters(2.0, 2, SENSOR, 10))
    assert all(len(column) == 0 for column in found)
