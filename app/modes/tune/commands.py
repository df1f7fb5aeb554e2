"""Commands of Tune's view: events in space and time, and the picture of an ordinary camera beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.state.client_state import SPACE_COLOURS, ClientState, SpaceColour


@dataclass(frozen=True, slots=True)
class ShowEventsInSpace:
    """Show the window's events in space and time, or as a picture."""

    on: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, tune=replace(state.tune, in_space=bool(self.on)))


@dataclass(frozen=True, slots=True)
class SetSpaceColour:
    """Choose what colours the window's events in space and time."""

    colour: SpaceColour

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.colour not in SPACE_COLOURS:
            return state
        return replace(state, tune=replace(state.tune, space_colour=self.colour))


@dataclass(frozen=True, slots=True)
class ShowFramesBeside:
    """Show the picture of an ordinary camera nearest to the cursor beside the events; none if the title is empty."""

    title: str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.title not in ("", *state.titled_frames):
            return state
        return replace(state, tune=replace(state.tune, frames=self.title))
