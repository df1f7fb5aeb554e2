"""Commands of Watch."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.scene.world import LAYERS
from app.state.client_state import ClientState
from core.chain.config import PREDICTIONS, PredictionName


@dataclass(frozen=True, slots=True)
class ShowSpace:
    """Show the rally in 3D, or the cameras' pictures."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, watch=replace(state.watch, in_space=bool(self.on), large=""))


@dataclass(frozen=True, slots=True)
class EnlargeCamera:
    """Show one camera's picture full size; the same camera again, or "", returns to the scene."""

    camera: str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.camera not in ("", *state.seen_cameras):
            return state
        large = "" if self.camera == state.watch.large else self.camera
        return replace(state, watch=replace(state.watch, large=large))


@dataclass(frozen=True, slots=True)
class EnlargePicture:
    """Double click: on a camera's picture show it full size, anywhere else return to the scene."""

    camera: object
    """Name sent by the page, untrusted; "": not on a camera's picture."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        asked = self.camera if isinstance(self.camera, str) else None
        if asked not in ("", *state.seen_cameras):  # the caption beside the picture may have a mark before the name
            asked = str(asked).partition(" ")[2] or None
        camera = next((name for name in ("", *state.seen_cameras) if name == asked), None)
        if state.mode != "Watch" or camera is None:
            return state
        large = "" if camera == state.watch.large else camera
        return replace(state, watch=replace(state.watch, large=large))


@dataclass(frozen=True, slots=True)
class EnlargeNextCamera:
    """Cycle through the cameras and the scene."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if state.mode != "Watch":
            return state
        turn = ("", *state.seen_cameras)
        at = turn.index(state.watch.large) if state.watch.large in turn else 0
        return replace(state, watch=replace(state.watch, large=turn[(at + 1) % len(turn)]))


@dataclass(frozen=True, slots=True)
class SetPrediction:
    """Choose how hits are predicted in recordings."""

    name: PredictionName

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, watch=replace(state.watch, prediction=self.name)) if self.name in PREDICTIONS else state


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
