"""The keys of Label mode, in one table that is also what the app lists.

Left out: W A S D Q E and the arrows, which move viser's camera; M T O, which choose a mode; what a browser keeps
for itself. Y G H B lie round each other like arrows.
"""

from __future__ import annotations

from typing import Final, Literal

Modifier = Literal["shift"]

KEYS: Final[tuple[tuple[str, Modifier | None, str, str], ...]] = (
    ("space", None, "accept", "Accept what is proposed, and go on"),
    ("enter", None, "accept_segment", "Accept the whole steady segment round here"),
    ("space", "shift", "accept_flight", "Accept the whole flight round here, in both cameras"),
    ("R", None, "reject", "Reject what is proposed"),
    ("N", None, "next", "Next time"),
    ("P", None, "previous", "Previous time"),
    ("pagedown", None, "ten_on", "Ten on"),
    ("pageup", None, "ten_back", "Ten back"),
    ("home", None, "first", "First time"),
    ("end", None, "last", "Last time"),
    ("U", None, "unchecked", "Next unchecked time"),
    ("K", None, "suspicious", "What would change the score most: a label, a proposal or a hole"),
    ("K", "shift", "blind", "A second look, blind, to measure your own noise"),
    ("X", None, "no_ball", "No ball here"),
    ("X", "shift", "out_of_frame", "Out of frame"),
    ("V", None, "visible", "Visible"),
    ("V", "shift", "partly", "Partly occluded"),
    ("C", "shift", "occluded", "Occluded (covered)"),
    ("C", None, "copy", "Copy the previous label here"),
    ("R", "shift", "snap", "Snap the label to the events"),
    ("I", None, "propose", "Propose: run the detector from here on"),
    ("I", "shift", "interpolate", "Interpolate between the labels round here"),
    ("enter", "shift", "break", "A bounce or hit is here: no interpolation across"),
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
    ("delete", None, "clear", "Unchecked again"),
    ("backspace", None, "clear", "Unchecked again"),
    ("escape", None, "escape", "Forget a click without a circle; leave the second look"),
    ("N", "shift", "next_conflict", "Next conflict with whom you compare"),
    ("P", "shift", "previous_conflict", "Previous conflict"),
    ("J", None, "take_mine", "Conflict: yours is right; on to the next"),
    ("L", None, "take_theirs", "Conflict: theirs is right; on to the next"),
    ("J", "shift", "take_mean", "Conflict: the mean of both; on to the next"),
    ("0", None, "camera", "Other camera"),
    ("1", None, "window_0", "Window 0.5 ms"),
    ("2", None, "window_1", "Window 1 ms"),
    ("3", None, "window_2", "Window 2 ms"),
    ("4", None, "window_3", "Window 5 ms"),
    ("5", None, "window_4", "Window 10 ms"),
    ("6", None, "zoom_0", "Whole picture"),
    ("7", None, "zoom_1", "Zoom 5x"),
    ("8", None, "zoom_2", "Zoom 10x"),
    ("9", None, "zoom_3", "Zoom 20x"),
    ("F", "shift", "rendering", "Polarity, count, time surface"),
)
"""Hotkey, modifier, name of the act, what it does."""


def label_keys_html() -> str:
    """The list that the app shows."""
    rows = "".join(
        f"<tr><td style='padding-right:14px;white-space:nowrap'><b>{_shown(key, modifier)}</b></td><td>{text}</td></tr>"
        for key, modifier, name, text in KEYS
        if not name.endswith("_more")
    )
    hint = "Keys work wherever the mouse is, not while a field has the cursor. Drag: from the centre to the rim."
    return f"<div style='font-size:12.5px;padding:4px 12px'>{hint}<table>{rows}</table></div>"


def _shown(key: str, modifier: Modifier | None) -> str:
    return f"{modifier.title()} {key}" if modifier else key
