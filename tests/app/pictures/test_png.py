import io

import numpy as np
import pytest
from PIL import Image

from app.pictures.canvas import encode_png
from app.pictures.palette import CLUSTER_COLOURS, POLARITY_COLOURS, RAMP_COLOURS, PaletteIndex, palette
from core.events.events import OFF_EVENT, ON_EVENT


@pytest.mark.parametrize("colours", POLARITY_COLOURS)
def test_every_pixel_gets_exactly_its_palette_colour(colours) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (30, 41)).astype(np.uint8)
    with Image.open(io.BytesIO(encode_png(picture, colours))) as image:
        assert image.mode == "P"
        assert np.array_equal(np.asarray(image.convert("RGB")), palette(colours)[picture])


def test_a_polarity_image_is_a_picture_already() -> None:
    assert (PaletteIndex.OFF, PaletteIndex.ON) == (OFF_EVENT, ON_EVENT)


def test_inks_do_not_run_into_each_other() -> None:
    assert max(ink for ink in PaletteIndex if ink < PaletteIndex.CLUSTER) < PaletteIndex.CLUSTER
    assert PaletteIndex.CLUSTER + CLUSTER_COLOURS <= PaletteIndex.RAMP and PaletteIndex.RAMP + RAMP_COLOURS <= 256
    named = [tuple(palette("orange / blue")[ink]) for ink in PaletteIndex if ink < PaletteIndex.RAMP]
    assert len(set(named)) == len(named)


def test_the_ramp_gets_brighter() -> None:
    ramp = palette("orange / blue")[PaletteIndex.RAMP : PaletteIndex.RAMP + RAMP_COLOURS].astype(int).sum(axis=1)
    assert np.all(np.diff(ramp) > 0)
