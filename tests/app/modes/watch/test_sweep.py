"""The guides for a sweep of the ball and for pictures of a board."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from app import theme
from app.modes.watch.sweep import (
    BLOBS_A_DOT,
    BoardSearchRequest,
    ChooseBoard,
    ForgetBoard,
    ForgetSweep,
    GuideBoard,
    GuideSweep,
    NoteBoards,
    NoteSweptBalls,
    board_html,
    search_board,
    swept_html,
)
from app.state.client_state import ClientState, Configs, History, Playhead, RenderSettings
from app.state.swept_cells import CELL_COUNT, PAIR_ENOUGH, BoardGuide, SweptCells
from app.views.requests import WatchRequest, render_watch
from core.cameras.calibration import Board, find_board
from core.cameras.calibration.coverage import cell_box, cells_of, coverage
from core.detection import DetectorConfig
from core.detection.config import auto_config
from core.detection.saved import SavedDetector
from core.events import SensorSize
from core.recordings import open_recording
from tests.app.blinking_board import BLINK_MS, BOARD, POSES_M, SENSOR, blink, points_px

LARGE_SENSOR = SensorSize(1280, 720)


@pytest.fixture
def state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs)


def test_cells_are_counted_row_by_row_and_their_boxes_hold_their_pixels() -> None:
    corners = [(0, 0), (1279, 0), (0, 719), (1279, 719), (640, 360), (-9, 5000)]
    assert cells_of(corners, LARGE_SENSOR).tolist() == [0, 7, 40, 47, 28, 40]
    for cell in range(CELL_COUNT):
        left, top, right, bottom = cell_box(cell, LARGE_SENSOR)
        assert (
            cells_of([((left + right) / 2, (top + bottom) / 2), (left + 0.1, top + 0.1)], LARGE_SENSOR).tolist()
            == [cell] * 2
        )
    assert coverage(np.array(corners), LARGE_SENSOR) == 5 / 48


def test_a_cell_counts_with_the_second_picture_and_only_while_the_guide_is_on(state) -> None:
    seen = NoteSweptBalls((("left", 3), ("other", 5), ("right", 999)))
    assert seen.apply(state, 0.0) is state
    state = GuideSweep(True).apply(state, 0.0)
    once = seen.apply(state, 0.0)
    assert 3 in once.watch.swept.missing("left")
    twice = seen.apply(once, 0.0)
    assert 3 not in twice.watch.swept.missing("left") and len(twice.watch.swept.missing("left")) == 47
    assert len(twice.watch.swept.missing("right")) == 48 and "other" not in twice.watch.swept.counts
    again = twice
    for _ in range(40):
        again = seen.apply(again, 0.0)
    assert seen.apply(again, 0.0) is again and again.watch.swept.shared == {("left", "right"): PAIR_ENOUGH}
    assert ForgetSweep().apply(twice, 0.0).watch.swept == SweptCells(active=True)


def test_the_weakest_link_of_the_chain_of_cameras_is_what_to_sweep_next() -> None:
    cameras = ("a", "b", "c", "d")
    swept = SweptCells(True, shared={("a", "b"): 30, ("b", "c"): 30, ("a", "c"): 0, ("c", "d"): 7, ("a", "d"): 2})
    assert swept.next_pair(cameras) == ("c", "d", 7)
    said = swept_html(swept, cameras)
    assert "sweep where c and d both see it (7)" in said and "30 of 30 pictures with a" in said
    for _ in range(23):
        swept = swept.with_balls(("d", "c"))
    assert swept.next_pair(cameras) is None and "all cameras are connected" in swept_html(swept, cameras)
    assert swept.with_balls(("c", "d")) is swept and SweptCells().next_pair(("a",)) is None


def test_it_says_how_much_is_done_and_where_most_is_missing() -> None:
    all_but = {cell: 2 for cell in range(CELL_COUNT) if cell not in (46, 47, 39)}
    swept = SweptCells(True, {"left": tuple(all_but.get(cell, 0) for cell in range(CELL_COUNT))})
    said = swept_html(swept, ("left", "right"))
    assert "45 of 48 parts" in said and "at the lower right" in said and theme.GOOD in said
    assert "0 of 48 parts" in said and theme.WARN in said


def test_a_picture_tells_the_cell_of_the_ball_and_frames_what_is_missing(serve_recording) -> None:
    with open_recording(serve_recording) as recording:
        request = WatchRequest(
            recording, 300_000, RenderSettings(), SavedDetector("auto", auto_config()), show_truth=False
        )
        plain = render_watch(request)
        framed = render_watch(replace(request, swept=SweptCells(active=True)))
        assert [name for name, _ in plain.ball_cells] == ["left", "right"]
        for name, cell in plain.ball_cells:
            truth = recording.cameras[name].truth
            assert truth is not None
            row = int(np.argmin(np.abs(truth.t_us - 300_000)))
            assert cell in cells_of(truth_near(truth, row), LARGE_SENSOR)
    assert framed.ball_cells == plain.ball_cells
    assert all(len(a.png) != len(b.png) for a, b in zip(plain.pictures, framed.pictures, strict=True))


def truth_near(truth, row: int) -> list[tuple[float, float]]:
    """The true pixel and some round it: the ball may be at the edge of a cell."""
    u, v = float(truth.u_px[row]), float(truth.v_px[row])
    return [(u + du, v + dv) for du in (-9, 0, 9) for dv in (-9, 0, 9)]


@pytest.fixture
def board_state() -> ClientState:
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


def test_a_picture_with_too_many_spots_is_not_searched_for_a_dot_board(monkeypatch) -> None:
    rng = np.random.default_rng(0)
    noise = np.asarray(cv2.GaussianBlur(rng.integers(0, 255, (720, 1280)).astype(np.uint8), (5, 5), 0))
    noise = np.where(noise > 127, 255, 0).astype(np.uint8)
    board = Board("dots", 6, 9, 0.03)
    most, searched = BLOBS_A_DOT * 54, []

    def note_spots(picture, _, *, blobDetector, **__):
        searched.append(len(blobDetector.detect(picture)))
        return False, None

    monkeypatch.setattr(cv2, "findCirclesGrid", note_spots)
    assert find_board(noise, board) is None and max(searched) > most, "without a limit all of them are"
    searched.clear()
    assert find_board(noise, board, most_blobs=most) is None and max(searched, default=0) <= most


def test_cells_are_covered_by_one_picture_and_another_board_begins_anew(board_state) -> None:
    seen = NoteBoards(BoardGuide().board, (("left", (3, 4, 12)), ("other", (5,))))
    assert seen.apply(board_state, 0.0) is board_state, "nobody looks"
    board_state = GuideBoard(True).apply(GuideSweep(True).apply(board_state, 0.0), 0.0)
    assert board_state.watch.framed is board_state.watch.board.cells and not board_state.watch.swept.active
    board_state = seen.apply(seen.apply(board_state, 0.0), 0.0)
    guide = board_state.watch.board
    assert guide.pictures == {"left": 2} and len(guide.cells.missing("left")) == CELL_COUNT - 3
    assert NoteBoards(BOARD, (("left", (1,)),)).apply(board_state, 0.0) is board_state, "an answer about another board"
    said = board_html(guide, board_state.cameras)
    assert "2 pictures" in said and "3 of 48 parts" in said and "is it blinking" in said and theme.WARN in said
    other = ChooseBoard(BOARD).apply(board_state, 0.0).watch.board
    assert other.board == BOARD and other.cells.active and not other.pictures and not other.cells.counts
    emptied = ForgetBoard().apply(board_state, 0.0).watch.board
    assert emptied.cells.active and not emptied.pictures and len(emptied.cells.missing("left")) == CELL_COUNT
    swept = GuideSweep(True).apply(board_state, 0.0).watch
    assert swept.swept.active and not swept.board.cells.active and swept.framed is swept.swept
