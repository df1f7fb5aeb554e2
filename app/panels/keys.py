"""The list of keys, the last tab of the floating panel below the pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import viser

from app.formatting import PAGE
from app.state.client_state import MODES, MOST_VIEWS, ClientState, ModeName
from app.state.commands import Command, LookAt, Redo, SetMode, ShowStage, StepTime, TogglePlay, Undo
from app.widgets import when_triggered

KEYS: Final[tuple[tuple[str, str, Command], ...]] = (
    ("space", "Play or pause", TogglePlay()),
    ("N", "One step forward (also the right arrow)", StepTime(+1)),
    ("P", "One step back (also the left arrow)", StepTime(-1)),
    ("pageup", "Ten steps back", StepTime(-10)),
    ("pagedown", "Ten steps forward", StepTime(+10)),
    ("Z", "Undo a slider", Undo()),
    ("R", "Redo a slider", Redo()),
    ("B", "Zoomed view follows the ball", LookAt(None)),
    *((str(number), f"Stage {number} of the method", ShowStage(number)) for number in range(1, MOST_VIEWS + 1)),
    ("M", "Mode: Watch", SetMode("Watch")),
    ("T", "Mode: Tune", SetMode("Tune")),
    ("O", "Mode: Export", SetMode("Export")),
)
"""Hotkey, what it does, the command. W A S D Q E are left out: viser's camera uses them."""
MODE_KEYS: Final = (
    ("Shift 1 to 5", f"Mode: {', '.join(MODES)}"),
    ("M, T, O", "Mode: Watch, Tune, Export; Label and Train have no letter"),
)
PAGE_KEYS: Final = (
    ("J", "Slower; while paused ten steps back"),
    ("K", "Play or pause"),
    ("L", "Play; each further press faster"),
    ("[ and ]", "To the previous or next mark, bounce, hit or miss"),
    ("'", "Mark this moment"),
    ("Home, End", "To the start and the end"),
    ("Ctrl O", "Open a file"),
)
"""Keys of the time bar and of the file dialog, which the page itself handles."""


TUNE_ONLY: Final = (ShowStage, LookAt)
"""Commands of keys that change only what Tune shows."""


def key_has_effect(command: Command, before: ClientState, after: ClientState, *, uses_recording: bool) -> bool:
    """Whether a key's command changes anything that its mode shows; only some modes show a recording."""
    if isinstance(command, SetMode):
        return True
    shown = uses_recording and (before.mode == "Tune" or not isinstance(command, TUNE_ONLY))
    return shown and before != after


def idle_key_text(command: Command, mode: ModeName) -> str:
    """Line about a key that does nothing."""
    key, label = next((key, label) for key, label, one in KEYS if one == command)
    return f"Key {key} ({label}) changes nothing here in {mode}."


def add_keys(
    gui: viser.GuiApi,
    send: Callable[[Command], None],
    reframe: Callable[[], None],
    others: Mapping[str, Callable[[], None]],
) -> None:
    """Register the shortcuts for one browser; they are listed in its command palette (Ctrl-K), too.

    `others` are in the palette only, by their names.
    """

    def register(key: str, label: str, act: Callable[[], None]) -> None:
        when_triggered(gui.add_command(label, hotkey=key), act)  # type: ignore[arg-type]

    for key, label, command in KEYS:
        register(key, label, lambda command=command: send(command))
    register("F", "Reset the picture's view", reframe)
    for label, act in others.items():
        when_triggered(gui.add_command(label), act)
    for mode in ("Label", "Train"):  # their letters are taken; they are in the palette only
        when_triggered(gui.add_command(f"Mode: {mode}"), lambda mode=mode: send(SetMode(mode)))


def tour_buttons_html() -> str:
    """HTML of the buttons of the tour and of the lessons, which the page's script handles."""
    style = "padding:2px 10px;border:1px solid #4a4e59;border-radius:4px;background:none;color:inherit;cursor:pointer"
    buttons = {"tour": "Show the tour", "lesson": "Lessons"}
    return " ".join(
        f"<button type='button' data-rallyscope='{name}' style='{style}'>{text}</button>"
        for name, text in buttons.items()
    )


def keys_html() -> str:
    """HTML of the list of keys."""
    stages = (f"1 to {MOST_VIEWS}", "Stages of the method, in Tune")
    own = ((key, label) for key, label, one in KEYS if not isinstance(one, ShowStage | SetMode))
    listed = (*MODE_KEYS, *own, stages, *PAGE_KEYS)
    rows = "".join(
        f"<tr><td style='padding-right:14px'><b>{key}</b></td><td>{label}</td></tr>" for key, label in listed
    )
    frame = "<tr><td><b>F</b></td><td>Reset the picture's view</td></tr>"
    hint = f"Enter and Escape leave a field: then the keys work again. What the words mean: {PAGE}."
    return (
        f"<div style='font-size:12.5px;padding:4px 12px'>{hint} {tour_buttons_html()}<table>{rows}{frame}</table></div>"
    )


X_PX: Final = 8
Y_PX: Final = -86
"""Position of the panel above the time bar."""
WIDTH_PX: Final = 860
HEIGHT_PX: Final = 158
"""Size until the page's script gives it the width of the picture, and the height that was chosen in this browser."""


def place_below_pictures(gui: viser.GuiApi, panel: viser.PanelHandle) -> None:
    """Add the list of keys as the last tab, and let the panel float in its place.

    The page's script (`lower.js`) recognises the panel by that tab.
    """
    with panel.add_tab("Keys", viser.Icon.KEYBOARD):
        gui.add_html(keys_html())
    panel.float(x=X_PX, y=Y_PX, width=WIDTH_PX, height=HEIGHT_PX)
