"""What a browser may ask of the guides for a sweep and for a board, and what its pictures tell them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.state.client_state import ClientState
from app.state.swept_cells import SweptCells
from core.cameras.calibration import Board


@dataclass(frozen=True, slots=True)
class GuideSweep:
    """Whether the cells are counted and shown."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = state if not self.on else _with_board(state, on=False)
        return _with(state, replace(state.watch.swept, active=bool(self.on)))


@dataclass(frozen=True, slots=True)
class ForgetSweep:
    """Count anew."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, SweptCells(active=state.watch.swept.active))


@dataclass(frozen=True, slots=True)
class NoteSweptBalls:
    """A picture was drawn: the cell with the ball, by camera."""

    cells: tuple[tuple[str, int], ...]

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        swept = state.watch.swept
        if not swept.active:
            return state
        for camera, cell in self.cells:
            swept = swept.with_ball(camera, cell) if camera in state.cameras else swept
        return state if swept == state.watch.swept else _with(state, swept)


@dataclass(frozen=True, slots=True)
class GuideBoard:
    """Whether the board is looked for, and where it was not is shown."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = state if not self.on else _with(state, replace(state.watch.swept, active=False))
        return _with_board(state, on=bool(self.on))


@dataclass(frozen=True, slots=True)
class ChooseBoard:
    """Look for another board: what the one before has covered is forgotten."""

    board: Board

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        guide = state.watch.board
        if self.board == guide.board:
            return state
        return replace(state, watch=replace(state.watch, board=replace(guide, board=self.board).emptied()))


@dataclass(frozen=True, slots=True)
class ForgetBoard:
    """Count anew."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, watch=replace(state.watch, board=state.watch.board.emptied()))


@dataclass(frozen=True, slots=True)
class NoteBoards:
    """The board was looked for: by camera, the cells with a point of it, where the whole of it was found."""

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
