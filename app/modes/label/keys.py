"""The keys of Label: which there are, what they do, and those that wait for what they judge.

Left out of the table: W A S D Q E and the arrows, which move viser's camera; M T O without Shift, which choose a mode;
what a browser keeps for itself. Y G H B lie round each other like arrows.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Final, Literal

from app.modes.label.accepting import accept, accept_all, accept_segment, interpolate, reject
from app.modes.label.by_hand import clear, copy_previous, nudge, resize, set_state, snap_label
from app.modes.label.conflicts import go_to_conflict, resolve_conflict, take_missing
from app.modes.label.contacts import accept_contact, next_contact, remove_contact, set_contact
from app.modes.label.editor import EditorAct, LabelEditor
from app.modes.label.labelling import BIG_NUDGE_PX, NUDGE_PX, RADIUS_STEP_PX, WINDOWS_US, ZOOMS
from app.panels.keys import MODE_KEYS
from labels.model import ContactKind, LabelState

Modifier = Literal["shift"]

NO_CONTACT: Final = "No bounce, hit or net touch here: remove it, or reject the proposed one"

KEYS: Final[tuple[tuple[str, Modifier | None, str, str], ...]] = (
    ("space", None, "accept", "Accept the proposal; next time"),
    ("enter", None, "accept_segment", "Accept the proposals around the cursor that lie on one smooth path"),
    ("space", "shift", "accept_flight", "Accept the whole flight around the cursor, in all cameras"),
    ("U", "shift", "accept_all", "Accept the proposals at this time in all cameras; next time"),
    ("R", None, "reject", "Reject the proposal"),
    ("N", None, "next", "Next time"),
    ("P", None, "previous", "Previous time"),
    ("pagedown", None, "ten_on", "Ten times forward"),
    ("pageup", None, "ten_back", "Ten times back"),
    ("home", None, "first", "First time"),
    ("end", None, "last", "Last time"),
    ("U", None, "unchecked", "Next unchecked time"),
    ("K", None, "suspicious", "Next item to check: a label, a proposal or a gap"),
    ("K", "shift", "blind", "A second look, blind, to measure your own noise"),
    ("X", None, "no_ball", "No ball here"),
    ("X", "shift", "out_of_frame", "The ball is out of the picture"),
    ("V", None, "visible", "The ball is visible"),
    ("V", "shift", "partly", "The ball is partly covered (partly occluded)"),
    ("C", "shift", "occluded", "The ball is covered (occluded)"),
    ("C", None, "copy", "Copy the previous label here"),
    ("R", "shift", "snap", "Snap the label to the events"),
    ("I", None, "propose", "Propose: run the detector from here on"),
    ("I", "shift", "interpolate", "Interpolate between the labels around the cursor"),
    ("T", "shift", "bounce", "A bounce on the table is here, or moves here"),
    ("O", "shift", "hit", "A hit by a racket is here, or moves here"),
    ("M", "shift", "net", "A touch of the net is here, or moves here"),
    ("enter", "shift", "accept_contact", "Accept the proposed bounce, hit or net touch; next proposed one"),
    ("L", "shift", "next_contact", "Next bounce, hit or net touch, labelled or proposed"),
    ("delete", "shift", "remove_contact", NO_CONTACT),
    ("backspace", "shift", "remove_contact", NO_CONTACT),
    ("Y", None, "up", "Nudge up 0.25 px (with Shift 1 px)"),
    ("B", None, "down", "Nudge down"),
    ("G", None, "left", "Nudge left"),
    ("H", None, "right", "Nudge right"),
    ("Y", "shift", "up_more", "Nudge up 1 px"),
    ("B", "shift", "down_more", "Nudge down 1 px"),
    ("G", "shift", "left_more", "Nudge left 1 px"),
    ("H", "shift", "right_more", "Nudge right 1 px"),
    ("pageup", "shift", "larger", "Radius 0.25 px larger"),
    ("pagedown", "shift", "smaller", "Radius 0.25 px smaller"),
    ("Z", None, "undo", "Undo"),
    ("Z", "shift", "redo", "Redo"),
    ("delete", None, "clear", "Delete the label: unchecked again"),
    ("backspace", None, "clear", "Delete the label: unchecked again"),
    ("escape", None, "escape", "Discard a click without a circle; leave the second look"),
    ("N", "shift", "next_conflict", "Next conflict with the labels that you compare with"),
    ("P", "shift", "previous_conflict", "Previous conflict"),
    ("J", None, "take_mine", "Conflict: yours is right; on to the next"),
    ("L", None, "take_theirs", "Conflict: theirs is right; on to the next"),
    ("J", "shift", "take_mean", "Conflict: the mean of both; on to the next"),
    ("0", None, "camera", "Next camera"),
    ("1", None, "window_0", "Window 0.5 ms"),
    ("2", None, "window_1", "Window 1 ms"),
    ("3", None, "window_2", "Window 2 ms"),
    ("4", None, "window_3", "Window 5 ms"),
    ("5", None, "window_4", "Window 10 ms"),
    ("6", None, "zoom_0", "Whole picture"),
    ("7", None, "zoom_1", "Zoom 5x"),
    ("8", None, "zoom_2", "Zoom 10x"),
    ("9", None, "zoom_3", "Zoom 20x"),
    ("F", "shift", "rendering", "Show events by polarity, by count or by age: the next of these"),
)
"""Hotkey, modifier, name of the act, what it does."""


def label_keys_html() -> str:
    """The list that the app shows."""
    own = ((_shown(key, modifier), text) for key, modifier, name, text in KEYS if not name.endswith("_more"))
    rows = "".join(
        f"<tr><td style='padding-right:14px;white-space:nowrap'><b>{key}</b></td><td>{text}</td></tr>"
        for key, text in (*own, *MODE_KEYS)
    )
    hint = "Keys work wherever the mouse is; Enter and Escape leave a field. Drag: from the centre to the rim."
    return f"<div style='font-size:12.5px;padding:4px 12px'>{hint}<table>{rows}</table></div>"


def idle_key_text(name: str) -> str:
    """Line about an act that changed nothing."""
    for key, modifier, act, text in KEYS:
        if act == name:
            return f"Key {_shown(key, modifier)} ({text}) changes nothing here."
    return "There is nothing to do here."


def _shown(key: str, modifier: Modifier | None) -> str:
    return f"{modifier.title()} {key}" if modifier else key


class HeldKeys:
    """The keys that one browser holds down. Methods are called by the loop.

    `waits(name)`: this act cannot be carried out yet. `place()`: what it would be about; when that becomes something
    else while an act waits, the person went elsewhere, and what was held is forgotten.
    """

    def __init__(
        self, carry_out: Callable[[str], None], waits: Callable[[str], bool], place: Callable[[], object]
    ) -> None:
        self._carry_out = carry_out
        self._waits = waits
        self._place = place
        self._held: deque[str] = deque()
        self._held_at: object = None

    def __len__(self) -> int:
        return len(self._held)

    @property
    def ready(self) -> bool:
        """Something is held that need not be held any longer."""
        return bool(self._held) and (self._place() != self._held_at or not self._waits(self._held[0]))

    def press(self, name: str) -> None:
        """Carry out an act after all that are held. Escape forgets those; what waits last waits once."""
        if self._held and name == "escape":
            self._held.clear()
        elif not (self._held and self._held[-1] == name and self._waits(name)):
            self._held.append(name)
            if len(self._held) == 1:
                self._held_at = self._place()
                self.go_on()

    def go_on(self) -> None:
        """Carry out what is held, up to an act that must wait."""
        if self._held and self._place() != self._held_at:
            self._held.clear()
        while self._held and not self._waits(self._held[0]):
            self._carry_out(self._held.popleft())
            self._held_at = self._place()

    def forget(self) -> None:
        """What was pressed is not to be done any more."""
        self._held.clear()


def _view(**changes: object) -> EditorAct:
    return lambda editor: editor.change_view(changes)


ACTS: Final[Mapping[str, EditorAct]] = {
    "accept": accept,
    "accept_all": accept_all,
    "accept_segment": accept_segment,
    "reject": reject,
    "next": lambda editor: editor.step(+1),
    "previous": lambda editor: editor.step(-1),
    "ten_on": lambda editor: editor.step(+10),
    "ten_back": lambda editor: editor.step(-10),
    "first": lambda editor: editor.go_to_end(last=False),
    "last": lambda editor: editor.go_to_end(last=True),
    "unchecked": LabelEditor.go_to_unchecked,
    "no_ball": lambda editor: set_state(editor, LabelState.NO_BALL),
    "out_of_frame": lambda editor: set_state(editor, LabelState.OUT_OF_FRAME),
    "visible": lambda editor: set_state(editor, LabelState.VISIBLE),
    "partly": lambda editor: set_state(editor, LabelState.PARTLY_OCCLUDED),
    "occluded": lambda editor: set_state(editor, LabelState.OCCLUDED),
    "copy": copy_previous,
    "snap": snap_label,
    "interpolate": interpolate,
    **{str(kind): lambda editor, kind=kind: set_contact(editor, kind) for kind in ContactKind},
    "accept_contact": accept_contact,
    "next_contact": next_contact,
    "remove_contact": remove_contact,
    "up": lambda editor: nudge(editor, 0, -NUDGE_PX),
    "down": lambda editor: nudge(editor, 0, NUDGE_PX),
    "left": lambda editor: nudge(editor, -NUDGE_PX, 0),
    "right": lambda editor: nudge(editor, NUDGE_PX, 0),
    "up_more": lambda editor: nudge(editor, 0, -BIG_NUDGE_PX),
    "down_more": lambda editor: nudge(editor, 0, BIG_NUDGE_PX),
    "left_more": lambda editor: nudge(editor, -BIG_NUDGE_PX, 0),
    "right_more": lambda editor: nudge(editor, BIG_NUDGE_PX, 0),
    "larger": lambda editor: resize(editor, RADIUS_STEP_PX),
    "smaller": lambda editor: resize(editor, -RADIUS_STEP_PX),
    "undo": LabelEditor.undo,
    "redo": lambda editor: editor.undo(redo=True),
    "clear": clear,
    "escape": LabelEditor.escape,
    "next_conflict": lambda editor: go_to_conflict(editor, +1),
    "previous_conflict": lambda editor: go_to_conflict(editor, -1),
    "take_mine": lambda editor: resolve_conflict(editor, "mine"),
    "take_theirs": lambda editor: resolve_conflict(editor, "theirs"),
    "take_mean": lambda editor: resolve_conflict(editor, "mean"),
    "take_missing": take_missing,
    "camera": LabelEditor.other_camera,
    **{f"window_{row}": _view(window_us=window_us) for row, window_us in enumerate(WINDOWS_US)},
    **{f"zoom_{row}": _view(zoom=zoom) for row, zoom in enumerate(ZOOMS)},
}
"""What an act does to the labels, by the name that `KEYS` or a button gives it."""

Judged = Literal["picture", "proposals"]
JUDGES: Final[Mapping[str, Judged]] = {
    **dict.fromkeys((*map(str, ContactKind), "accept_contact", "remove_contact"), "picture"),
    **dict.fromkeys(("accept_segment", "accept_flight"), "proposals"),
}
"""What an act judges at the cursor and waits for, by name; else a quick step and key would do nothing.

The picture, or the proposals round the cursor and their picture. All others act at once, or on what is shown by then.
"""
