"""Sliders for the biases of an event camera, within what it allows; all browsers share the camera."""

from __future__ import annotations

from collections.abc import Mapping

import viser

from app.modes.mode import ModeHost
from app.widgets import when_changed, when_clicked
from core.errors import RallyscopeError
from core.rally.devices import CameraDevice
from core.rally.devices.bias_file import write_biases


class BiasPanel:
    """Of one camera in one browser. The camera is told in the pool, never in the loop."""

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
            self._host.pool.submit(self._set, {name: round(value)})

    def _set(self, values: dict[str, int]) -> None:
        try:
            self._device.set_biases(values)
        except RallyscopeError as error:
            failed = error
            self._host.later(lambda: self._host.report(failed))

    def _ask_to_save(self) -> None:
        self._host.pool.submit(self._save)

    def _save(self) -> None:
        sets = {f"{one.model.name} {one.serial}": one.bias_values() for one in self._devices.values()}
        try:
            path = self._host.services.workspace.biases_path
            write_biases(path, sets)
        except RallyscopeError as error:
            failed = error
            self._host.later(lambda: self._host.report(failed))
            return
        self._host.later(lambda: self._host.note("Biases saved", f"for --biases {path}", "green"))
