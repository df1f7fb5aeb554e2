import numpy as np
import pytest

from core.events import Events, SensorSize, count_image, polarity_image, time_surface
from core.events.events import NO_EVENT, OFF_EVENT, ON_EVENT

SENSOR = SensorSize(5, 4)
EVENTS = Events.from_columns([0, 10, 20, 30], [1, 1, 4, 1], [2, 2, 3, 2], [True, True, True, False], SENSOR)


def test_polarity_is_that_of_the_latest_event() -> None:
    image = polarity_image(EVENTS)
    assert image.shape == (4, 5)
    assert image[2, 1] == OFF_EVENT and image[3, 4] == ON_EVENT
    assert np.count_nonzero(image != NO_EVENT) == 2


def test_counts_add_up() -> None:
    image = count_image(EVENTS)
    assert image[2, 1] == 3 and image[3, 4] == 1 and image.sum() == len(EVENTS)


def test_the_time_surface_decays_from_the_latest_event() -> None:
    surface = time_surface(EVENTS, now_us=30, tau_us=10.0)
    assert surface[2, 1] == pytest.approx(1.0) and surface[3, 4] == pytest.approx(np.exp(-1.0))
    assert surface[0, 0] == 0


@pytest.mark.parametrize("binning", [1, 2, 3])
def test_binning_loses_no_event_and_covers_the_border(binning: int) -> None:
    image = count_image(EVENTS, binning=binning)
    assert image.shape == (-(-4 // binning), -(-5 // binning)) and image.sum() == len(EVENTS)
    assert polarity_image(EVENTS, binning=binning).shape == image.shape
    assert polarity_image(EVENTS, binning=binning)[2 // binning, 1 // binning] == OFF_EVENT


def test_no_events_make_an_empty_picture() -> None:
    nothing = Events.empty(SENSOR)
    assert not polarity_image(nothing).any() and not count_image(nothing).any()
    assert not time_surface(nothing, now_us=0, tau_us=1.0).any()
