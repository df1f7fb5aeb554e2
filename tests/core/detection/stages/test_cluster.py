import numpy as np

from core.detection.stages.cluster import ClusterConfig, cluster_labels, size_reason
from core.events import Events, SensorSize

SENSOR = SensorSize(200, 100)


def events_at(xy: list[tuple[int, int]], t_us: list[int] | None = None) -> Events:
    x, y = zip(*xy, strict=True)
    return Events.from_columns(t_us or np.zeros(len(xy)), x, y, np.ones(len(xy)), SENSOR)


def test_two_groups_and_a_loner() -> None:
    group = [(10, 10), (11, 10), (10, 11), (11, 11)]
    far = [(x + 50, y) for x, y in group]
    labels = cluster_labels(events_at([(100, 90), *far, *group]), ClusterConfig(eps_px=1.5, min_samples=3))
    assert labels.tolist() == [-1, 0, 0, 0, 0, 1, 1, 1, 1]


def test_events_on_one_pixel_count_each() -> None:
    labels = cluster_labels(events_at([(5, 5)] * 4), ClusterConfig(eps_px=1.0, min_samples=4))
    assert labels.tolist() == [0, 0, 0, 0]


def test_time_separates_what_passes_the_same_pixels_later() -> None:
    events = events_at([(5, 5), (6, 5), (5, 5), (6, 5)], [0, 10, 9000, 9010])
    together = ClusterConfig(eps_px=2.0, min_samples=2)
    apart = ClusterConfig(eps_px=2.0, min_samples=2, time_scale_px_per_ms=1.0)
    assert cluster_labels(events, together).tolist() == [0, 0, 0, 0]
    assert cluster_labels(events, apart).tolist() == [0, 0, 1, 1]


def test_the_partition_does_not_depend_on_the_place_on_the_sensor() -> None:
    rng = np.random.default_rng(0)
    xy = [(int(x), int(y)) for x, y in rng.integers(0, 30, (120, 2))]
    config = ClusterConfig(eps_px=2.0, min_samples=4)
    moved = [(x + 150, y + 60) for x, y in xy]
    labels = cluster_labels(events_at(xy), config)
    assert np.array_equal(labels, cluster_labels(events_at(moved), config)) and labels.max() > 0


def test_no_events_have_no_labels() -> None:
    assert cluster_labels(Events.empty(SENSOR), ClusterConfig()).shape == (0,)


def test_a_size_out_of_range_is_rejected_with_the_numbers() -> None:
    config = ClusterConfig(size_min=40, size_max=100)
    few, many = size_reason(39, config), size_reason(101, config)
    assert few is not None and few.text == "39 events < 40"
    assert many is not None and many.text == "101 events > 100"
    assert size_reason(40, config) is None and size_reason(100, config) is None
