"""All controls of one browser, put together: which panels exist, which of them each mode shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import viser

from app.panels.below_pictures import place_below_pictures
from app.panels.keys import add_keys, tour_button_html
from app.panels.picture import PicturePanel
from app.panels.recording_info import RecordingInfo, RecordingInfoPanel
from app.state.client_state import MODES, ClientState
from app.state.commands import Command, SetMode
from app.widgets import Choice, Listing, when_clicked

LAST = 1e9
"""Below whatever else the modes put into the panel."""


class ControlPanelActions(Protocol):
    """What a browser may ask for beside the commands that only change its state."""

    def open_recording(self, name: str) -> None: ...
    def show_files(self) -> None: ...
    def show_tour(self) -> None: ...
    def reframe(self) -> None: ...


class ControlPanel:
    """Builds the controls once; `show` makes them follow the state."""

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
            hint="An event file or a recording: of the workspace, of a folder that the command line names, or of this "
            "computer (Ctrl+O, or drop it onto the page)",
        )
        when_clicked(self._open, actions.show_files)
        self.modes_folder = gui.add_folder(None)
        """Where the modes put their controls."""
        self._picture = PicturePanel(gui, send)
        self._info = RecordingInfoPanel(gui)
        place_below_pictures(gui, self._info.panel)
        gui.add_html(f"<div style='font-size:12.5px;padding:6px 12px'>{tour_button_html()}</div>", order=LAST)
        palette = {"Open file...": actions.show_files, "Show the tour": actions.show_tour}
        add_keys(gui, send_key, actions.reframe, palette)
        # Until a recording is open there is nothing that these could be about.
        self._picture.folder.visible = self._info.panel.visible = False

    def show(self, state: ClientState, *, uses_recording: bool, shows_events: bool, knows_ball: bool) -> None:
        """Make every control follow the state."""
        self._recording.visible = self._open.visible = self._picture.folder.visible = uses_recording
        self._mode.show(state.mode)
        self._recording.show(state.recording)
        self._info.panel.visible = shows_events and not state.playhead.live
        self._picture.show(state, knows_ball=knows_ball)

    def show_recordings(self, names: tuple[str, ...]) -> None:
        """Offer these recordings."""
        self._recording.offer(names)

    def show_info(self, info: RecordingInfo) -> None:
        """Rates and health of the recording that was opened."""
        self._info.show_info(info)
