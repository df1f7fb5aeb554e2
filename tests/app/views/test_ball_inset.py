"""The ball, magnified in a corner of a picture of a whole sensor."""

import numpy as np
import pytest

from app.pictures.canvas import Canvas, event_picture
from app.pictures.palette import PaletteIndex
from app.views.requests import draw_ball_inset
from core.events import Events, SensorSize, Window

SENSOR = SensorSize(1280, 720)


def draw(u: int, v: int, r: float = 8.0, binning: int = 2) -> tuple[np.ndarray, np.ndarray, Canvas]:
    """A binned picture with one ON event at the centre of a ball, before and after the inset is drawn."""
    events = Events.from_columns([5, 6], [u, 3], [v, 700], [True, False], SENSOR)
    window = Window(events, 0, 10)
    canvas = Canvas.of_binned(event_picture(window, "polarity", binning=binning), SENSOR, binning)
    before = canvas.image.copy()
    draw_ball_inset(canvas, window, (u, v, r), "polarity", lambda inset: None)
    return before, canvas.image, canvas


@pytest.mark.parametrize(("u", "v"), [(100, 100), (100, 650), (1200, 100), (1200, 650)])
def test_the_inset_shows_the_event_eight_times_larger_far_from_the_ball(u: int, v: int) -> None:
    before, after, canvas = draw(u, v)
    rows, columns = np.nonzero(before != after)
    assert not (rows.min() <= v // 2 <= rows.max() and columns.min() <= u // 2 <= columns.max())
    inset = after[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert np.count_nonzero(inset == PaletteIndex.ON) == 4**2  # a sensor pixel is half a pixel of this picture
    middle = np.argwhere(inset == PaletteIndex.ON).mean(axis=0)
    assert middle == pytest.approx((np.array(inset.shape) - 1) / 2, abs=4)
    assert [text.text for text in canvas.texts] == ["x8"]


def test_a_large_ball_is_magnified_less_and_one_that_fills_the_picture_not_at_all() -> None:
    _, _, canvas = draw(300, 300, r=20.0)
    assert [text.text for text in canvas.texts] == ["x2"] or [text.text for text in canvas.texts] == ["x4"]
    before, after, _ = draw(300, 300, r=200.0)
    assert np.array_equal(before, after)


def test_a_ball_at_the_edge_of_the_sensor_is_shown_with_what_there_is() -> None:
    before, after, _ = draw(0, 0)
    assert not np.array_equal(before, after)
