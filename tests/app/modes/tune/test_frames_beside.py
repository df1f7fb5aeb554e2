"""Tune with an ordinary camera: its picture stands beside the events, in what is shown and in what the address says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from app.client_session.view_link import commands_of, link_of, values_of
from app.modes.tune.commands import ShowFramesBeside
from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.state.client_state import ClientState, Configs, History, Playhead
from app.state.commands import SetMode, StopAt
from benchmarks.app.bare_browser import BareBrowser
from core.detection import DetectorConfig
from tests.frames_beside_events import FRAMES, write_frames_beside_events
from tests.waiting import PATIENCE_S, eventually


@pytest.fixture
def state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs, titled_frames=("rgb",))


def test_only_what_the_recording_has_can_stand_beside_the_events(state) -> None:
    shown = ShowFramesBeside("rgb").apply(state, 0.0)
    assert shown.tune.frames == "rgb" and ShowFramesBeside("").apply(shown, 0.0) == state
    for other in ("left", "../x"):
        assert ShowFramesBeside(other).apply(state, 0.0) == state


def test_a_link_keeps_it_and_shows_none_where_another_recording_has_none(state) -> None:
    values = values_of(link_of(ShowFramesBeside("rgb").apply(state, 0.0), 0))
    for opened, title in ((state, "rgb"), (replace(state, titled_frames=()), "")):
        for command in commands_of(values, opened):
            opened = command.apply(opened, 0.0)
        assert opened.tune.frames == title


def test_the_chosen_camera_is_shown_at_the_cursor_until_another_recording_is_opened(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "data")
    for name in ("a", "b"):
        write_frames_beside_events(workspace.recording_path(name))
    lab = App(workspace, Library(workspace), "a", host="127.0.0.1", port=0)
    lab.services.rallies.followings.frame_detector = None
    browser = BareBrowser(lab.port)
    try:
        session = browser.wait_session(lab, PATIENCE_S)
        for command in (SetMode("Tune"), StopAt(30_000), ShowFramesBeside(FRAMES)):
            session.send(command)

        def titles() -> list[str]:
            return [text.text for text in session.sheet.texts if text.is_title]

        eventually(lambda: titles()[1:] == [f"{FRAMES}: picture 1, mid exposure 25.000 ms"], "its picture beside")
        session.send(StopAt(50_000))
        eventually(lambda: titles()[1:] == [f"{FRAMES}: picture 2, mid exposure 45.000 ms"], "the next one")
        session.open_recording("b")
        eventually(lambda: session.state is not None and session.state.recording == "b", "the other recording")
        eventually(lambda: len(titles()) == 1, "the events alone")
    finally:
        browser.close()
        lab.stop()
