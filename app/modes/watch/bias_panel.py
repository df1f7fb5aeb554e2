"""Sliders for the biases of an event camera, within what it allows; all browsers share the camera."""

from __future__ import annotations

from collections.abc import Mapping

import viser

from app.modes.in_pool import do_in_pool
from app.modes.mode import ModeHost
from app.widgets import when_changed, when_clicked
from core.devices import CameraDevice
from core.devices.bias_file import write_biases


class BiasPanel:
    """Bias sliders of one camera in one browser. Biases are sent to the camera in the pool, never in the loop."""

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
            hint = "of all cameras, for --biases of serve and record"
            when_clicked(gui.add_button("Save biases", icon=viser.Icon.DEVICE_FLOPPY, hint=hint), self._ask_to_save)
        self._shown = values

    def show(self) -> None:
        """Let the sliders stand where another browser has put them."""
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
