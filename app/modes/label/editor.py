"""Carries commands out: the labelling of one browser as it is now, and its labels on the disk."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from app.modes.label.commands.cursor import GoTo, LeaveSecondLook
from app.modes.label.commands.step import LabelCommand, LabelEdit, Note
from app.modes.label.label_writer import LabelWriter, LayerKey, Saved
from app.modes.label.labelling import Labelling
from app.modes.label.plan import PicturePlan
from core.errors import RallyscopeError
from labels.store_registry import LabelStoreRegistry

RECENT: Final = 64
LOOK_EVERY_S: Final = 0.4
"""How soon what others write is seen here."""


@dataclass(frozen=True, slots=True)
class LabelCallbacks:
    """What the editor needs of its browser."""

    may_write: Callable[[LabelCommand], bool]
    """Whether labels can be written now; if not, the command is sent again once they can."""
    later: Callable[[Callable[[], None]], None]
    report: Callable[[Exception], None]
    note: Callable[[Note], None]
    seek: Callable[[int], None]


class LabelEditor:
    """Owns the state and the writer. All methods are called by the loop; answers of the writer come through `later`."""

    def __init__(
        self, registry: LabelStoreRegistry, labelling: Labelling, callbacks: LabelCallbacks, session: str
    ) -> None:
        self.labelling = labelling
        self.callbacks = callbacks
        self.writer = LabelWriter(registry, labelling.recording.uuid, session)
        self._looked_s = 0.0
        self._read_layers()

    def send(self, command: LabelCommand) -> None:
        """Apply a command, save what it asks for, and move the time cursor where it says."""
        before = self.labelling
        try:
            step = command.apply(before, time.monotonic())
        except RallyscopeError as error:
            self.callbacks.report(error)
            return
        if step.edit is not None and not self.callbacks.may_write(command):
            return
        self.labelling = step.labelling
        if step.edit is not None:
            self._save(before.layer, step.edit)
        if step.partner_edit is not None and before.partner is not None:
            self._save(replace(before.layer, camera=before.partner.name), step.partner_edit)
        if step.note is not None:
            self.callbacks.note(step.note)
        if step.labelling.view.annotator != before.view.annotator:
            self._read_layers()
        if step.labelling.t_us != before.t_us:
            self.callbacks.seek(step.labelling.t_us)

    def follow(self, t_us: int, step_us: int) -> None:
        """The time controls stand here."""
        self.labelling = replace(self.labelling.at(t_us, time.monotonic()), step_us=step_us)

    def show(self, plan: PicturePlan) -> None:
        """These pictures are on the screen."""
        self.labelling = replace(self.labelling, shown=plan)

    def look_again(self, wall_s: float) -> None:
        """Take up, now and then, what other browsers and programs have written into the layers that are shown."""
        if wall_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = wall_s
        versions = {saved.layer: saved.version for saved in self.labelling.saved.values()}
        self.writer.look_again(versions, lambda saved: self.callbacks.later(lambda: self._take(saved)), self.failed)

    def close(self) -> None:
        """The browser or the recording is gone; what was asked for is still saved."""
        self.writer.close()

    def failed(self, error: Exception) -> None:
        """Report what went wrong in another thread."""
        self.callbacks.later(lambda: self.callbacks.report(error))

    def _read_layers(self) -> None:
        """Read the labels of every camera, the one that is labelled first; a partner's are looked at only."""
        view = self.labelling.view
        for camera in sorted(self.labelling.sources, key=lambda name: name != view.camera):
            layer = LayerKey(camera, view.annotator)
            self.writer.look(layer, lambda saved: self.callbacks.later(lambda: self._take(saved)), self.failed)

    def _save(self, layer: LayerKey, edit: LabelEdit) -> None:
        def done(saved: Saved) -> None:
            self.callbacks.later(lambda: self._take(saved, show=edit.show))
            note = None if edit.said is None else edit.said(saved)
            if note is not None:
                self.callbacks.later(lambda: self.callbacks.note(note))
            command = None if edit.then is None else edit.then(saved)
            if command is not None:
                self.callbacks.later(lambda: self.send(command))

        self.writer.act(layer, edit.act, done, self.failed)

    def _take(self, saved: Saved, *, show: bool = False) -> None:
        """The writer's answer: it is on the disk."""
        layer, now = saved.layer, self.labelling
        if layer.annotator != now.view.annotator:
            return
        if layer.blind:
            if saved.touched_us:
                self.send(LeaveSecondLook())
            return
        if layer.camera not in now.saved:
            for text in saved.notes:
                self.callbacks.note(Note("Labels", text, "yellow"))
        known = replace(now.works[layer.camera], labels=saved.labels, arrays=saved.arrays, rejected=saved.rejected)
        self.labelling = replace(
            now,
            saved={**now.saved, layer.camera: saved},
            works={**now.works, layer.camera: known},
            recent_us=(*now.recent_us, *saved.touched_us)[-RECENT:],
            click=now.click if now.click is not None and now.click.t_us not in saved.touched_us else None,
        )
        if show and len(saved.touched_us) and layer.camera == now.view.camera:
            nearest_us = min(saved.touched_us, key=lambda t_us: abs(t_us - now.t_us))
            self.send(GoTo(nearest_us))
