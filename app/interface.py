"""All controls of one browser, put together: which panels exist, which of them each mode shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import viser

from app.commands import Command, SetMode
from app.panels.candidates import CandidatesTable
from app.panels.config_files import ConfigFilesPanel
from app.panels.keys import add_keys, keys_html
from app.panels.picture import PicturePanel
from app.panels.recording_info import RecordingInfo, RecordingInfoPanel
from app.panels.score import ScorePanel
from app.panels.settings import SettingsPanel
from app.panels.transport import TransportPanel
from app.panels.tune_view import TuneViewPanel
from app.state import ClientState
from app.views import Answer
from app.widgets import Choice, Listing

PANEL_X_PX, PANEL_Y_PX = 8, -8
PANEL_SIZE_PX = (860, 208)


class Actions(Protocol):
    """What a browser may ask for beside the commands that only change its state."""

    def open_recording(self, name: str) -> None: ...
    def save_config(self, name: str) -> None: ...
    def load_config(self, name: str) -> None: ...
    def start_score(self) -> None: ...
    def cancel_score(self) -> None: ...
    def reframe(self) -> None: ...


class Interface:
    """Builds the controls once; `show` makes them follow the state."""

    def __init__(
        self,
        gui: viser.GuiApi,
        send: Callable[[Command], None],
        send_key: Callable[[Command], None],
        actions: Actions,
        modes: tuple[str, ...],
    ) -> None:
        self._mode = Choice(gui, "Mode", modes, lambda mode: send(SetMode(mode)))  # type: ignore[arg-type]
        self._recording = Listing(gui, "Recording", actions.open_recording, hint="Recordings of the workspace")
        self._transport = TransportPanel(gui, send)
        self.modes_folder = gui.add_folder(None)
        """Where the modes put their controls."""
        self._tune_folder = gui.add_folder(None, visible=False)
        with self._tune_folder:
            self._tune_view = TuneViewPanel(gui, send)
            self._settings = SettingsPanel(gui, send)
            self._files = ConfigFilesPanel(gui, actions.save_config, actions.load_config)
        self._picture = PicturePanel(gui, send)

        self._info = RecordingInfoPanel(gui)
        self._results = gui.add_panel(visible=False)
        with self._results.add_tab("Candidates", viser.Icon.LIST_DETAILS):
            self._candidates = CandidatesTable(gui)
        with self._results.add_tab("Score", viser.Icon.TARGET):
            self.score = ScorePanel(gui, actions.start_score, actions.cancel_score)
        for panel in (self._info.panel, self._results):
            with panel.add_tab("Keys", viser.Icon.KEYBOARD):
                gui.add_html(keys_html())
            panel.float(x=PANEL_X_PX, y=PANEL_Y_PX, width=PANEL_SIZE_PX[0], height=PANEL_SIZE_PX[1])
        add_keys(gui, send_key, actions.reframe)

    def show(self, state: ClientState, now_us: int, *, uses_recording: bool, shows_events: bool) -> None:
        """Make every control follow the state."""
        tuning = state.mode == "Tune"
        self._recording.visible = self._transport.folder.visible = uses_recording
        self._picture.folder.visible = uses_recording
        self._mode.show(state.mode)
        self._recording.show(state.recording)
        self._tune_folder.visible = tuning
        self._results.visible = tuning
        self._info.panel.visible = shows_events and not tuning and not state.playhead.live
        self._transport.show(state, now_us)
        self._picture.show(state)
        self._tune_view.show(state)
        self._settings.show(state)

    def show_time(self, state: ClientState, now_us: int) -> None:
        """Only what moves while it plays."""
        self._transport.show(state, now_us)
        self._info.show_time(now_us)

    def show_recordings(self, names: tuple[str, ...]) -> None:
        """Offer these recordings."""
        self._recording.offer(names)

    def show_configs(self, names: tuple[str, ...]) -> None:
        """Offer these saved configs."""
        self._files.show(names)

    def show_info(self, info: RecordingInfo) -> None:
        """Rates and health of the recording that was opened."""
        self._info.show_info(info)

    def show_answer(self, answer: Answer, names: tuple[str, ...], edited: int) -> None:
        """Counts and candidates of Tune's window; `edited` is the trace of the config that the sliders change."""
        self._settings.show_trace(answer.traces[edited])
        self._candidates.show(tuple(zip(names, answer.traces, strict=True)), answer.seconds)
