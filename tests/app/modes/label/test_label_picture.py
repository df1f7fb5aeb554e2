import io
import itertools

import numpy as np
import pytest
from PIL import Image

from app.modes.label.label_picture import (
    HEIGHT_PX,
    STATUS_PX,
    STRIP_PX,
    WIDTH_PX,
    BoxMark,
    CircleMark,
    LineMark,
    PictureKey,
    StripData,
    draw_label_picture,
    draw_strip,
    status_texts,
    strip_time,
)
from app.modes.label.plan import busiest_place
from app.pictures.canvas import Region
from app.pictures.palette import PaletteIndex, palette
from core.events import Events, SensorSize
from labels.arrays import STATES
from labels.model import LabelState

SIZE = SensorSize(64, 36)


class Scene:
    """One ON event at (20, 10), and a frame with one red pixel there."""

    size = SIZE

    def events(self, start_us: int, end_us: int) -> Events:
        return Events.from_columns([5], [20], [10], [True], SIZE)

    def frame(self, number: int) -> np.ndarray:
        frame = np.full((36, 64, 3), 100, np.uint8)
        frame[10, 20] = (250, 10, 20)
        return frame


def key(region: Region, *, frame: int | None = None, marks: tuple = (), width_px: int = 1280) -> PictureKey:
    return PictureKey("left", (0, 10), frame, "polarity", "orange / blue", region, width_px, marks, "")


def draw(picture: PictureKey) -> np.ndarray:
    with Image.open(io.BytesIO(draw_label_picture(Scene(), picture))) as image:
        return np.asarray(image.convert("RGB"))


@pytest.mark.parametrize("frame", [None, 0])
def test_a_pixel_is_a_crisp_block_wherever_the_picture_is_cropped(frame: int | None) -> None:
    picture = draw(key(Region(16, 8, 16, 9), frame=frame))
    assert picture.shape == (720, 1280, 3)
    colour = palette("orange / blue")[PaletteIndex.ON] if frame is None else (250, 10, 20)
    block = np.all(picture == colour, axis=2)
    assert block[160:240, 320:400].all() and block.sum() == 80 * 80


def test_marks_are_drawn_over_events_and_frames_alike() -> None:
    marks = (
        CircleMark(30.0, 20.0, 5.0, PaletteIndex.LABEL, (1.0, 0.0, 1.0)),
        LineMark(((0.0, 0.0), (63.0, 35.0)), PaletteIndex.EPIPOLAR),
    )
    for frame in (None, 0):
        bare = draw(key(Region.of_sensor(SIZE), frame=frame))
        drawn = draw(
            key(Region.of_sensor(SIZE), frame=frame, marks=(*marks, BoxMark(Region(4, 4, 8, 8), PaletteIndex.TEXT)))
        )
        for ink in (PaletteIndex.LABEL, PaletteIndex.EPIPOLAR, PaletteIndex.SIGMA, PaletteIndex.TEXT):
            there = np.all(drawn == palette("orange / blue")[ink], axis=2)
            assert there.sum() > 40 and not np.all(bare == palette("orange / blue")[ink], axis=2).any()


def test_a_small_picture_of_a_large_sensor_is_binned() -> None:
    assert draw(key(Region.of_sensor(SIZE), width_px=32)).shape == (18, 32, 3)
    assert draw(key(Region(0, 0, 32, 18), width_px=32)).shape == (18, 32, 3)


def test_a_region_beyond_the_sensor_is_shown_as_outside() -> None:
    for frame in (None, 0):
        picture = draw(key(Region(-32, -18, 64, 36), frame=frame))
        assert np.all(picture[:300, :600] == palette("orange / blue")[PaletteIndex.OUTSIDE])


def test_the_strip_shows_every_state_the_proposals_and_the_cursor() -> None:
    t_us = np.arange(5) * 10_000
    states = np.array([STATES.index(state) for state in LabelState], np.uint8)
    data = StripData(0, 100_000, t_us, states, np.array([90_000]), (70_000,))
    image = draw_strip(data, 60_000, 2_000)
    assert image.shape == (HEIGHT_PX, WIDTH_PX)
    strip = image[STATUS_PX:]
    columns = (t_us / 100_000 * (WIDTH_PX - 1)).round().astype(int)
    assert len(set(strip[2, columns].tolist())) == 5 and strip[2, columns[3] + 60] == PaletteIndex.UNCHECKED
    at = [round(t / 100_000 * (WIDTH_PX - 1)) for t in (60_000, 70_000, 90_000)]
    assert strip[2, at[0]] == PaletteIndex.CURSOR and strip[2, at[1]] == PaletteIndex.EPIPOLAR
    assert strip[2, at[2]] == PaletteIndex.UNCHECKED and strip[STRIP_PX - 2, at[2]] == PaletteIndex.DRAFT
    assert (image[:STATUS_PX] == PaletteIndex.BACKGROUND).all(), "room for the line of text"


def test_the_line_above_the_strip_is_real_letters_side_by_side_on_the_sheet() -> None:
    none = np.array([], np.int64)
    words = (
        ("NOT SAVED", PaletteIndex.HULL_REJECTED),
        ("12 of 51", PaletteIndex.TEXT),
        ("visible, partly occluded", PaletteIndex.LABEL),
    )
    data = StripData(0, 100_000, none, np.array([], np.uint8), none, (), (*words, ("anna", PaletteIndex.NO_BALL)))
    texts = status_texts(data, 500.0, "orange / blue")
    assert [one.text for one in texts] == ["NOT SAVED", "12 of 51", "visible, partly occluded", "anna"]
    assert {one.y for one in texts} == {500.0} and all(one.is_title for one in texts), "none gives way"
    css = "#{:02x}{:02x}{:02x}".format(*palette("orange / blue")[PaletteIndex.HULL_REJECTED])
    assert texts[0].colour == css
    sheet_px_for_css_px = WIDTH_PX / 480  # in a window of 1000 pixels
    for one, following in itertools.pairwise(texts):
        assert following.x - one.x > 6.2 * sheet_px_for_css_px * len(one.text), "12 px letters beside each other"
    assert texts[-1].x < WIDTH_PX - 100


def test_a_zoomed_picture_of_which_nothing_is_known_shows_where_the_events_are() -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.normal(47, 2, 300), rng.uniform(0, 63, 40)]).clip(0, 63).astype(np.uint16)
    y = np.concatenate([rng.normal(9, 2, 300), rng.uniform(0, 35, 40)]).clip(0, 35).astype(np.uint16)
    events = Events(np.arange(340, dtype=np.int64), x, y, np.ones(340, np.bool_), SIZE)
    place = busiest_place(events)
    assert place is not None and abs(place[0] - 47) < 3 and abs(place[1] - 9) < 3
    assert busiest_place(Events.empty(SIZE)) is None


def test_a_place_on_the_strip_is_a_time() -> None:
    assert [strip_time(0, 1000, share) for share in (0.0, 0.25, 1.0)] == [0, 250, 1000]
