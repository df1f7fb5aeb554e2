import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.cameras import Camera
from core.cameras.calibration import Board, find_board
from core.errors import ConfigError
from core.events import SensorSize
from core.geometry import make_transform
from tests.board_painter import BoardPainter

pytestmark = pytest.mark.numeric
CAMERA = Camera(
    SensorSize(400, 300),
    np.array([[350.0, 0, 202.0], [0, 352.0, 148.0], [0, 0, 1]]),
    np.array([-0.12, 0.03, 0.0005, -0.0004, 0.0]),
    np.eye(4),
)


def placed(board: Board, degrees: tuple[float, float, float]) -> np.ndarray:
    R = Rotation.from_euler("xyz", degrees, degrees=True).as_matrix()
    return make_transform(R, np.array([0.01, -0.01, 0.5]) - R @ board.points_m.mean(axis=0))


@pytest.mark.parametrize("kind", ["chessboard", "dots"])
@pytest.mark.parametrize("negative", [False, True])
def test_the_points_of_a_drawn_board_are_found_where_they_were_drawn(kind, negative: bool) -> None:
    board = Board(kind, 5, 7, 0.03)
    T_world_board = placed(board, (25.0, -15.0, 8.0))
    picture = BoardPainter(CAMERA).draw(board, T_world_board)
    found = find_board(255 - picture if negative else picture, board)
    assert found is not None and found.shape == (35, 2)
    expected = CAMERA.project(board.points_m @ T_world_board[:3, :3].T + T_world_board[:3, 3])
    distances = np.linalg.norm(found[:, None] - expected[None], axis=2).min(axis=1)
    assert np.sqrt((distances**2).mean()) < 0.2, "the centre of the top left pixel is (0, 0)"


def test_no_board_no_points() -> None:
    board = Board("chessboard", 5, 7, 0.03)
    assert find_board(np.full((300, 400), 128, np.uint8), board) is None
    picture = BoardPainter(CAMERA).draw(board, placed(board, (0.0, 0.0, 0.0)))
    assert find_board(picture, Board("chessboard", 6, 8, 0.03)) is None, "not with another number of corners"


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (("circles", 5, 7, 0.03), "chessboard or dots"),
        (("dots", 2, 7, 0.03), "2 x 7"),
        (("dots", 5, 7, 0.0), "0 mm"),
        (("dots", 5, 7, 0.9e-4), "expected 0.1 to 2000 mm, got 0.09 mm"),
        (("dots", 5, 7, 2.1), "expected 0.1 to 2000 mm, got 2100 mm"),
    ],
)
def test_an_impossible_board_is_refused(values, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        Board(*values)
