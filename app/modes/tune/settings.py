"""The detector's settings: one folder per stage, made from the config's fields, with what the stage did above them."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app import theme
from app.panels.field_control import add_field_control, section_title
from app.state.client_state import ClientState
from app.state.commands import Command, CopyToOther, EditSetting, Redo, Undo, UseConfig
from app.widgets import when_changed
from core.config import field_specs, get_setting
from core.detection import DetectorConfig, PipelineTrace
from core.detection.config import OF_ONE_METHOD

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
            specs = [spec for spec in field_specs(DetectorConfig) if spec.path[0] not in OF_ONE_METHOD]
            for stage in dict.fromkeys(spec.path[0] for spec in specs):
                with gui.add_folder(section_title((stage,)), expand_by_default=stage in OPEN_STAGES):
                    self._counts[stage] = gui.add_html("")
                    for spec in specs:
                        if spec.path[0] == stage:
                            handle = self._handles[spec.path] = add_field_control(gui, spec, slider=True)
                            when_changed(handle, lambda value, path=spec.path: send(EditSetting(path, value)))  # type: ignore[arg-type]

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


def stage_counts_html(text: str) -> str:
    """One muted line."""
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:0 12px'>{text}</div>"
