import numpy as np

from core.detection.stages.roi import Roi, RoiConfig, inside_roi, next_region, roi_around
from core.events import Events, SensorSize

CONFIG = RoiConfig(roi_expand_px=10.0, misses_to_reset=3)


def test_without_a_centre_or_switched_off_the_whole_sensor_is_searched() -> None:
    assert roi_around(None, CONFIG) is None
    assert roi_around((5.0, 5.0), RoiConfig(enabled=False)) is None


def test_the_region_holds_the_pixels_whose_centres_lie_in_it_borders_included() -> None:
    assert roi_around((50.0, 60.0), CONFIG) == Roi(40, 60, 50, 70)
    assert roi_around((50.5, 60.4), CONFIG) == Roi(41, 60, 51, 70)


def test_events_are_compared_as_signed_numbers() -> None:
    events = Events.from_columns([0, 0, 0, 0], [0, 3, 13, 14], [0, 0, 0, 0], [1, 1, 1, 1], SensorSize(20, 5))
    region = roi_around((3.0, -1.0), CONFIG)
    assert region is not None
    assert inside_roi(events, region).tolist() == [True, True, True, False]


def test_three_misses_in_a_row_reset_and_a_hit_starts_the_count_again() -> None:
    centre, misses = next_region(None, 0, (50.0, 60.0), CONFIG)
    history = []
    for found in (None, None, (51.0, 60.0), None, None, None, None):
        centre, misses = next_region(centre, misses, found, CONFIG)
        history.append((centre, misses))
    at, moved = (50.0, 60.0), (51.0, 60.0)
    assert history == [(at, 1), (at, 2), (moved, 0), (moved, 1), (moved, 2), (None, 0), (None, 0)]


def test_the_last_digits_of_a_circle_do_not_decide_about_a_column() -> None:
    centre, _ = next_region(None, 0, (600.50002, 300.49998), CONFIG)
    other, _ = next_region(None, 0, (600.5, 300.5), CONFIG)
    assert centre == other and roi_around(centre, CONFIG) == roi_around(other, CONFIG)


def test_an_empty_window_has_nothing_inside() -> None:
    assert inside_roi(Events.empty(SensorSize(4, 4)), Roi(0, 3, 0, 3)).shape == np.zeros(0).shape
