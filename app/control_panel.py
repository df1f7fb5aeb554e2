"""The control panel of one browser: its panels, and which of them each mode shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import viser

from app import theme
from app.panels.keys import add_keys, place_below_pictures, tour_buttons_html
from app.panels.recording_info import RecordingInfo, RecordingInfoPanel
from app.pictures.canvas import RENDERINGS
from app.pictures.palette import POLARITY_COLOURS, PaletteIndex, PolarityColours, palette
from app.state.client_state import ARRANGEMENTS, MODES, ClientState
from app.state.commands import (
    WINDOW_RANGE_US,
    Command,
    MagnifyBall,
    SetArrangement,
    SetColours,
    SetMode,
    SetRendering,
    SetWindow,
    ShowTruth,
)
from app.widgets import Choice, Listing, when_changed, when_clicked

LAST = 1e9
"""Position below everything that the modes add to the panel."""


class ControlPanelActions(Protocol):
    """Actions that do more than change the browser's state."""

    def open_recording(self, name: str) -> None: ...
    def show_files(self) -> None: ...
    def show_tour(self) -> None: ...
    def show_lessons(self) -> None: ...
    def reframe(self) -> None: ...


class ControlPanel:
    """Builds the controls once; `show` updates them from the state."""

    def __init__(
        self,
        gui: viser.GuiApi,
        send: Callable[[Command], None],
        send_key: Callable[[Command], None],
        actions: ControlPanelActions,
    ) -> None:
        self._mode = Choice(gui, "Mode", MODES, lambda mode: send(SetMode(mode)))  # type: ignore[arg-type]
        self._recording = Listing(gui, "Recording", actions.open_recording, hint="Recordings of the workspace")
        self._open = gui.add_button(
            "Open file...",
            icon=viser.Icon.FOLDER_OPEN,
            color="dark",
            hint="An event file or recording from the workspace, from a --folder, or from this computer "
            "(Ctrl+O, or drop it onto the page)",
        )
        when_clicked(self._open, actions.show_files)
        self.modes_folder = gui.add_folder(None)
        """Folder of the modes' controls."""
        self._picture = PicturePanel(gui, send)
        self._info = RecordingInfoPanel(gui)
        place_below_pictures(gui, self._info.panel)
        gui.add_html(f"<div style='font-size:12.5px;padding:6px 12px'>{tour_buttons_html()}</div>", order=LAST)
        palette = {
            "Open file...": actions.show_files,
            "Show the tour": actions.show_tour,
            "Lessons": actions.show_lessons,
        }
        add_keys(gui, send_key, actions.reframe, palette)
        # Disabled until a recording is open.
        self._picture.folder.visible = self._info.panel.visible = False

    def show(self, state: ClientState, *, uses_recording: bool, shows_events: bool, knows_ball: bool) -> None:
        """Update every control from the state."""
        self._recording.visible = self._open.visible = self._picture.folder.visible = uses_recording
        self._mode.show(state.mode)
        self._recording.show(state.recording)
        self._info.panel.visible = shows_events and not state.playhead.live
        self._picture.show(state, knows_ball=knows_ball)

    def show_recordings(self, names: tuple[str, ...]) -> None:
        """Update the list of recordings."""
        self._recording.offer(names)

    def show_info(self, info: RecordingInfo) -> None:
        """Rates and health of the recording that was opened."""
        self._info.show_info(info)


class PicturePanel:
    """Settings of the pictures of one browser."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        low_us, high_us = WINDOW_RANGE_US
        self.folder = gui.add_folder("Picture")
        with self.folder:
            self._window = gui.add_slider(
                "Window [ms]", low_us / 1e3, high_us / 1e3, 0.1, 5.0, hint="How long events are accumulated"
            )
            self._rendering = gui.add_dropdown("Show", RENDERINGS, hint="Latest polarity, events per pixel, or age")
            self._colours = gui.add_dropdown("ON / OFF", POLARITY_COLOURS)
            self._arrangement = gui.add_dropdown(
                "Arrange",
                ARRANGEMENTS,
                hint="Automatic: in Export what makes the pictures larger, elsewhere side by side",
            )
            self._magnify = gui.add_checkbox(
                "Magnified ball", True, hint="The ball, 8 times larger, in a corner of each picture of a whole sensor"
            )
            self._legend = gui.add_html("")
            self._truth = gui.add_checkbox("True ball", True, hint="Cyan circle")
        when_changed(self._window, lambda value: send(SetWindow(round(float(str(value)) * 1e3))))
        when_changed(self._rendering, lambda value: send(SetRendering(value)))  # type: ignore[arg-type]
        when_changed(self._colours, lambda value: send(SetColours(value)))  # type: ignore[arg-type]
        when_changed(self._arrangement, lambda value: send(SetArrangement(value)))  # type: ignore[arg-type]
        when_changed(self._magnify, lambda value: send(MagnifyBall(bool(value))))
        when_changed(self._truth, lambda value: send(ShowTruth(bool(value))))

    def show(self, state: ClientState, *, knows_ball: bool) -> None:
        """Update the controls; the true ball is offered only if the recording has it."""
        self._window.visible = state.mode == "Watch"
        self._arrangement.visible = state.mode != "Label"
        self._magnify.visible = state.mode != "Label"  # it shows the whole picture beside the zoomed one
        self._magnify.value = state.look.magnifies_ball
        self._truth.visible = shows_truth = knows_ball and state.mode != "Label"  # the annotator does not see the truth
        self._window.value = state.look.window_us / 1e3
        self._rendering.value = state.look.rendering
        self._legend.content = event_legend_html(state.look.colours, with_truth=shows_truth)
        self._colours.value = state.look.colours
        self._arrangement.value = state.look.arrangement
        self._truth.value = state.tune.show_truth


def event_legend_html(colours: PolarityColours, *, with_truth: bool) -> str:
    """HTML legend of the colours of circles and events."""
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
