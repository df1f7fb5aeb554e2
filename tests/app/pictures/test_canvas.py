import numpy as np
import pytest

from app.pictures.canvas import Canvas, Region
from app.pictures.palette import PaletteIndex
from core.events import SensorSize

SENSOR = SensorSize(64, 48)


def lit(canvas: Canvas, ink: int) -> np.ndarray:
    """(N, 2) x, y of picture pixels with this ink."""
    ys, xs = np.nonzero(canvas.image == ink)
    return np.stack([xs, ys], axis=1)


def test_a_sensor_pixel_becomes_a_whole_block() -> None:
    pixels = np.zeros((48, 64), np.uint8)
    pixels[10, 20] = PaletteIndex.ON
    canvas = Canvas(Region(16, 8, 16, 12))
    canvas.paint_pixels(pixels)
    scale = int(canvas.scale)
    assert scale == 80
    found = lit(canvas, PaletteIndex.ON)
    assert len(found) == scale**2
    assert found.min(axis=0).tolist() == [(20 - 16) * scale, (10 - 8) * scale]


def test_what_lies_beside_the_sensor_is_marked_as_outside() -> None:
    canvas = Canvas(Region(-8, -6, 16, 12))
    canvas.paint_pixels(np.zeros((48, 64), np.uint8))
    half = canvas.image.shape[0] // 2
    assert np.all(canvas.image[:half] == PaletteIndex.OUTSIDE) and np.all(
        canvas.image[half:, canvas.image.shape[1] // 2 :] == 0
    )
    beside = Canvas(Region(500, 500, 16, 12))
    beside.paint_pixels(np.zeros((48, 64), np.uint8))
    assert np.all(beside.image == PaletteIndex.OUTSIDE)


@pytest.mark.parametrize("region", [Region(16, 8, 16, 12), Region(0, 0, 64, 48)])
def test_a_circle_is_centred_on_its_sensor_point_at_any_magnification(region: Region) -> None:
    canvas = Canvas(region)
    canvas.draw_circle(22.25, 12.75, 3.0, PaletteIndex.CIRCLE)
    found = lit(canvas, PaletteIndex.CIRCLE)
    middle = (found.min(axis=0) + found.max(axis=0)) / 2
    sensor = (middle + 0.5) / canvas.scale - 0.5 + (region.x, region.y)
    assert sensor == pytest.approx((22.25, 12.75), abs=0.6 / canvas.scale)
    radius = (found.max(axis=0) - found.min(axis=0)) / 2 / canvas.scale
    assert radius == pytest.approx((3.0, 3.0), abs=1.0 / canvas.scale)


def test_a_binned_canvas_draws_at_the_same_sensor_points() -> None:
    canvas = Canvas.of_binned(np.zeros((24, 32), np.uint8), SENSOR, 2)
    canvas.draw_box(10, 10, 20, 20, PaletteIndex.ROI)
    found = lit(canvas, PaletteIndex.ROI)
    assert found.min(axis=0).tolist() == pytest.approx([5, 5], abs=1)
    assert found.max(axis=0).tolist() == pytest.approx([10, 10], abs=1)


def test_shapes_far_outside_do_not_overflow() -> None:
    canvas = Canvas(Region(0, 0, 16, 12))
    canvas.write(1e9, -1e9, "far", PaletteIndex.TEXT)
    assert (canvas.image == PaletteIndex.OUTSIDE).all(), "no text, no ground for one"
    canvas.draw_polygon([(-1e9, 4.0), (1e9, 4.0), (1e9, 9e9)], PaletteIndex.HULL)
    found = lit(canvas, PaletteIndex.HULL)
    rows = (4.0 + 0.5) * canvas.scale
    assert np.abs(found[:, 1] - rows).max() < 2, "the side through the picture, and nothing of the others"
    assert np.unique(found[:, 0]).size == canvas.image.shape[1], "from edge to edge"


def test_a_zoomed_region_is_centred_and_has_the_sensor_s_shape() -> None:
    region = Region.around(30.0, 20.0, SENSOR, 4.0)
    assert (region.width, region.height) == (16, 12)
    assert region.x + (region.width - 1) / 2 == pytest.approx(30.0, abs=0.5)
    assert region.y + (region.height - 1) / 2 == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_a_region_of_another_shape_is_centred_and_its_shorter_side_is_the_height_of_the_sensors_shape(
    aspect: float,
) -> None:
    sensor = SensorSize(1280, 720)
    region = Region.around(600.0, 300.0, sensor, 4.0, aspect)
    assert min(region.width, region.height) == 180 and region.width / region.height == pytest.approx(aspect)
    assert region.x + (region.width - 1) / 2 == pytest.approx(600.0, abs=0.5)
    assert region.y + (region.height - 1) / 2 == pytest.approx(300.0, abs=0.5)
