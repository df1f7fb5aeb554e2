"""Begins and ends a recording of the live rally, which all browsers share."""

from __future__ import annotations

import time
from typing import Final

import viser

from app.modes.in_pool import do_in_pool
from app.modes.mode import ModeHost
from app.shared.live_rally import LiveRally
from app.widgets import when_clicked

RECORD: Final = "Record"


class RecordButton:
    """The Record button of one browser. Files are opened and closed in the pool, never in the loop."""

    def __init__(self, gui: viser.GuiApi, rally: LiveRally, host: ModeHost) -> None:
        self._rally, self._host = rally, host
        self._button = gui.add_button(RECORD, icon=viser.Icon.PLAYER_RECORD, color="red")
        when_clicked(self._button, self._ask)

    def show(self) -> None:
        """Say whether one is being written, and since when."""
        recorded = self._rally.recorded
        label = RECORD if recorded is None else f"Stop recording ({self._rally.recorded_s:.0f} s)"
        if self._button.label != label:
            self._button.label = label
            self._button.icon = viser.Icon.PLAYER_RECORD if recorded is None else viser.Icon.PLAYER_STOP

    def _ask(self) -> None:
        do_in_pool(self._host, self._toggle)

    def _toggle(self) -> None:
        path = self._rally.recorded
        if path is None:
            self._rally.record(self._host.services.workspace.recording_path(time.strftime("live-%Y%m%d-%H%M%S")))
            return
        duration_us = self._rally.stop_recording()
        if duration_us:  # else another browser was quicker
            text = f"{path.stem}: {duration_us / 1e6:.1f} s, now in the list of recordings"
            self._host.later(lambda: self._host.note("Recorded", text, "green"))
