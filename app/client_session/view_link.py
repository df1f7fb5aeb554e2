"""The view of a browser as a link, and back: whoever opens it sees the same moment with the same settings.

A link is what stands behind the # of the address: `v=1&recording=demo&mode=Tune&t=123456&a.cluster.eps_px=3.5`. What is
as usual is left out. A link that names no method is of `auto`: it was made when that was the default. It may come from
anyone: opening one only makes the commands that the controls make.
"""

from __future__ import annotations

import contextlib
import json
import urllib.parse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from app.modes.label.kept_view import KeepLabelChoices
from app.modes.tune.commands import SetSpaceColour, ShowEventsInSpace, ShowFramesBeside
from app.modes.watch.commands import EnlargeCamera, ShowLayer, ShowSpace
from app.pictures.canvas import RENDERINGS
from app.pictures.palette import POLARITY_COLOURS
from app.state import commands
from app.state.browser_memory import default_config, differing_settings, with_settings
from app.state.client_state import (
    ARRANGEMENTS,
    MODES,
    SLOTS,
    SPACE_COLOURS,
    ClientState,
    Configs,
    RenderSettings,
    TuneView,
    WatchView,
)
from app.state.commands import Command
from core.detection.methods import METHODS, UNNAMED_METHOD, Method
from core.errors import ConfigError
from core.text import parse_json

MAX_LENGTH: Final = 4_000
VERSION: Final = "1"
_LOOK, _TUNE, _WATCH = RenderSettings(), TuneView(), WatchView()
Values = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class _Use:
    """Choose a method and put both its configs in place, as one step that can be undone."""

    method: Method
    configs: Configs

    def apply(self, state: ClientState, wall_s: float) -> ClientState:
        state = commands.SetMethod(self.method).apply(state, wall_s)
        return state.with_history(state.history.change(self.configs, topic=None, wall_s=wall_s))


def link_of(state: ClientState, now_us: int) -> str:
    """The link to what this state shows at `now_us`; without the settings where they would make it too long."""
    view = {key: text for key, text in _view(state, now_us) if text}
    base = default_config(state.tune.method)
    settings = {
        f"{slot.lower()}.{name}": json.dumps(value)
        for slot in SLOTS
        for name, value in differing_settings(state.history.present.of(slot), base).items()
    }
    link = _encode({"v": VERSION, **view, **settings})
    return link if len(link) <= MAX_LENGTH else _encode(view)


def values_of(link: str) -> Values:
    """Values of a link; empty if it is not a valid one."""
    if len(link) > MAX_LENGTH:
        return {}
    try:
        return dict(urllib.parse.parse_qsl(link, max_num_fields=300))
    except ValueError:
        return {}


PLACE: Final = ("recording", "mode", "t", "camera", "space", "large")
"""Values of a link that say where one is, not how it is looked at."""


def place_of(values: Values) -> Values:
    """The recording, mode, moment and camera of a link, with the mode also where it is the usual one."""
    return {"mode": "Watch", **{key: text for key, text in values.items() if key in PLACE}}


def commands_of(values: Values, state: ClientState) -> tuple[Command, ...]:
    """Commands that apply a link to a state with its recording open. Invalid values are ignored."""
    found: list[Command] = []
    for key, make in _COMMANDS.items():
        if key in values:
            try:
                found += make(values[key])
            except (ValueError, TypeError, OverflowError):
                continue
    method = values.get("method", UNNAMED_METHOD)
    if values.get("v") == VERSION and method in METHODS:
        with contextlib.suppress(ConfigError, ValueError, TypeError, RecursionError):
            found.append(_Use(method, _configs(values, method)))  # type: ignore[arg-type]
    return tuple(found)


def _view(state: ClientState, now_us: int) -> Iterator[tuple[str, str]]:
    """All values of the view by key; "" for defaults."""
    look, tune, watch = state.look, state.tune, state.watch
    yield "recording", state.recording
    yield "mode", state.mode if state.mode != "Watch" else ""
    # A live view that follows has no time of its own.
    yield "t", "" if state.playhead.following else str(now_us)
    yield "camera", state.camera if state.camera != state.cameras[0] else ""
    yield "speed", f"{state.playhead.speed:g}"
    loop = state.playhead.loop_us
    yield "loop", "" if loop is None else f"{loop[0]},{loop[1]}"
    yield "marks", ",".join(map(str, state.marks_us))
    yield "step", str(state.step_us) if state.step_us != 1_000 else ""
    yield "window", str(look.window_us) if look.window_us != _LOOK.window_us else ""
    yield "draw", look.rendering if look.rendering != _LOOK.rendering else ""
    yield "colours", look.colours if look.colours != _LOOK.colours else ""
    yield "arrange", look.arrangement if look.arrangement != _LOOK.arrangement else ""
    yield "magnify", "0" if not look.magnifies_ball else ""
    yield "stage", tune.overlay if tune.overlay != _TUNE.overlay else ""
    yield "zoom", f"{tune.zoom:g}" if tune.zoom != _TUNE.zoom else ""
    yield "at", "{:.1f},{:.1f}".format(*tune.centre_px) if tune.centre_px is not None else ""
    yield "slot", tune.slot if tune.slot != _TUNE.slot else ""
    yield "compare", "1" if tune.compare else ""
    yield "method", tune.method if tune.method != UNNAMED_METHOD else ""
    yield "methods", ",".join(tune.compared) if tune.compared != _TUNE.compared else ""
    yield "beside", "1" if tune.side_by_side else ""
    yield "truth", "0" if not tune.show_truth else ""
    yield "events", "3d" if tune.in_space else ""
    yield "events-colour", tune.space_colour if tune.space_colour != _TUNE.space_colour else ""
    yield "frames", tune.frames
    yield "space", "0" if not watch.in_space else ""
    yield "large", watch.large
    yield "hidden", ",".join(sorted(watch.hidden))
    yield "label_zoom", f"{state.label.zoom:g}" if state.label.zoom != 1.0 else ""
    yield "compare_with", state.label.compared
    yield "proposed", "1" if state.label.proposed else ""


_COMMANDS: Final[Mapping[str, Callable[[str], list[Command]]]] = {
    "mode": lambda text: [commands.SetMode(_one(text, MODES))],  # type: ignore[arg-type]
    "camera": lambda text: [commands.SetCamera(text)],
    "speed": lambda text: [commands.SetPlaybackSpeed(float(text))],
    "t": lambda text: [commands.StopAt(int(text))],
    "loop": lambda text: [commands.Loop(_section(text))],
    "marks": lambda text: [commands.ToggleMark(int(one)) for one in dict.fromkeys(text.split(","))],
    "step": lambda text: [commands.SetStep(int(text))],
    "window": lambda text: [commands.SetWindow(int(text))],
    "draw": lambda text: [commands.SetRendering(_one(text, RENDERINGS))],  # type: ignore[arg-type]
    "colours": lambda text: [commands.SetColours(_one(text, POLARITY_COLOURS))],  # type: ignore[arg-type]
    "arrange": lambda text: [commands.SetArrangement(_one(text, ARRANGEMENTS))],  # type: ignore[arg-type]
    "magnify": lambda text: [commands.MagnifyBall(text != "0")],
    "stage": lambda text: [commands.SetOverlay(text)],
    "zoom": lambda text: [commands.SetZoom(float(text))],
    "at": lambda text: [commands.LookAt(_point(text))],
    "slot": lambda text: [commands.SetSlot(_one(text, SLOTS))],  # type: ignore[arg-type]
    "compare": lambda text: [commands.SetCompare(text == "1")],
    "method": lambda text: [commands.SetMethod(_one(text, METHODS))],  # type: ignore[arg-type]
    "methods": lambda text: [
        commands.CompareMethod(name, name in text.split(","))  # type: ignore[arg-type]
        for name in METHODS
    ],
    "beside": lambda text: [commands.SetSideBySide(text == "1")],
    "truth": lambda text: [commands.ShowTruth(text != "0")],
    "events": lambda text: [ShowEventsInSpace(text == "3d")],
    "events-colour": lambda text: [SetSpaceColour(_one(text, SPACE_COLOURS))],  # type: ignore[arg-type]
    "frames": lambda text: [ShowFramesBeside(text)],
    "space": lambda text: [ShowSpace(text != "0")],
    "large": lambda text: [EnlargeCamera(text)],
    "hidden": lambda text: [ShowLayer(layer, on=False) for layer in text.split(",")[:32]],
    "label_zoom": lambda text: [KeepLabelChoices(zoom=float(text))],
    "compare_with": lambda text: [KeepLabelChoices(compared=text)],
    "proposed": lambda text: [KeepLabelChoices(proposed=text == "1")],
}
"""Commands by key, in the order in which they are applied."""


def _configs(values: Values, method: Method) -> Configs:
    base = default_config(method)
    by_slot: dict[str, dict[str, object]] = {slot: {} for slot in SLOTS}
    for key, text in values.items():
        slot, dot, name = key.partition(".")
        if dot and slot.upper() in by_slot:
            by_slot[slot.upper()][name] = parse_json(text)
    return Configs(with_settings(base, by_slot["A"]), with_settings(base, by_slot["B"]))


def _one(text: str, allowed) -> str:
    if text not in allowed:
        raise ValueError(text)
    return text


def _point(text: str) -> tuple[float, float]:
    x, y = map(float, text.split(","))
    return x, y


def _section(text: str) -> tuple[int, int]:
    start, end = map(int, text.split(","))
    return start, end


def _encode(values: Values) -> str:
    return urllib.parse.urlencode(values, safe=",.")
