import numpy as np
import pytest

from app.pictures.canvas import RENDERINGS, event_picture
from app.pictures.palette import RAMP_COLOURS, PaletteIndex
from core.events import Events, SensorSize, Window

SENSOR = SensorSize(8, 6)
WINDOW = Window(Events.from_columns([0, 50, 90], [1, 1, 5], [2, 2, 3], [True, True, False], SENSOR), 0, 100)


@pytest.mark.parametrize("rendering", RENDERINGS)
def test_only_pixels_with_events_are_lit(rendering) -> None:
    picture = event_picture(WINDOW, rendering)
    assert picture.shape == (6, 8) and picture.dtype == np.uint8
    assert {tuple(at) for at in np.argwhere(picture != PaletteIndex.BACKGROUND)} == {(2, 1), (3, 5)}
    assert not event_picture(Window(Events.empty(SENSOR), 0, 100), rendering).any()


def test_more_events_and_later_events_are_brighter() -> None:
    counts, ages = event_picture(WINDOW, "count"), event_picture(WINDOW, "time surface")
    assert counts[2, 1] > counts[3, 5] >= PaletteIndex.RAMP
    assert PaletteIndex.RAMP + RAMP_COLOURS > ages[3, 5] > ages[2, 1]
