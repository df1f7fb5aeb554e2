import pytest

from app.pictures.canvas import Canvas, Region
from app.views.mosaic import GAP_PX, columns_that_fill, lay_out, lay_out_grid


@pytest.mark.parametrize("arrangement", ["side by side", "stacked"])
def test_sensor_points_are_found_in_every_picture(arrangement) -> None:
    canvases = [Canvas(Region(0, 0, 64, 48)), Canvas(Region(10, 20, 16, 12))]
    sheet = lay_out(canvases, "orange / blue", arrangement)
    for picture in sheet.pictures:
        region = picture.region
        middle = sheet.sensor_point(picture.x + picture.width / 2, picture.y + picture.height / 2)
        assert middle == pytest.approx((region.x + region.width / 2 - 0.5, region.y + region.height / 2 - 0.5))
        corner = sheet.sensor_point(picture.x, picture.y)
        assert corner == pytest.approx((region.x - 0.5, region.y - 0.5))
    assert sheet.sensor_point(-1, 5) is None and sheet.sensor_point(5, sheet.height + 1) is None


def test_pictures_do_not_overlap() -> None:
    canvases = [Canvas(Region(0, 0, 64, 48))] * 2
    beside = lay_out(canvases, "orange / blue", "side by side")
    assert beside.pictures[1].x == beside.pictures[0].width + GAP_PX and beside.width == beside.pictures[1].x + 1280
    below = lay_out(canvases, "orange / blue", "stacked")
    assert below.pictures[1].y == below.pictures[0].height + GAP_PX and below.width == 1280


def test_a_grid_begins_a_row_below_the_highest_of_the_row_before() -> None:
    canvases = [Canvas(Region(0, 0, 64, height)) for height in (48, 60, 30, 12, 20)]
    sheet = lay_out_grid(canvases, "orange / blue", 2)
    step = 1280 + GAP_PX
    assert [picture.x for picture in sheet.pictures] == [0, step, 0, step, 0]
    rows = 60 * 20 + GAP_PX, 90 * 20 + 2 * GAP_PX
    assert [picture.y for picture in sheet.pictures] == [0, 0, rows[0], rows[0], rows[1]]
    assert (sheet.width, sheet.height) == (step + 1280, rows[1] + 400)


def test_an_empty_sheet_has_a_size() -> None:
    assert (lay_out([], "orange / blue", "stacked").width, lay_out([], "orange / blue", "stacked").height) == (1, 1)


@pytest.mark.parametrize(
    ("pictures", "picture_aspect", "room_aspect", "columns"),
    [
        (2, 16 / 9, 1.3, 1),  # below each other in a usual window
        (2, 16 / 9, 2.4, 2),  # beside each other in a wide and low one
        (2, 1.0, 1.3, 2),
        (3, 16 / 9, 1.6, 2),
        (4, 16 / 9, 16 / 9, 2),
        (4, 16 / 9, 8.0, 4),
        (1, 16 / 9, 0.5, 1),
        (0, 16 / 9, 1.0, 1),
    ],
)
def test_pictures_are_arranged_to_be_as_large_as_they_can(pictures, picture_aspect, room_aspect, columns) -> None:
    assert columns_that_fill(pictures, picture_aspect, room_aspect) == columns
