"""The controls of a new training: presets, and every field of `RunConfig`."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby

import viser

from app.modes.train.form import MAIN, agent_defaults, form_specs, run_of_form, value_shown
from app.modes.train.presets import PRESETS, TRAIN_NOW, Preset, offered_presets
from app.panels.field_control import add_field_control, section_title
from app.widgets import when_changed, when_clicked
from core.learning.config import RunConfig


class FormPanel:
    """The form of one browser; `start(name, config, place)` and `choose(preset)` are called in the loop."""

    def __init__(
        self,
        gui: viser.GuiApi,
        start: Callable[[str, RunConfig, str], None],
        choose: Callable[[Preset], None],
        later: Callable[[Callable[[], None]], None],
        places: tuple[str, ...],
    ) -> None:
        self._start = start
        self._choose = choose
        self._preset = gui.add_dropdown("Preset", offered_presets(), hint="Fills in everything below")
        specs = form_specs()
        self._specs = {spec.path: spec for spec in specs}
        self._handles = {spec.path: add_field_control(gui, spec) for spec in specs[: len(MAIN)]}
        with gui.add_folder("Every other setting", expand_by_default=False):
            for section, fields in groupby(specs[len(MAIN) :], lambda spec: spec.path[:-1]):
                with gui.add_folder(section_title(section), expand_by_default=False):
                    self._handles |= {spec.path: add_field_control(gui, spec) for spec in fields}
        self._name = gui.add_text("Name", "", hint="Of the run; empty: one is made")
        self._place = gui.add_dropdown(
            "Where", places, visible=len(places) > 1, hint="Seeds are trained side by side there"
        )
        button = gui.add_button("Start", icon=viser.Icon.PLAYER_PLAY)
        when_changed(self._preset, lambda name: later(lambda: self._use(str(name))))
        when_changed(self._handles[("agent",)], lambda agent: later(lambda: self._use_agent(str(agent))))
        when_clicked(button, lambda: later(self._send))
        self._fill(PRESETS[TRAIN_NOW])

    @property
    def preset(self) -> Preset:
        """The one that was chosen last."""
        return self._chosen

    def _use(self, name: str) -> None:
        if name in offered_presets():
            self._fill(PRESETS[name])
            self._choose(PRESETS[name])

    def _use_agent(self, agent: str) -> None:
        for path, value in agent_defaults(agent).items():
            self._handles[path].value = value

    def _fill(self, preset: Preset) -> None:
        self._chosen = preset
        for path, handle in self._handles.items():
            handle.value = value_shown(preset.config, self._specs[path])

    def _send(self) -> None:
        values = {path: handle.value for path, handle in self._handles.items()}
        self._start(str(self._name.value), run_of_form(self._chosen.config, values), str(self._place.value))
