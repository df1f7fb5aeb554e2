"""A live source that is not a simulation: status, recording, and camera biases."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import viser

from app.modes.mode import ModeHost, do_in_pool
from app.modes.watch.stream_status import stream_html
from app.shared.live_rally import LiveRally
from app.widgets import when_changed, when_clicked
from core.devices import CameraDevice
from core.devices.models import write_biases
from core.live.camera_source import CameraSource


class BiasPanel:
    """Bias sliders of one camera in one browser. Biases are sent in the thread pool, never in the loop."""

    def __init__(
        self,
        gui: viser.GuiApi,
        name: str,
        device: CameraDevice,
        devices: Mapping[str, CameraDevice],
        host: ModeHost,
    ) -> None:
        self._device, self._devices, self._host = device, devices, host
        self._sliders: dict[str, viser.GuiSliderHandle[int]] = {}
        with gui.add_folder(f"Biases of {name}", expand_by_default=False):
            values = device.bias_values()
            for bias in device.biases:
                slider = gui.add_slider(bias.name, bias.low, bias.high, 1, values[bias.name], hint=bias.doc)
                when_changed(slider, lambda value, bias_name=bias.name: self._ask(bias_name, value))
                self._sliders[bias.name] = slider
            hint = "Saves the biases of all cameras, for --biases of serve and record"
            when_clicked(gui.add_button("Save biases", icon=viser.Icon.DEVICE_FLOPPY, hint=hint), self._ask_to_save)
        self._shown = values

    def show(self) -> None:
        """Update the sliders when another browser has moved them."""
        values = self._device.bias_values()
        for name, value in values.items():
            if value != self._shown[name] and self._sliders[name].value != value:
                self._sliders[name].value = value
        self._shown = values

    def _ask(self, name: str, value: object) -> None:
        if isinstance(value, int | float):
            wanted = {name: round(value)}
            do_in_pool(self._host, lambda: self._device.set_biases(wanted))

    def _ask_to_save(self) -> None:
        do_in_pool(self._host, self._save)

    def _save(self) -> None:
        sets = {f"{one.model.name} {one.serial}": one.bias_values() for one in self._devices.values()}
        path = self._host.services.workspace.biases_path
        write_biases(path, sets)
        self._host.later(lambda: self._host.note("Biases saved", f"for --biases {path}", "green"))


RECORD: Final = "Record"


class RecordButton:
    """The Record button of one browser. Files are opened and closed in the thread pool, never in the loop."""

    def __init__(self, gui: viser.GuiApi, rally: LiveRally, host: ModeHost) -> None:
        self._rally, self._host = rally, host
        self._button = gui.add_button(RECORD, icon=viser.Icon.PLAYER_RECORD, color="red")
        when_clicked(self._button, self._ask)

    def show(self) -> None:
        """Show whether a recording is being written, and for how long."""
        recorded = self._rally.recorded
        label = RECORD if recorded is None else f"Stop recording ({self._rally.recorded_s:.1f} s)"
        if self._button.label != label:
            self._button.label = label
            self._button.icon = viser.Icon.PLAYER_RECORD if recorded is None else viser.Icon.PLAYER_STOP

    def _ask(self) -> None:
        do_in_pool(self._host, self._toggle)

    def _toggle(self) -> None:
        path = self._rally.recorded
        if path is None:
            with self._host.services.workspace.new_live_path() as new:
                self._rally.record(new)
            return
        duration_us = self._rally.stop_recording()
        if duration_us:  # else another browser was quicker
            text = f"{path.stem}: {duration_us / 1e6:.1f} s, now in the list of recordings"
            self._host.later(lambda: self._host.note("Recorded", text, "green"))


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
        """Show the controls only while the live rally is watched."""
        self._folder.visible = visible

    def show(self, wall_s: float) -> None:
        """Update the status, a few times a second."""
        if wall_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = wall_s
        self._record.show()
        for biases in self._biases:
            biases.show()
        rally = self._rally
        html = stream_html(rally.source, rally.watch.health(), rally.player.snapshot, has_robot=rally.has_robot)
        if html != self._status.content:
            self._status.content = html
