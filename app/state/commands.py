"""Commands of a browser: frozen values, each a pure step from one state to the next.

Callbacks of the browser only make and enqueue these; one loop applies them. Values come from untrusted browsers, so
every command accepts only what its control offers and otherwise leaves the state as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

from app.pictures.canvas import RENDERINGS, Rendering
from app.pictures.palette import POLARITY_COLOURS, PolarityColours
from app.state.client_state import (
    ARRANGEMENTS,
    MODES,
    SLOTS,
    SPEEDS,
    STEPS_US,
    Arrangement,
    ClientState,
    Configs,
    ModeName,
    Overlay,
    PickedPoint,
    Slot,
)
from core.config import replace_setting
from core.detection import DetectorConfig
from core.detection.methods import METHODS, STAGED, VIEWS, Method, method_config

WINDOW_RANGE_US = (100, 100_000)
ZOOM_RANGE = (1.0, 20.0)
MAX_MARKS = 100


class Command(Protocol):
    """One step of the state; `wall_s` is the time at which it is applied."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState: ...


@dataclass(frozen=True, slots=True)
class SetMode:
    mode: ModeName

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, mode=self.mode) if self.mode in MODES else state


@dataclass(frozen=True, slots=True)
class SignIn:
    """Say who labels in this browser."""

    annotator: str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, annotator=self.annotator)


@dataclass(frozen=True, slots=True)
class TogglePlay:
    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        head = state.playhead
        return replace(state, playhead=head.pause(wall_s) if head.playing else head.play(wall_s))


@dataclass(frozen=True, slots=True)
class Seek:
    t_us: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, playhead=state.playhead.seek(self.t_us, wall_s))


@dataclass(frozen=True, slots=True)
class StepTime:
    """Step the cursor by a number of steps; negative goes back."""

    steps: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, playhead=state.playhead.step(self.steps * state.step_us, wall_s))


@dataclass(frozen=True, slots=True)
class SetStep:
    step_us: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, step_us=self.step_us) if self.step_us in STEPS_US else state


@dataclass(frozen=True, slots=True)
class SetPlaybackSpeed:
    speed: float

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, playhead=state.playhead.at_speed(self.speed, wall_s))


@dataclass(frozen=True, slots=True)
class Shuttle:
    """Faster (+1) plays, then at the next higher speed. Slower (-1) takes the next lower one, or ten steps back."""

    direction: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        head = state.playhead
        if not head.playing:
            return (
                replace(state, playhead=head.play(wall_s)) if self.direction > 0 else StepTime(-10).apply(state, wall_s)
            )
        others = [speed for speed in SPEEDS if (speed - head.speed) * self.direction > 0]
        nearest = min(others, key=lambda speed: abs(speed - head.speed), default=head.speed)
        return replace(state, playhead=head.at_speed(nearest, wall_s))


@dataclass(frozen=True, slots=True)
class Loop:
    """Repeat a section; None ends it."""

    section_us: tuple[int, int] | None

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, playhead=state.playhead.looping(self.section_us, wall_s))


@dataclass(frozen=True, slots=True)
class ToggleMark:
    """Mark a time, or remove its mark."""

    t_us: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        marks = set(state.marks_us) ^ {min(max(self.t_us, 0), state.playhead.duration_us)}
        return replace(state, marks_us=tuple(sorted(marks))) if len(marks) <= MAX_MARKS else state


@dataclass(frozen=True, slots=True)
class SetCamera:
    camera: str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.camera not in state.cameras:
            return state
        return replace(state, camera=self.camera, tune=replace(state.tune, centre_px=None))


@dataclass(frozen=True, slots=True)
class SetWindow:
    """Set the accumulation window of Watch."""

    window_us: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        low, high = WINDOW_RANGE_US
        return replace(state, look=replace(state.look, window_us=min(max(self.window_us, low), high)))


@dataclass(frozen=True, slots=True)
class SetRendering:
    rendering: Rendering

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        valid = self.rendering in RENDERINGS
        return replace(state, look=replace(state.look, rendering=self.rendering)) if valid else state


@dataclass(frozen=True, slots=True)
class SetColours:
    colours: PolarityColours

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        valid = self.colours in POLARITY_COLOURS
        return replace(state, look=replace(state.look, colours=self.colours)) if valid else state


@dataclass(frozen=True, slots=True)
class SetArrangement:
    arrangement: Arrangement

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        valid = self.arrangement in ARRANGEMENTS
        return replace(state, look=replace(state.look, arrangement=self.arrangement)) if valid else state


@dataclass(frozen=True, slots=True)
class MagnifyBall:
    show: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, look=replace(state.look, magnifies_ball=self.show))


@dataclass(frozen=True, slots=True)
class SetOverlay:
    overlay: Overlay

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        valid = any(self.overlay in views for views in VIEWS.values())
        return replace(state, tune=replace(state.tune, overlay=self.overlay)) if valid else state


@dataclass(frozen=True, slots=True)
class ShowStage:
    """Show the stage of this number, from 1, of the chosen method."""

    number: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        views = VIEWS[state.tune.method]
        return SetOverlay(views[self.number - 1]).apply(state, wall_s) if 1 <= self.number <= len(views) else state


@dataclass(frozen=True, slots=True)
class SetZoom:
    zoom: float

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if not math.isfinite(self.zoom):
            return state
        low, high = ZOOM_RANGE
        return replace(state, tune=replace(state.tune, zoom=min(max(self.zoom, low), high)))


@dataclass(frozen=True, slots=True)
class LookAt:
    """Centre the zoomed view on a point of the sensor; None follows the ball again. Unzoomed, a click means nothing."""

    centre_px: tuple[float, float] | None

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if self.centre_px is not None and (state.tune.zoom <= 1.0 or not all(map(math.isfinite, self.centre_px))):
            return state
        return replace(state, tune=replace(state.tune, centre_px=self.centre_px))


@dataclass(frozen=True, slots=True)
class PickCluster:
    """Choose the cluster at a point; the zoomed view of its camera is centred there."""

    picked: PickedPoint

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        if not all(map(math.isfinite, self.picked.point_px)):
            return state
        if self.picked.camera == state.camera:
            state = LookAt(self.picked.point_px).apply(state, wall_s)
        return replace(state, tune=replace(state.tune, picked=self.picked))


@dataclass(frozen=True, slots=True)
class SetSlot:
    slot: Slot

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, tune=replace(state.tune, slot=self.slot)) if self.slot in SLOTS else state


@dataclass(frozen=True, slots=True)
class SetCompare:
    compare: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, tune=replace(state.tune, compare=self.compare))


@dataclass(frozen=True, slots=True)
class SetMethod:
    method: Method

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, tune=replace(state.tune, method=self.method)) if self.method in METHODS else state


@dataclass(frozen=True, slots=True)
class CompareMethod:
    """Add a method to the comparisons, or remove it."""

    method: Method
    takes_part: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        chosen = {*state.tune.compared, self.method} if self.takes_part else {*state.tune.compared} - {self.method}
        compared = tuple(method for method in METHODS if method in chosen)
        return replace(state, tune=replace(state.tune, compared=compared))


@dataclass(frozen=True, slots=True)
class SetSideBySide:
    side_by_side: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, tune=replace(state.tune, side_by_side=self.side_by_side))


@dataclass(frozen=True, slots=True)
class StopAt:
    """Go to a time and pause there."""

    t_us: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, playhead=state.playhead.pause(wall_s).seek(self.t_us, wall_s))


@dataclass(frozen=True, slots=True)
class LookInto:
    """Show a moment of a camera in another mode, paused."""

    mode: ModeName
    camera: str
    t_us: int

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        for step in (StopAt(self.t_us), SetCamera(self.camera), SetMode(self.mode)):
            state = step.apply(state, wall_s)
        return replace(state, looks=state.looks + 1)


@dataclass(frozen=True, slots=True)
class AskForScore:
    """Request a score of Tune's config against an annotator's labels of a camera."""

    camera: str
    annotator: str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = SetMode("Tune").apply(SetCamera(self.camera).apply(state, wall_s), wall_s)
        return replace(state, score_by=self.annotator)


@dataclass(frozen=True, slots=True)
class BeginScore:
    """The requested score has started."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, score_by=None)


@dataclass(frozen=True, slots=True)
class ShowTruth:
    show: bool

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        return replace(state, tune=replace(state.tune, show_truth=self.show))


@dataclass(frozen=True, slots=True)
class EditSetting:
    """Change one setting of the detector.

    Raises:
        ConfigError: from `apply`, if the value does not go with the others; the state stays.
    """

    path: tuple[str, ...]
    value: bool | int | float | str

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        config = replace_setting(state.config, self.path, self.value)
        return _with_config(state, config, topic=(state.tune.slot, self.path), wall_s=wall_s)


@dataclass(frozen=True, slots=True)
class UseConfig:
    """Replace the edited config (by the default or a loaded file)."""

    config: DetectorConfig
    method: Method | None = None
    """Method of the config, which becomes the chosen one; None for the chosen one."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = state if self.method is None else SetMethod(self.method).apply(state, wall_s)
        return _with_config(state, self.config, topic=None, wall_s=wall_s)


@dataclass(frozen=True, slots=True)
class ResetConfig:
    """Reset the edited config to the method's defaults."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        method = state.tune.method
        config = DetectorConfig() if method in STAGED else method_config(method)
        return _with_config(state, config, topic=None, wall_s=wall_s)


@dataclass(frozen=True, slots=True)
class ResetAllConfigs:
    """Reset both configs of every method to its defaults; each method's undo brings its own back."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        fresh = Configs(DetectorConfig(), DetectorConfig())
        own_configs = {
            method: history.change(Configs(method_config(method), method_config(method)), topic=None, wall_s=wall_s)
            for method, history in state.own_configs.items()
        }
        configs = state.configs.change(fresh, topic=None, wall_s=wall_s)
        return replace(state, configs=configs, own_configs=own_configs)


@dataclass(frozen=True, slots=True)
class UseBeside:
    """Put a tuned config into B and its start config into A, and show both on the same window."""

    method: Method
    """Method of both configs; it becomes the chosen one."""
    a: DetectorConfig
    b: DetectorConfig

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = replace(state, tune=replace(state.tune, method=self.method, slot="B", compare=True, side_by_side=False))
        return state.with_history(state.history.change(Configs(self.a, self.b), topic=None, wall_s=wall_s))


@dataclass(frozen=True, slots=True)
class CopyToOther:
    """Copy the edited config to the other slot."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        configs = Configs(state.config, state.config)
        return state.with_history(state.history.change(configs, topic=None, wall_s=wall_s))


@dataclass(frozen=True, slots=True)
class Undo:
    """Undo the last change of the chosen method's configs."""

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        before = state.history
        after = before.undo()
        return state if after is before else state.with_history(after)


@dataclass(frozen=True, slots=True)
class Redo:
    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        before = state.history
        after = before.redo()
        return state if after is before else state.with_history(after)


def _with_config(state: ClientState, config: DetectorConfig, *, topic: object, wall_s: float) -> ClientState:
    configs = replace(state.history.present, **{state.tune.slot.lower(): config})
    return state.with_history(state.history.change(configs, topic=topic, wall_s=wall_s))
