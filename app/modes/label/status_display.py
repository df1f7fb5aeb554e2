"""Label's panel and time bar follow the labelling: each part is worked out and sent when it changed."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.modes.label.editor import LabelEditor
from app.modes.label.labelling import Labelling
from app.modes.label.panel import LabelPanel
from app.modes.label.sightings import CameraAgreement, agreement_at, draft_at
from app.modes.label.status import Checked, checked_of, here_html, progress_html, proposals_html, save_html
from app.modes.label.suggestions import LabelSuggestions
from app.modes.mode import ModeHost
from app.panels.time_bar import runs_of_times
from labels.arrays import STATES, LabelArrays

IN_BAR_EVERY_S: Final = 0.5


class StatusDisplay:
    """What one browser's panel says of the labels. Methods are called by the loop."""

    def __init__(self, host: ModeHost, panel: LabelPanel) -> None:
        self._host = host
        self._panel = panel
        self._in_bar: LabelArrays | None = None
        self._in_bar_s = 0.0
        self._counted: tuple[object, Checked] | None = None
        self._agreed: tuple[object, CameraAgreement | None] | None = None
        self._shown: object = None
        self.t_us: int | None = None
        """The time that the panel speaks of; None before it was shown."""

    def forget(self) -> None:
        """Show all of the panel anew at the next turn."""
        self._shown = self.t_us = None

    def forget_time_bar(self) -> None:
        """Another recording was opened: its labels are shown at once."""
        self._in_bar = None

    def show(
        self, editor: LabelEditor, suggestions: LabelSuggestions, live: str, waits: bool, *, lacks_proposals: bool
    ) -> None:
        """Let the panel follow.

        Args:
            editor: the labelling and its writer.
            suggestions: what is proposed, and why the person was led here.
            live: HTML of what happens to the labels of a live rally; empty for a recording.
            waits: whether an act waits for what it judges.
            lacks_proposals: whether there were proposals before the page was loaded again.
        """
        now = editor.labelling
        self._panel.show_save(live or save_html(now, editor.writer))
        proposals = proposals_html(now.here.proposals, suggestions.share, waits, lost=lacks_proposals)
        self._panel.show_proposals(proposals, suggestions.share is not None)
        label = None if now.view.repeat else now.here.labels.get(now.t_us)
        reason = suggestions.reason_for(label)
        saved = now.saved.get(now.view.camera)
        known = (now.t_us, now.view, now.step_us, now.works, reason, now.asking, saved)
        if known == self._shown:
            return
        self._shown, self.t_us = known, now.t_us
        with self._host.client.atomic():
            self._panel.show_view(now.view, now.step_us)
            self._panel.show_label(label, now.asking)
            known_of = None if now.view.repeat else saved  # what a second look wrote is in a layer of its own
            can_undo, can_redo = (True, True) if known_of is None else (known_of.can_undo, known_of.can_redo)
            self._panel.show_undo(can_undo=can_undo, can_redo=can_redo)
            self._panel.show_progress("" if live else progress_html(self.checked(now)))
            draft = draft_at(now, now.t_us)
            self._panel.show_here(here_html(label, draft, self.agreement(now), reason, now))

    def show_in_time_bar(self, now: Labelling, wall_s: float) -> None:
        """The labels of the camera by state; in a second look only those of the second look."""
        arrays = now.here.arrays
        if arrays is not self._in_bar and wall_s - self._in_bar_s >= IN_BAR_EVERY_S:
            self._in_bar, self._in_bar_s = arrays, wall_s
            states = arrays.state.astype(np.int64)
            self._host.show_runs("labels", runs_of_times(arrays.t_us, states, tuple(STATES), now.step_us))

    def agreement(self, now: Labelling) -> CameraAgreement | None:
        """How well the cameras agree at the cursor.

        Worked out anew when the cursor or what is known of the ball has changed, not at every turn of the loop.
        """
        key = (now.t_us, now.view, now.works)
        if self._agreed is None or self._agreed[0] != key:
            self._agreed = (key, agreement_at(now, now.t_us))
        return self._agreed[1]

    def checked(self, now: Labelling) -> Checked:
        """How far the work is; counted anew when a label or the step changed."""
        counted = (now.here.arrays, now.step_us, now.view.camera)
        if self._counted is None or self._counted[0] != counted:
            self._counted = (counted, checked_of(now))
        return self._counted[1]
