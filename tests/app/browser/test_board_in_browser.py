"""A blinking board before a live camera is found while one watches, and where it has not been is framed."""

from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from core.cameras.calibration.coverage import cells_of
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from tests.app.blinking_board import BOARD, POSES_M, SENSOR, blink, points_px
from tests.app.browser.window import choose_in
from tests.waiting import eventually


def test_a_blinking_board_is_found_live_and_the_parts_without_one_are_framed(chromium, tmp_path, open_window) -> None:
    blink(tmp_path / "blink.h5", POSES_M * 3)
    live = LiveRally(ReplaySource(open_recording(tmp_path / "blink.h5"), "blink.h5"))
    workspace = Workspace(tmp_path)
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    try:
        with open_window(lab) as window:
            page, session = window.page, window.session
            eventually(lambda: len(session.plane.sheet.pictures) == 2, "both pictures")
            page.get_by_text("Board for the lens", exact=True).click()
            page.get_by_label("Search the board").check()
            page.get_by_text("is it blinking").nth(1).wait_for()  # it looks for a chessboard of 6 x 9
            choose_in(page.get_by_label("Pattern"), "dots", exact=False)
            eventually(lambda: window.state.watch.board.board.kind == "dots", "dots to be chosen")
            for name, value in (("Rows", BOARD.rows), ("Columns", BOARD.columns)):
                window.fill(page.get_by_label(name, exact=True), str(value))
                page.keyboard.press("Enter")
            eventually(lambda: window.state.watch.board.board == BOARD, "the board to be chosen")
            reached = {cell for pose in POSES_M for cell in cells_of(points_px(pose), SENSOR).tolist()}
            eventually(lambda: window.state.watch.board.pictures.get("left", 0) >= 3, "the board to be found")
            page.get_by_text("of 48 parts").first.wait_for()
            missing = window.state.watch.board.cells.missing("left")
            assert 48 - len(missing) >= 6 and len(set(range(48)) - set(missing) - reached) <= 2
            assert "right" not in window.state.watch.board.pictures
            page.mouse.move(440, 560)
            window.screenshot("board-guide")
            page.get_by_label("Search the board").uncheck()
            eventually(lambda: not window.state.watch.framed.active, "the frames to go")
    finally:
        lab.stop()
