"""Coverage guides for calibration: parts of each picture that the ball, or a board, has not been in yet."""

from __future__ import annotations

import typing
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import viser

from app import theme
from app.background.jobs import LatestWins
from app.formatting import html_text
from app.modes.mode import ModeHost
from app.modes.watch.figures import coloured, figures_html
from app.state.client_state import ClientState
from app.state.swept_cells import CELL_COUNT, FIRST_BOARD, PAIR_ENOUGH, BoardGuide, SweptCells
from app.views.mosaic import Mosaic
from app.widgets import when_changed, when_clicked
from core.cameras.calibration import Board, find_board
from core.cameras.calibration.board import KINDS, BoardKind
from core.cameras.calibration.coverage import cells_of, emptiest_ninth, ninth_words
from core.errors import CommandError
from core.recordings import Recording
from core.recordings.board_pictures import newest_blink
from core.text import counted


@dataclass(frozen=True, slots=True)
class GuideSweep:
    """Whether the cells are counted and shown."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = state if not self.on else _with_board(state, on=False)
        return _with(state, replace(state.watch.swept, active=bool(self.on)))


@dataclass(frozen=True, slots=True)
class ForgetSweep:
    """Restart the count."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, SweptCells(active=state.watch.swept.active))


@dataclass(frozen=True, slots=True)
class NoteSweptBalls:
    """Record the cell with the ball in a new picture, by camera."""

    cells: tuple[tuple[str, int], ...]

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        swept = state.watch.swept
        if not swept.active:
            return state
        for camera, cell in self.cells:
            swept = swept.with_ball(camera, cell) if camera in state.cameras else swept
        swept = swept.with_balls(camera for camera, _ in self.cells if camera in state.cameras)
        return state if swept == state.watch.swept else _with(state, swept)


@dataclass(frozen=True, slots=True)
class GuideBoard:
    """Switch the board search and its coverage display."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = state if not self.on else _with(state, replace(state.watch.swept, active=False))
        return _with_board(state, on=bool(self.on))


@dataclass(frozen=True, slots=True)
class ChooseBoard:
    """Choose another board; the coverage restarts."""

    board: Board

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        guide = state.watch.board
        if self.board == guide.board:
            return state
        return replace(state, watch=replace(state.watch, board=replace(guide, board=self.board).emptied()))


@dataclass(frozen=True, slots=True)
class ForgetBoard:
    """Restart the count."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, watch=replace(state.watch, board=state.watch.board.emptied()))


@dataclass(frozen=True, slots=True)
class NoteBoards:
    """Record a board search: by camera, the cells with a point of a completely found board."""

    board: Board
    cells: tuple[tuple[str, tuple[int, ...]], ...]

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        guide = state.watch.board
        if not guide.cells.active or guide.board != self.board:
            return state
        for camera, cells in self.cells:
            guide = guide.with_board(camera, cells) if camera in state.cameras else guide
        return state if guide is state.watch.board else replace(state, watch=replace(state.watch, board=guide))


def _with_board(state: ClientState, *, on: bool) -> ClientState:
    guide = state.watch.board
    board = replace(guide, cells=replace(guide.cells, active=on))
    return replace(state, watch=replace(state.watch, board=board))


def _with(state: ClientState, swept: SweptCells) -> ClientState:
    return replace(state, watch=replace(state.watch, swept=swept))


GOOD_SHARE: Final = 0.7
"""Share of a picture that has to be covered; no camera sees the ball's volume in all of its picture."""


def swept_html(swept: SweptCells, cameras: tuple[str, ...]) -> str:
    """A row a camera: its parts, and how many pictures it shares with the camera it shares most with; what is next."""
    rows = []
    for name in cameras:
        others = {other: swept.shared.get(_pair(name, other), 0) for other in cameras if other != name}
        row = _row(swept.missing(name))
        if others:
            most = max(others, key=lambda other: others[other])
            colour = theme.GOOD if others[most] >= PAIR_ENOUGH else theme.WARN
            row += "; " + coloured(colour, f"{others[most]} of {PAIR_ENOUGH} pictures with {html_text(most)}")
        rows.append((html_text(name), row))
    if len(cameras) > 1:
        pair = swept.next_pair(cameras)
        if pair is None:
            rows.append(("Next", coloured(theme.GOOD, "all cameras are connected")))
        else:
            a, b, count = pair
            rows.append(("Next", f"sweep where {html_text(a)} and {html_text(b)} both see it ({count})"))
    return figures_html(rows)


def _pair(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a < b else (b, a)


def board_html(guide: BoardGuide, cameras: tuple[str, ...]) -> str:
    """HTML with a row per camera: pictures with the board, and parts not covered."""
    rows = []
    for name in cameras:
        count = guide.pictures.get(name, 0)
        if count:
            pictures = counted(count, "picture")
            rows.append((html_text(name), f"{pictures}, {_row(guide.cells.missing(name))}"))
        else:
            rows.append(
                (html_text(name), coloured(theme.WARN, "not found: is it blinking, and completely in the picture?"))
            )
    return figures_html(rows)


def _row(missing: tuple[int, ...]) -> str:
    done = CELL_COUNT - len(missing)
    colour = theme.GOOD if done >= GOOD_SHARE * CELL_COUNT else theme.WARN
    html = coloured(colour, f"{done} of {CELL_COUNT} parts")
    return html if not missing else f"{html}, most of it missing {ninth_words(emptiest_ninth(missing))}"


WIDEST_PX: Final = 700
"""Wider pictures are halved for the search: accurate enough, at a quarter of the cost."""
BLOBS_A_DOT: Final = 4
"""Most blobs per dot of the board; a picture with more would take too long."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardSearchRequest:
    """Cameras, board and time of a search."""

    recording: Recording
    t_us: int
    board: Board


def search_board(request: BoardSearchRequest) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Cells with a point of the board, by camera in which the whole board was found in the last second."""
    found = []
    for name, stream in request.recording.cameras.items():
        picture = newest_blink(stream, request.t_us)
        if picture is None:
            continue
        halved = 2 if stream.sensor.width_px > WIDEST_PX else 1
        if halved > 1:
            small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            picture = np.asarray(small, np.uint8)
        most_blobs = BLOBS_A_DOT * request.board.rows * request.board.columns
        uvs = find_board(picture, request.board, most_blobs=most_blobs)
        if uvs is not None:
            cells = cells_of(halved * (uvs + 0.5) - 0.5, stream.sensor)
            found.append((name, tuple(np.unique(cells).tolist())))
    return tuple(found)


class SweepPanel:
    """Coverage of a swept ball in one browser, counted from its own pictures."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._shown: tuple[tuple[str, ...], SweptCells] | None = None
        self._counted: Mosaic | None = None
        self._folder = gui.add_folder("Sweep of the ball", expand_by_default=False, visible=False)
        with self._folder:
            hint = (
                "Frames mark parts where the ball was not found in two pictures yet. For `calibrate stereo` and `rig`"
            )
            self._active = gui.add_checkbox("Show missing parts", False, hint=hint)
            self._status = gui.add_html("")
            self._forget = gui.add_button("Restart the count", icon=viser.Icon.ERASER)
        when_changed(self._active, lambda on: host.send(GuideSweep(bool(on))))
        when_clicked(self._forget, lambda: host.send(ForgetSweep()))

    def show(self, state: ClientState, *, flat: bool) -> None:
        """Count the newest picture, and show the coverage."""
        self._folder.visible = flat
        if not flat:
            return
        swept, sheet = state.watch.swept, self._host.plane.sheet
        if swept.active and sheet is not self._counted:
            self._counted = sheet
            if sheet.ball_cells:
                self._host.send(NoteSweptBalls(sheet.ball_cells))
        if (state.cameras, swept) != self._shown:
            self._shown = state.cameras, swept
            self._active.value = swept.active
            self._status.content = swept_html(swept, state.cameras) if swept.active else ""


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
            hint = "Frames mark parts without a point of a blinking board. For `calibrate intrinsics`"
            self._active = gui.add_checkbox("Search the board", False, hint=hint)
            self._kind = gui.add_dropdown("Pattern", KINDS)
            hint = "Inner corners of a chessboard, or dots"
            self._rows = gui.add_number("Rows", FIRST_BOARD.rows, min=FEWEST, max=MOST, step=1, hint=hint)
            self._columns = gui.add_number("Columns", FIRST_BOARD.columns, min=FEWEST, max=MOST, step=1, hint=hint)
            self._status = gui.add_html("")
            self._forget = gui.add_button("Clear its positions", icon=viser.Icon.ERASER)
        when_changed(self._active, lambda on: host.send(GuideBoard(bool(on))))
        for control in (self._kind, self._rows, self._columns):
            when_changed(control, lambda value: host.later(self._choose))
        when_clicked(self._forget, lambda: host.send(ForgetBoard()))

    def show(self, state: ClientState, now_us: int, wall_s: float, *, flat: bool) -> None:
        """Search once a second where there are new events, and show the coverage."""
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
            self._status.content = board_html(guide, state.cameras) if guide.cells.active else ""

    def close(self) -> None:
        """The browser has disconnected."""
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
