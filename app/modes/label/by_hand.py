"""Labels by hand: a ball that is placed, moved, resized, named, copied, snapped or cleared at the cursor."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Final

from app.modes.label.editor import LabelEditor
from app.modes.label.label_changes import ShownPicture, copied, label_from_click, moved, placed, snapped, with_state
from app.modes.label.labelling import UnfitClick
from app.modes.label.sightings import draft_at
from app.modes.label.sources import LabelSource
from core.errors import LabelError
from core.events import Events
from labels.model import Label, LabelState
from labels.store import LabelStore

SNAP_REACH_US: Final = 17_000
MIN_RADIUS_PX: Final = 0.5
FIRST_RADIUS_PX: Final = 5.0
"""What a radius that was never given is resized from."""


def place_ball(editor: LabelEditor, x_px: float, y_px: float, r_px: float | None = None) -> None:
    """The ball is here, in the picture that is shown; with a radius where a circle was drawn.

    Where no circle fits and no radius is known, nothing is stored: the person is asked how large the ball is.
    """
    now, shown = editor.labelling, editor.labelling.shown
    if shown is None or shown.main.camera != now.view.camera or (r_px is not None and r_px <= 0):
        return
    t_us, source = shown.t_us, now.source
    picture = now.at(t_us, now.arrived_s).picture_to_label(time.monotonic())
    draft = draft_at(now, t_us) if shown.shows_draft else None  # one that came later corrects nothing
    # A drawn circle is what the person sees: it is not moved.
    snaps = now.view.snap and source.stream is not None and r_px is None
    unfit: list[UnfitClick] = []

    def change(store: LabelStore) -> tuple[int, ...]:
        label = label_from_click(x_px, y_px, picture, store.at(t_us), draft, r_px=r_px)
        label = snapped(label, events_near(source, t_us)) if snaps else label
        if label.r_px is None:
            unfit.append(UnfitClick(now.layer, t_us, x_px, y_px, snaps))
            return ()
        store.put(label)
        return (t_us,)

    if editor.write(change, then=lambda _: _ask_radius(editor, unfit[0]) if unfit else None):
        editor.labelling = replace(editor.labelling, click=None)
        if now.view.advance and t_us == now.t_us:
            _advance(editor)


def set_numbers(editor: LabelEditor, x_px: float, y_px: float, r_px: float | None) -> None:
    """Position and radius typed in."""
    picture = _picture(editor)

    def make(before: Label | None) -> Label:
        if r_px is None and (before is None or before.r_px is not None):
            remedy = "type one, or drag from the centre to the rim"
            raise LabelError("a ball needs a radius", expected="above 0 px", got="0", remedy=remedy)
        if before is None:
            return label_from_click(x_px, y_px, picture, None, None, r_px=r_px)
        return placed(before, x_px, y_px, r_px, picture)

    editor.change_label(make)


def nudge(editor: LabelEditor, dx_px: float, dy_px: float) -> None:
    """Move the label a little."""
    picture = _picture(editor)
    editor.change_label(lambda before: moved(before, dx_px, dy_px, picture) if before else None)


def resize(editor: LabelEditor, by_px: float) -> None:
    """Make the radius larger or smaller."""
    picture, click = _picture(editor), editor.labelling.asking

    def make(before: Label | None) -> Label | None:
        if before is None and click is not None:
            return label_from_click(click.x_px, click.y_px, picture, None, None, r_px=FIRST_RADIUS_PX + by_px)
        if before is None or before.x_px is None or before.y_px is None:
            return None
        r_px = max((before.r_px or FIRST_RADIUS_PX) + by_px, MIN_RADIUS_PX)
        return placed(before, before.x_px, before.y_px, r_px, picture)

    editor.change_label(make)


def set_state(editor: LabelEditor, state: LabelState) -> None:
    """Say what is seen; go on after the states that need no position."""
    picture, draft = _picture(editor), draft_at(editor.labelling, editor.labelling.t_us)
    away = state in (LabelState.NO_BALL, LabelState.OUT_OF_FRAME)
    if editor.change_label(lambda before: with_state(state, before, draft, picture)) and away:
        _advance(editor)


def copy_previous(editor: LabelEditor) -> None:
    """The latest label before this time, here too."""
    t_us, picture = editor.labelling.t_us, _picture(editor)

    def change(store: LabelStore) -> tuple[int, ...]:
        earlier = store.labels().between(0, t_us)
        label = store.at(int(earlier.t_us[-1])) if len(earlier) else None
        if label is None:
            raise LabelError("no label before this time", where=f"{t_us} us")
        store.put(copied(label, picture))
        return (t_us,)

    editor.write(change)


def snap_label(editor: LabelEditor) -> None:
    """Move the label to the circle that fits the events."""
    t_us, source = editor.labelling.t_us, editor.labelling.source
    editor.change_label(
        lambda before: snapped(before, events_near(source, t_us)) if before and before.x_px is not None else None
    )


def clear(editor: LabelEditor) -> None:
    """Make a time unchecked again."""
    t_us = editor.labelling.t_us

    def change(store: LabelStore) -> tuple[int, ...]:
        if not store.delete(t_us):
            raise LabelError("nothing to clear at this time", got="no label", where=f"{t_us} us")
        return (t_us,)

    editor.write(change)


def _picture(editor: LabelEditor) -> ShownPicture:
    return editor.labelling.picture_to_label(time.monotonic())


def _advance(editor: LabelEditor) -> None:
    """Go on to the next time; a repeat annotation ends by itself."""
    if not editor.labelling.view.repeat:
        editor.step(+1)


def _ask_radius(editor: LabelEditor, click: UnfitClick) -> None:
    """A click found no circle: nothing is stored until somebody says how large the ball is."""
    if editor.labelling.layer == click.layer:
        editor.go_to(click.t_us)
        editor.labelling = replace(editor.labelling, click=click)


def events_near(source: LabelSource, t_us: int) -> Events:
    """The events that a label at a time is snapped to."""
    return source.events(max(t_us - SNAP_REACH_US, 0), t_us + SNAP_REACH_US)
