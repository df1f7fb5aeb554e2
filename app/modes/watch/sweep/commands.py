"""What a browser may ask of the guide for a sweep, and what its pictures tell it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.state.client_state import ClientState
from app.state.swept_cells import SweptCells


@dataclass(frozen=True, slots=True)
class GuideSweep:
    """Whether the cells are counted and shown."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
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


def _with(state: ClientState, swept: SweptCells) -> ClientState:
    return replace(state, watch=replace(state.watch, swept=swept))
