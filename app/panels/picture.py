"""How events are drawn: accumulation window, rendering, colours, arrangement, truth."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app import theme
from app.pictures.event_picture import RENDERINGS
from app.pictures.palette import POLARITY_COLOURS, PaletteIndex, PolarityColours, palette
from app.state.client_state import ARRANGEMENTS, ClientState
from app.state.commands import WINDOW_RANGE_US, Command, SetArrangement, SetColours, SetRendering, SetWindow, ShowTruth
from app.widgets import when_changed


class PicturePanel:
    """The look of the pictures of one browser."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        low_us, high_us = WINDOW_RANGE_US
        self.folder = gui.add_folder("Picture")
        with self.folder:
            self._window = gui.add_slider(
                "Window [ms]", low_us / 1e3, high_us / 1e3, 0.1, 5.0, hint="How long events are accumulated"
            )
            self._rendering = gui.add_dropdown("Show", RENDERINGS, hint="Latest polarity, events per pixel, or age")
            self._colours = gui.add_dropdown("ON / OFF", POLARITY_COLOURS)
            self._arrangement = gui.add_dropdown("Arrange", ARRANGEMENTS)
            self._legend = gui.add_html("")
            self._truth = gui.add_checkbox("True ball", True, hint="Cyan circle")
        when_changed(self._window, lambda value: send(SetWindow(round(float(str(value)) * 1e3))))
        when_changed(self._rendering, lambda value: send(SetRendering(value)))  # type: ignore[arg-type]
        when_changed(self._colours, lambda value: send(SetColours(value)))  # type: ignore[arg-type]
        when_changed(self._arrangement, lambda value: send(SetArrangement(value)))  # type: ignore[arg-type]
        when_changed(self._truth, lambda value: send(ShowTruth(bool(value))))

    def show(self, state: ClientState, *, knows_ball: bool) -> None:
        """Let the controls follow the state; of a true ball only where the recording knows it."""
        self._window.visible = state.mode == "Watch"
        self._arrangement.visible = state.mode != "Label"
        self._truth.visible = shows_truth = knows_ball and state.mode != "Label"  # a person is not shown the answer
        self._window.value = state.look.window_us / 1e3
        self._rendering.value = state.look.rendering
        self._legend.content = event_legend_html(state.look.colours, with_truth=shows_truth)
        self._colours.value = state.look.colours
        self._arrangement.value = state.look.arrangement
        self._truth.value = state.tune.show_truth


def event_legend_html(colours: PolarityColours, *, with_truth: bool) -> str:
    """What the colours of circles and events mean."""
    rgb = palette(colours)
    inks = [
        ("found", PaletteIndex.CIRCLE),
        ("ROI", PaletteIndex.ROI),
        ("ON", PaletteIndex.ON),
        ("OFF", PaletteIndex.OFF),
    ]
    if with_truth:
        inks.insert(1, ("truth", PaletteIndex.TRUTH))
    spots = "".join(
        f"<span style='color:rgb({red},{green},{blue})'>&#9632;</span> {name} &nbsp; "
        for name, (red, green, blue) in ((name, rgb[ink]) for name, ink in inks)
    )
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:2px 12px'>{spots}</div>"
