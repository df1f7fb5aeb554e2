"""What a browser may ask of Watch."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.scene.world import LAYERS
from app.state.client_state import ClientState


@dataclass(frozen=True, slots=True)
class ShowSpace:
    """The rally in 3D, or the flat pictures of the cameras."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, watch=replace(state.watch, in_space=bool(self.on)))


@dataclass(frozen=True, slots=True)
class ShowLayer:
    """Show or hide one layer of the 3D scene."""

    layer: str
    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.layer not in LAYERS:
            return state
        hidden = state.watch.hidden - {self.layer} if self.on else state.watch.hidden | {self.layer}
        return replace(state, watch=replace(state.watch, hidden=hidden))
