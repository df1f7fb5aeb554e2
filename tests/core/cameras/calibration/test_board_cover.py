"""Where a board has been: known poses give their cells, tilts and distances, and what is missing is said."""

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.cameras import Camera
from core.cameras.calibration import Board, BoardView
from core.cameras.calibration.coverage import board_cover, cells_of, cover_column, missing_for_lens
from core.events import SensorSize
from core.geometry import make_transform, transform_points

pytestmark = pytest.mark.numeric
BOARD = Board("dots", 5, 7, 0.03)
CAMERA = Camera(
    SensorSize(400, 300),
    np.array([[350.0, 0, 202.0], [0, 352.0, 148.0], [0, 0, 1]]),
    np.array([-0.12, 0.03, 0.0005, -0.0004, 0.0]),
    np.eye(4),
)


def seen(about_vertical_deg: float, about_horizontal_deg: float, middle_m: tuple[float, float, float]) -> BoardView:
    """A board that is turned about one axis of the picture: above 0 with its right or lower edge away."""
    R = Rotation.from_euler("yx", (-about_vertical_deg, about_horizontal_deg), degrees=True).as_matrix()
    at = make_transform(R, np.array(middle_m) - R @ BOARD.points_m.mean(axis=0))
    uvs = CAMERA.project(transform_points(at, BOARD.points_m))
    return BoardView(f"{about_vertical_deg} {about_horizontal_deg}", uvs)


def test_the_edge_that_is_away_is_known_by_its_depth() -> None:
    right_away = Rotation.from_euler("yx", (-30, 0), degrees=True).as_matrix() @ (1.0, 0.0, 0.0)
    lower_away = Rotation.from_euler("yx", (0, 30), degrees=True).as_matrix() @ (0.0, 1.0, 0.0)
    assert right_away[2] > 0 and lower_away[2] > 0


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (30.0, 0.0), (-25.0, 0.0), (0.0, 35.0), (0.0, -20.0)])
def test_tilt_distance_and_cells_of_a_board_are_those_that_it_has(tilt: tuple[float, float]) -> None:
    view = seen(*tilt, (0.02, -0.03, 0.5))
    cover = board_cover([view], BOARD, CAMERA)
    np.testing.assert_allclose(cover.tilts_deg, [tilt], atol=1e-3)
    np.testing.assert_allclose(cover.distances_m, [0.5], atol=1e-5)
    assert set(np.flatnonzero(cover.cells)) == set(cells_of(view.uvs_px, CAMERA.sensor).tolist())


def everywhere() -> list[BoardView]:
    """Every part of the picture, every tilt, near and far."""
    tilts = [(30.0, 0.0), (-30.0, 0.0), (0.0, 30.0), (0.0, -30.0)]
    middles = [(x * 0.16, y * 0.115, 0.38 + 0.25 * (x == 0)) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    return [seen(*tilt, middle) for middle in middles for tilt in tilts[:2]] + [seen(*t, (0, 0, 0.6)) for t in tilts]


def test_with_all_of_it_nothing_is_missing_and_what_is_left_out_is_said() -> None:
    assert missing_for_lens(board_cover(everywhere(), BOARD, CAMERA)) == ()
    without_right = [view for view in everywhere() if view.uvs_px[:, 0].max() < 270]
    said = missing_for_lens(board_cover(without_right, BOARD, CAMERA))
    assert said[0].startswith("the board at the upper right, at the middle right and at the lower right of the picture")
    level = [view for view in everywhere() if not view.name.startswith("-30") and not view.name.endswith("-30.0")]
    assert missing_for_lens(board_cover(level, BOARD, CAMERA))[:2] == (
        "the board with its left edge farther away, by 20 to 40 degrees",
        "the board with its upper edge farther away, by 20 to 40 degrees",
    )
    same = [seen(0.0, 0.0, (0, 0, 0.5))] * 6
    assert missing_for_lens(board_cover(same, BOARD, CAMERA))[-2:] == (
        "other distances, near and far",
        "more pictures: 15 or more, here are 6",
    )


def test_the_column_has_a_frame_for_each_empty_part_and_a_dot_for_each_picture() -> None:
    views = everywhere()[:3]
    cover = board_cover(views, BOARD, CAMERA)
    root = ElementTree.fromstring(f"<svg>{cover_column(cover, CAMERA.sensor)}</svg>")
    picture = root.find("rect")
    assert picture is not None
    sides = [float(picture.attrib[name]) for name in ("width", "height")]
    assert sides[1] / sides[0] == pytest.approx(CAMERA.sensor.height_px / CAMERA.sensor.width_px, abs=1e-3)
    assert len(root.findall("rect[@class='empty']")) == int((cover.cells == 0).sum()) > 0
    assert len(root.findall("circle[@class='tilt']")) == 3
    assert len([text for text in root.findall("text") if (text.text or "").isdigit()]) == 48
