"""The guide for pictures of a blinking board, over the flat pictures: where none was found is framed there."""

from __future__ import annotations

import typing

import viser

from app.background.worker import LatestWins
from app.modes.mode import ModeHost
from app.modes.watch.sweep.board_search import BoardSearchRequest, search_board
from app.modes.watch.sweep.commands import ChooseBoard, ForgetBoard, GuideBoard, NoteBoards
from app.modes.watch.sweep.words import board_html
from app.state.board_guide import FIRST_BOARD, BoardGuide
from app.state.client_state import ClientState
from app.widgets import when_changed, when_clicked
from core.cameras.calibration import Board
from core.cameras.calibration.board import KINDS, BoardKind
from core.errors import CommandError

LOOK_EVERY_S = 1.0
FEWEST, MOST = 3, 100


class BoardPanel:
    """Board coverage in one browser: searches the second before its time cursor, in the pool."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._shown: tuple[tuple[str, ...], BoardGuide] | None = None
        self._looked_s, self._looked_us = 0.0, -1
        self._search = LatestWins(host.pool, search_board, self._found, self._failed)
        self._folder = gui.add_folder("Board for the lens", expand_by_default=False, visible=False)
        with self._folder:
            hint = "Framed: where no point of a blinking board was found yet. For `calibrate intrinsics`"
            self._active = gui.add_checkbox("Look for the board", False, hint=hint)
            self._kind = gui.add_dropdown("Pattern", KINDS)
            hint = "Inner corners of a chessboard, or dots"
            self._rows = gui.add_number("Rows", FIRST_BOARD.rows, min=FEWEST, max=MOST, step=1, hint=hint)
            self._columns = gui.add_number("Columns", FIRST_BOARD.columns, min=FEWEST, max=MOST, step=1, hint=hint)
            self._said = gui.add_html("")
            self._forget = gui.add_button("Forget where it was", icon=viser.Icon.ERASER)
        when_changed(self._active, lambda on: host.send(GuideBoard(bool(on))))
        for control in (self._kind, self._rows, self._columns):
            when_changed(control, lambda value: host.later(self._choose))
        when_clicked(self._forget, lambda: host.send(ForgetBoard()))

    def show(self, state: ClientState, now_us: int, wall_s: float, *, flat: bool) -> None:
        """Look once a second where there is something new, and say how far it is."""
        self._folder.visible = flat
        guide, recording = state.watch.board, self._host.recording
        if not flat or recording is None:
            return
        due = wall_s - self._looked_s >= LOOK_EVERY_S and now_us != self._looked_us and not self._search.busy
        if guide.cells.active and due:
            self._looked_s, self._looked_us = wall_s, now_us
            self._search.submit(BoardSearchRequest(recording, now_us, guide.board))
        if (state.cameras, guide) != self._shown:
            self._shown = state.cameras, guide
            self._active.value = guide.cells.active
            self._said.content = board_html(guide, state.cameras) if guide.cells.active else ""

    def close(self) -> None:
        """The browser is gone."""
        self._search.close()

    def _choose(self) -> None:
        rows, columns, kind = self._rows.value, self._columns.value, str(self._kind.value)
        if not all(isinstance(one, int | float) and FEWEST <= one <= MOST for one in (rows, columns)):
            raise CommandError("impossible board", expected=f"{FEWEST} to {MOST} rows and columns")
        board = Board(typing.cast(BoardKind, kind), int(rows), int(columns), FIRST_BOARD.spacing_m)
        self._host.send(ChooseBoard(board))

    def _found(self, request: BoardSearchRequest, cells: tuple[tuple[str, tuple[int, ...]], ...]) -> None:
        if cells and request.recording is self._host.recording:
            self._host.send(NoteBoards(request.board, cells))

    def _failed(self, error: Exception) -> None:
        self._host.later(lambda: self._host.report(error))
