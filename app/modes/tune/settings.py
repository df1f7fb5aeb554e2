"""The detector's settings: one folder per stage, made from the config's fields, with what the stage did above them."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app import theme
from app.state.client_state import ClientState
from app.state.commands import Command, CopyToOther, EditSetting, Redo, Undo, UseConfig
from app.widgets import when_changed
from core.config import FieldSpec, field_specs, get_setting
from core.detection import DetectorConfig, PipelineTrace

UNITS = {"us": "µs", "ms": "ms", "px": "px", "hz": "Hz", "s": "s", "rad": "rad", "mps": "m/s"}
STAGE_TITLES = {"roi": "ROI", "hot_pixels": "Hot pixels"}
OPEN_STAGES = ("window", "denoise", "cluster", "polarity", "geometry", "localise")
"""The stages of the method; the optional ones start folded."""


class SettingsPanel:
    """Sliders of one browser for every field of the detector config."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        self._handles: dict[tuple[str, ...], viser.GuiInputHandle] = {}
        self._counts: dict[str, viser.GuiHtmlHandle] = {}
        self.folder = gui.add_folder("Detector")
        with self.folder:
            edit = gui.add_button_group(
                "Edit",
                ("Undo", "Redo", "Reset", "Copy"),
                hint="Z undoes, R redoes; Copy gives A's values to B or B's to A",
            )
            specs = field_specs(DetectorConfig)
            for stage in dict.fromkeys(spec.path[0] for spec in specs):
                with gui.add_folder(stage_title(stage), expand_by_default=stage in OPEN_STAGES):
                    self._counts[stage] = gui.add_html("")
                    for spec in specs:
                        if spec.path[0] == stage:
                            self._handles[spec.path] = _add_control(gui, spec, send)

        @edit.on_click
        async def _(event: viser.GuiEvent) -> None:
            commands = {"Undo": Undo(), "Redo": Redo(), "Reset": UseConfig(DetectorConfig()), "Copy": CopyToOther()}
            send(commands[str(event.target.value)])

    def show(self, state: ClientState) -> None:
        """Put the sliders where the config of the chosen slot is."""
        for path, handle in self._handles.items():
            handle.value = get_setting(state.config, path)

    def show_trace(self, trace: PipelineTrace | None) -> None:
        """Events in and out and the time of every stage."""
        stages = {stage.name: stage for stage in trace.stages} if trace else {}
        for name, html in self._counts.items():
            stage = stages.get(name)
            if name == "window":
                html.visible = False
            elif stage is None:
                html.content = stage_counts_html("off")
            else:
                share = f" ({stage.count_out / stage.count_in:.0%})" if stage.count_in else ""
                html.content = stage_counts_html(
                    f"{stage.count_in} &rarr; <b>{stage.count_out}</b> events{share} &middot; "
                    f"{stage.seconds * 1e3:.2f} ms"
                )


def stage_title(stage: str) -> str:
    """A stage's name as a heading."""
    return STAGE_TITLES.get(stage, stage.capitalize())


def field_label(spec: FieldSpec) -> str:
    """A field's name with its unit suffix set apart: `eps_px` -> "eps [px]"."""
    name, _, suffix = spec.path[-1].rpartition("_")
    if name and suffix in UNITS:
        return f"{name.replace('_', ' ')} [{UNITS[suffix]}]"
    return spec.path[-1].replace("_", " ")


def stage_counts_html(text: str) -> str:
    """One muted line."""
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:0 12px'>{text}</div>"


def _add_control(gui: viser.GuiApi, spec: FieldSpec, send: Callable[[Command], None]) -> viser.GuiInputHandle:
    label, hint = field_label(spec), spec.doc
    if spec.kind is bool:
        handle = gui.add_checkbox(label, bool(spec.default), hint=hint)
    elif spec.choices:
        handle = gui.add_dropdown(label, spec.choices, initial_value=str(spec.default), hint=hint)
    else:
        assert spec.bounds is not None, f"{spec.path} has no bounds"
        low, high, step = (spec.kind(bound) for bound in (spec.bounds.low, spec.bounds.high, spec.bounds.step))
        handle = gui.add_slider(label, low, high, step, spec.kind(spec.default), hint=hint)
    when_changed(handle, lambda value: send(EditSetting(spec.path, value)))  # type: ignore[arg-type]
    return handle
