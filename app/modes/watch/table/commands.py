"""What a browser may ask of the table's corners."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from app.state.client_state import ClientState
from app.state.table_clicks import CORNER_NAMES, TableClicks


@dataclass(frozen=True, slots=True)
class LetTableBeClicked:
    """Whether a click on a picture is one of a corner."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, replace(state.watch.table, active=bool(self.on)))


@dataclass(frozen=True, slots=True)
class ChooseTableCorner:
    """The next click is of this one."""

    corner: str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.corner not in CORNER_NAMES:
            return state
        return _with(state, replace(state.watch.table, corner=self.corner))


@dataclass(frozen=True, slots=True)
class ClickTableCorner:
    """Here it is, in a camera's picture."""

    camera: str
    u_px: float
    v_px: float

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        table = state.watch.table
        known = self.camera in state.cameras and math.isfinite(self.u_px) and math.isfinite(self.v_px)
        if not (table.active and known):
            return state
        return _with(state, table.clicked(self.camera, self.u_px, self.v_px))


@dataclass(frozen=True, slots=True)
class UndoTableCorner:
    """Take the last click back."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, state.watch.table.undone())


@dataclass(frozen=True, slots=True)
class ForgetTableCorners:
    """Take all clicks back."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return _with(state, TableClicks(active=state.watch.table.active))


def _with(state: ClientState, table: TableClicks) -> ClientState:
    return replace(state, watch=replace(state.watch, table=table))
