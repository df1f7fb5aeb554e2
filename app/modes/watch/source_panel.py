"""A live source that is no simulation: how it is doing, and a recording of it. Nothing else can be asked of it."""

from __future__ import annotations

from typing import Final

import viser

from app.modes.mode import ModeHost
from app.modes.watch.bias_panel import BiasPanel
from app.modes.watch.record_button import RecordButton
from app.modes.watch.stream_status import stream_html
from app.shared.live_rally import LiveRally
from core.live.camera_source import CameraSource

SHOW_EVERY_S: Final = 0.25


class SourcePanel:
    """Controls of the live source in one browser; all browsers share the source."""

    def __init__(self, gui: viser.GuiApi, rally: LiveRally, host: ModeHost) -> None:
        self._rally = rally
        self._shown_s = float("-inf")
        self._folder = gui.add_folder("Live source (shared by all browsers)")
        with self._folder:
            self._record = RecordButton(gui, rally, host)
            self._status = gui.add_html("")
            devices = rally.source.devices if isinstance(rally.source, CameraSource) else {}
            self._biases = [BiasPanel(gui, name, device, devices, host) for name, device in devices.items()]

    def set_visible(self, visible: bool) -> None:
        """Only while the live rally is watched."""
        self._folder.visible = visible

    def show(self, wall_s: float) -> None:
        """Say how it is doing, some times a second."""
        if wall_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = wall_s
        self._record.show()
        for biases in self._biases:
            biases.show()
        rally = self._rally
        said = stream_html(rally.source, rally.watch.health(), rally.player.snapshot, has_robot=rally.has_robot)
        if said != self._status.content:
            self._status.content = said
