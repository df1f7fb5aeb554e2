"""The guide for a sweep of the ball, over the flat pictures: what is missing is framed there."""

from __future__ import annotations

import viser

from app.modes.mode import ModeHost
from app.modes.watch.sweep.commands import ForgetSweep, GuideSweep, NoteSweptBalls
from app.modes.watch.sweep.words import swept_html
from app.state.client_state import ClientState
from app.state.swept_cells import SweptCells
from app.views.mosaic import Mosaic
from app.widgets import when_changed, when_clicked


class SweepPanel:
    """Coverage of a swept ball in one browser, counted from its own pictures."""

    def __init__(self, gui: viser.GuiApi, host: ModeHost) -> None:
        self._host = host
        self._shown: tuple[tuple[str, ...], SweptCells] | None = None
        self._counted: Mosaic | None = None
        self._folder = gui.add_folder("Sweep of the ball", expand_by_default=False, visible=False)
        with self._folder:
            hint = "Framed: where the ball has not been found in two pictures yet. For `calibrate stereo`"
            self._active = gui.add_checkbox("Show what is missing", False, hint=hint)
            self._said = gui.add_html("")
            self._forget = gui.add_button("Count the parts anew", icon=viser.Icon.ERASER)
        when_changed(self._active, lambda on: host.send(GuideSweep(bool(on))))
        when_clicked(self._forget, lambda: host.send(ForgetSweep()))

    def show(self, state: ClientState, *, flat: bool) -> None:
        """Count the newest picture, and say how far it is."""
        self._folder.visible = flat
        if not flat:
            return
        swept, sheet = state.watch.swept, self._host.plane.sheet
        if swept.active and sheet is not self._counted:
            self._counted = sheet
            if sheet.ball_cells:
                self._host.send(NoteSweptBalls(sheet.ball_cells))
        if (state.cameras, swept) != self._shown:
            self._shown = state.cameras, swept
            self._active.value = swept.active
            self._said.content = swept_html(swept, state.cameras) if swept.active else ""
