"""The guide for a board finds one that blinked in the last second, counts where it was, and says what is missing."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from app import theme
from app.modes.watch.sweep.board_search import BLOBS_A_DOT, BoardSearchRequest, search_board
from app.modes.watch.sweep.commands import ChooseBoard, ForgetBoard, GuideBoard, GuideSweep, NoteBoards
from app.modes.watch.sweep.words import board_html
from app.state.board_guide import BoardGuide
from app.state.client_state import ClientState, Configs
from app.state.playback import Playhead
from app.state.swept_cells import CELL_COUNT
from app.state.undo import History
from core.cameras.calibration import Board, find_board
from core.cameras.calibration.coverage import cells_of
from core.detection import DetectorConfig
from core.recordings import open_recording
from tests.app.blinking_board import BLINK_MS, BOARD, POSES_M, SENSOR, blink, points_px


@pytest.fixture
def state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs)


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("board") / "blink.h5"
    blink(path)
    return path


def test_a_board_that_blinked_before_the_cursor_is_found_where_it_is(recording: Path) -> None:
    with open_recording(recording) as opened:
        found = search_board(BoardSearchRequest(opened, 1000 * BLINK_MS, BOARD))
        true = set(cells_of(points_px(POSES_M[0]), SENSOR).tolist())
        assert [name for name, _ in found] == ["left"], "noise alone is no board"
        assert len(set(found[0][1]) ^ true) <= 1  # a point on the edge between two cells
        assert search_board(BoardSearchRequest(opened, 40_000, BOARD)) == (), "it has not blinked yet"
        other = Board("dots", 7, 9, 0.03)
        assert search_board(BoardSearchRequest(opened, 1000 * BLINK_MS, other)) == (), "another board"


def test_a_picture_with_too_many_spots_has_no_dot_board_at_once() -> None:
    rng = np.random.default_rng(0)
    noise = np.asarray(cv2.GaussianBlur(rng.integers(0, 255, (360, 640)).astype(np.uint8), (5, 5), 0))
    noise = np.where(noise > 127, 255, 0).astype(np.uint8)
    board = Board("dots", 6, 9, 0.03)
    began = cv2.getTickCount()
    assert find_board(noise, board, most_blobs=BLOBS_A_DOT * 54) is None
    assert (cv2.getTickCount() - began) / cv2.getTickFrequency() < 5


def test_cells_are_covered_by_one_picture_and_another_board_begins_anew(state) -> None:
    seen = NoteBoards(BoardGuide().board, (("left", (3, 4, 12)), ("other", (5,))))
    assert seen.apply(state, 0.0) is state, "nobody looks"
    state = GuideBoard(True).apply(GuideSweep(True).apply(state, 0.0), 0.0)
    assert state.watch.framed is state.watch.board.cells and not state.watch.swept.active
    state = seen.apply(seen.apply(state, 0.0), 0.0)
    guide = state.watch.board
    assert guide.pictures == {"left": 2} and len(guide.cells.missing("left")) == CELL_COUNT - 3
    assert NoteBoards(BOARD, (("left", (1,)),)).apply(state, 0.0) is state, "an answer about another board"
    said = board_html(guide, state.cameras)
    assert "2 pictures" in said and "3 of 48 parts" in said and "does it blink" in said and theme.WARN in said
    other = ChooseBoard(BOARD).apply(state, 0.0).watch.board
    assert other.board == BOARD and other.cells.active and not other.pictures and not other.cells.counts
    emptied = ForgetBoard().apply(state, 0.0).watch.board
    assert emptied.cells.active and not emptied.pictures and len(emptied.cells.missing("left")) == CELL_COUNT
    swept = GuideSweep(True).apply(state, 0.0).watch
    assert swept.swept.active and not swept.board.cells.active and swept.framed is swept.swept
