import numpy as np
import pytest

from core.detection.ebpp import blank_surface, eros_rule, picture_of, update_surface
from core.events import SensorSize

SENSOR = SensorSize(23, 17)


def surface_after(events: list[tuple[int, int, int]], *, kernel_px=7, decay=0.3, support_us=0) -> np.ndarray:
    """The surface after events of (t, x, y)."""
    rule = eros_rule(kernel_px, decay, support_us)
    surface = blank_surface(SENSOR, rule)
    t, x, y = np.array(events, np.int64).reshape(-1, 3).T
    update_surface(t, x.astype(np.uint16), y.astype(np.uint16), surface, rule)
    return picture_of(surface, rule)


@pytest.mark.parametrize("kernel_px", [3, 7, 11])
def test_it_is_what_the_rule_says_event_by_event_at_the_borders_too(kernel_px: int) -> None:
    rng = np.random.default_rng(kernel_px)
    events = [(t, int(rng.integers(SENSOR.width_px)), int(rng.integers(SENSOR.height_px))) for t in range(400)]
    expected = np.zeros((SENSOR.height_px, SENSOR.width_px), np.uint8)
    half, factor = kernel_px // 2, 0.3 ** (1 / kernel_px)
    for _, x, y in events:
        around = expected[max(0, y - half) : y + half + 1, max(0, x - half) : x + half + 1]
        brighter = around > expected[y, x]
        around[brighter] = np.floor(around[brighter] * factor)
        expected[y, x] = 255
    assert np.array_equal(surface_after(events, kernel_px=kernel_px), expected)
    assert len(np.unique(expected)) > 5


def test_an_event_leaves_the_pixels_alone_that_are_not_brighter_than_its_own() -> None:
    surface = surface_after([(0, 5, 5), (1, 6, 5), (2, 6, 5), (3, 6, 5)])
    assert surface[5, 6] == 255
    assert surface[5, 5] == int(255 * 0.3 ** (1 / 7)), "once: afterwards the other pixel was the brighter one"


def test_a_line_that_moves_on_wipes_out_where_it_was_and_one_that_rests_stays() -> None:
    resting = [(100 * k, 3, y) for k in range(12) for y in range(17)]
    moving = [(100 * k + 50, 10 + k, y) for k in range(12) for y in range(17)]
    surface = surface_after(sorted(resting + moving))
    assert surface[8, 3] > 100 and surface[8, 21] > 100
    assert surface[8, 10] < 30 and surface[8, 14] < 30


def test_an_event_without_a_recent_one_beside_it_does_not_count() -> None:
    lone = [(0, 4, 4), (10, 12, 4), (20, 12, 4), (5000, 5, 5)]
    assert not surface_after(lone, support_us=1000).any(), "nor does one of the same pixel support it"
    assert surface_after(lone, support_us=5000)[5, 5] == 255
    beside = surface_after([(0, 4, 4), (900, 5, 3), (950, 0, 16), (960, 1, 16)], support_us=1000)
    assert np.argwhere(beside == 255).tolist() == [[3, 5], [16, 1]], "the second of each pair, not the first"


def test_no_events_change_nothing() -> None:
    assert not surface_after([]).any()
