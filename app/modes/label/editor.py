"""The editor of one browser: what a person may ask of view, cursor and labels, done to the labelling and on the disk.

A label is made when its turn to be saved comes, off the loop, from the one that is in the store by then: keys in quick
succession all count.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Final

import numpy as np

from app.modes.label.comparison import LabelComparison
from app.modes.label.label_picture import PicturePlan
from app.modes.label.label_writer import Change, LabelWriter, Saved
from app.modes.label.labelling import WINDOWS_US, ZOOMS, Labelling
from core.errors import LabelError, RallyscopeError
from labels.contacts import join_contacts
from labels.model import Label
from labels.store import LabelStore, Layer, UndoStep
from labels.store_registry import LabelStoreRegistry

RECENT: Final = 64
LOOK_EVERY_S: Final = 0.4
"""How soon what others write is seen here."""


@dataclass(frozen=True, slots=True)
class Note:
    """A short message to the person."""

    title: str
    text: str
    colour: str


EditorAct = Callable[["LabelEditor"], None]
"""What a person asks for. It belongs to no editor, so that it can be done in the one of another recording."""


@dataclass(frozen=True, slots=True)
class LabelCallbacks:
    """What the editor needs of its browser."""

    may_write: Callable[[EditorAct], bool]
    """Whether labels can be written now; if not, the act is done again once they can."""
    later: Callable[[Callable[[], None]], None]
    report: Callable[[Exception], None]
    note: Callable[[Note], None]
    seek: Callable[[int], None]


class LabelEditor:
    """Owns the labelling and the writer. All methods are called by the loop; what is written comes back by `later`."""

    def __init__(
        self, registry: LabelStoreRegistry, labelling: Labelling, callbacks: LabelCallbacks, session: str
    ) -> None:
        self.labelling = labelling
        self.callbacks = callbacks
        self.writer = LabelWriter(registry, session)
        self._act: EditorAct = lambda editor: None
        """What is being done."""
        self._looked_s = 0.0
        self._made_at: dict[tuple[Layer, frozenset[int]], int] = {}
        """Where the cursor was when several times were changed at once, by what was changed."""
        self._together: list[dict[Layer, int | None]] = []
        """Edits that were made by one act in several layers; None: the act changed nothing there, or not yet."""
        self._read_layers()

    def do(self, act: EditorAct) -> None:
        """Do what a person asks for; report what is wrong with it."""
        self._act = act
        try:
            act(self)
        except RallyscopeError as error:
            self.callbacks.report(error)

    def write(
        self,
        change: Change,
        *,
        show: bool = False,
        then: Callable[[Saved], None] = lambda saved: None,
    ) -> bool:
        """Save a change of the layer that is labelled.

        `show`: go to what was changed. `then`: called once it is on the disk. False if labels cannot be written yet:
        the act does nothing, and is done again later.
        """
        if not self.callbacks.may_write(self._act):
            return False
        self._save(self.labelling.layer, change, show, then)
        return True

    def write_all(self, changes: Mapping[str, Change]) -> bool:
        """Save changes of the same person's layers of several cameras, by camera; False as for `write`.

        Undo takes them back together.
        """
        if not self.callbacks.may_write(self._act):
            return False
        by_layer = {replace(self.labelling.layer, camera=camera): change for camera, change in changes.items()}
        edits: dict[Layer, int | None] = dict.fromkeys(by_layer)
        self._together.append(edits)
        for layer, change in by_layer.items():
            self._save(layer, _noting_edit(change, layer, edits), False, lambda saved: None)
        return True

    def note(self, title: str, text: str, colour: str = "yellow") -> None:
        """Tell the person."""
        self.callbacks.note(Note(title, text, colour))

    def follow(self, t_us: int, step_us: int) -> None:
        """The time controls stand here."""
        self.labelling = replace(self.labelling.at(t_us, time.monotonic()), step_us=step_us)

    def show(self, plan: PicturePlan) -> None:
        """These pictures are on the screen."""
        self.labelling = replace(self.labelling, shown=plan)

    def compare_with(self, compared: LabelComparison | None) -> None:
        """Somebody else's labels beside one's own, or nobody's."""
        self.labelling = replace(self.labelling, compared=compared)

    def look_again(self, wall_s: float) -> None:
        """Take up, now and then, what other browsers and programs have written into the layers that are shown."""
        if wall_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = wall_s
        self.writer.checkpoint_when_idle(wall_s)
        versions = {saved.layer: saved.version for saved in self.labelling.saved.values()}
        self.writer.look_again(versions, lambda saved: self.callbacks.later(lambda: self._take(saved)), self.failed)

    def failed(self, error: Exception) -> None:
        """Report what went wrong in another thread."""
        self.callbacks.later(lambda: self.callbacks.report(error))

    def close(self) -> None:
        """The browser or the recording is gone; what was asked for is still saved."""
        self.writer.close()

    # View and cursor ----------------------------------------------------------------------------------------------

    def change_view(self, changes: Mapping[str, Any]) -> None:
        """Take over other choices of what is shown, by the name of `LabelView`'s field."""
        now, before = self.labelling, self.labelling.view
        view = replace(before, **changes)
        if view.camera not in now.sources or view.window_us not in WINDOWS_US or view.zoom not in ZOOMS:
            return
        if (view.annotator, view.camera) != (before.annotator, before.camera):
            now, view = replace(now, compared=None), replace(view, repeat=False, centre_px=None)
        other_annotator = view.annotator != before.annotator
        self.labelling = replace(now, view=view, saved={} if other_annotator else now.saved)
        if other_annotator:
            self._read_layers()

    def other_camera(self) -> None:
        """Label the next camera of the recording."""
        names = tuple(self.labelling.sources)
        self.change_view({"camera": names[(names.index(self.labelling.view.camera) + 1) % len(names)]})

    def go_to(self, t_us: int) -> None:
        """Move the time cursor."""
        before_us = self.labelling.t_us
        self.labelling = self.labelling.at(t_us, time.monotonic())
        if t_us != before_us:
            self.callbacks.seek(t_us)

    def enter(self) -> None:
        """Go to the next time that is to be labelled, if the cursor came from elsewhere and nothing is labelled here.

        A label between those times would not count as progress.
        """
        now = self.labelling
        if now.t_us not in now.here.labels:
            self.go_to(now.grid.nearest(now.t_us))

    def step(self, steps: int) -> None:
        """Go to the next (+1) or previous (-1) time that is to be labelled, or some further."""
        self.go_to(self.labelling.grid.moved(self.labelling.t_us, steps))

    def go_to_end(self, *, last: bool) -> None:
        """Go to the last or to the first time that is to be labelled."""
        grid = self.labelling.grid
        self.go_to(grid.last_us if last else int(grid.times()[:1].sum()))

    def go_to_unchecked(self) -> None:
        """Go to the next time that nobody has looked at; round to the start once."""
        now = self.labelling
        times = now.grid.times()
        left = times[~np.isin(times, now.here.arrays.t_us)]
        if not len(left):
            self.note("Everything is checked", "No unchecked time is left in this camera.", "green")
            return
        row = int(np.searchsorted(left, now.t_us, side="right")) % len(left)
        self.go_to(int(left[row]))

    def begin_repeat(self, t_us: int) -> None:
        """Ask for the label at a time again, without showing it."""
        now = self.labelling
        self.labelling = replace(now, view=replace(now.view, repeat=True), back_us=now.t_us)
        self.go_to(t_us)

    def leave_repeat(self) -> None:
        """Go back to where a repeat annotation was begun, answered or not."""
        now = self.labelling
        if now.view.repeat:
            self.labelling = replace(now, view=replace(now.view, repeat=False))
            self.go_to(now.back_us)

    def escape(self) -> None:
        """Forget a click that waits for its radius; else leave a repeat annotation."""
        if self.labelling.asking is not None:
            self.labelling = replace(self.labelling, click=None)
        else:
            self.leave_repeat()

    # Labels ------------------------------------------------------------------------------------------------------

    def undo(self, *, redo: bool = False) -> None:
        """Take back, or bring back, what this browser changed last in this camera, and show it. What others did stays.

        What was changed in other cameras at once with it goes along, where nothing was changed since.
        """
        steps: list[UndoStep] = []
        along: list[Mapping[Layer, int | None]] = []

        def change(store: LabelStore) -> tuple[int, ...]:
            edit = store.next_step(redo=redo)
            along.extend(edits for edits in self._together if edit is not None and edits.get(here) == edit)
            steps.append(store.step_back(redo=redo))
            return steps[0].touched_us

        here = self.labelling.layer
        if not self.write(change, show=True, then=lambda _: self._note_undo(steps[0], redo)):
            return
        for layer in {layer for edits in self._together if here in edits for layer in edits if layer != here}:

            def change_along(store: LabelStore, layer: Layer = layer) -> tuple[int, ...]:
                edit = store.next_step(redo=redo)  # after `change`: they are written in turn
                is_same_act = any(edit is not None and edits.get(layer) == edit for edits in along)
                return store.step_back(redo=redo).touched_us if is_same_act else ()

            self._save(layer, change_along, True, lambda saved: None)

    def change_label(self, make: Callable[[Label | None], Label | None]) -> bool:
        """Replace the label at the cursor by what is made of it (None: impossible), after all earlier changes.

        Whether labels can be written, as `write` says.
        """
        t_us = self.labelling.t_us

        def change(store: LabelStore) -> tuple[int, ...]:
            before = store.at(t_us)
            label = make(before)
            if label is None:
                raise LabelError("nothing to change at this time", where=f"{t_us} us", remedy="click the ball first")
            if label != before:
                store.put(label)
            return (t_us,)

        return self.write(change)

    def _note_undo(self, step: UndoStep, redo: bool) -> None:
        what = "Redo" if redo else "Undo"
        if not step.done:
            text = "Undo covers only the changes of this window under this name."
            self.note(f"Nothing to {what.lower()}", text)
        elif step.left_us:
            where = f"at {step.left_us[0] / 1e6:.6f} s" if len(step.left_us) == 1 else f"at {len(step.left_us)} times"
            self.note(f"{what}: left as it is", f"Somebody else has changed the label {where} since.")

    # The disk -----------------------------------------------------------------------------------------------------

    def _read_layers(self) -> None:
        """Read the labels of every camera, the one that is labelled first; a partner's are looked at only."""
        now = self.labelling
        for camera in sorted(now.sources, key=lambda name: name != now.view.camera):
            layer = Layer(now.recording.uuid, camera, now.view.annotator)
            self.writer.look(layer, lambda saved: self.callbacks.later(lambda: self._take(saved)), self.failed)

    def _save(self, layer: Layer, change: Change, show: bool, then: Callable[[Saved], None]) -> None:
        t_us = self.labelling.t_us

        def done(saved: Saved) -> None:
            if len(saved.touched_us) > 1 and not show:
                self.callbacks.later(lambda: self._made_at.update({(layer, frozenset(saved.touched_us)): t_us}))
            self.callbacks.later(lambda: self._take(saved, show=show))
            self.callbacks.later(lambda: then(saved))

        self.writer.write(layer, change, done, self.failed)

    def _take(self, saved: Saved, *, show: bool = False) -> None:
        """The writer's answer: it is on the disk."""
        layer, now = saved.layer, self.labelling
        if layer.annotator != now.view.annotator:
            return
        if layer.blind:
            if saved.touched_us:
                self.leave_repeat()
            return
        if layer.camera not in now.saved:
            for text in saved.notes:
                self.note("Labels", text)
        known = replace(
            now.works[layer.camera],
            labels=saved.labels,
            arrays=saved.arrays,
            rejected=saved.rejected,
            contacts=saved.contacts,
            no_contacts_us=saved.no_contacts_us,
        )
        works = {**now.works, layer.camera: known}
        self.labelling = replace(
            now,
            saved={**now.saved, layer.camera: saved},
            works=works,
            contacts=reduce(join_contacts, (work.contacts for work in works.values())),
            recent_us=(*now.recent_us, *saved.touched_us)[-RECENT:],
            click=now.click if now.click is not None and now.click.t_us not in saved.touched_us else None,
        )
        if show and len(saved.touched_us) and layer.camera == now.view.camera:
            nearest_us = min(saved.touched_us, key=lambda t_us: abs(t_us - now.t_us))
            self.go_to(self._made_at.get((layer, frozenset(saved.touched_us)), nearest_us))


def _noting_edit(change: Change, layer: Layer, edits: dict[Layer, int | None]) -> Change:
    """The change, which also notes the number of its edit."""

    def noting(store: LabelStore) -> tuple[int, ...]:
        touched_us = change(store)
        if touched_us:
            edits[layer] = store.next_step()
        return touched_us

    return noting
