"""Faults while the app runs: it goes on, others are served, and a browser that comes back finds what it had."""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from app.client_session.view_link import link_of
from app.server import App
from app.session import Session
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.state.client_state import ClientState
from app.state.commands import Seek, SetMode, UseConfig
from app.web import gateway
from benchmarks.app.bare_browser import BareBrowser
from benchmarks.app.served_app import usage_of
from core.config import replace_setting
from core.detection import DetectorConfig, refined_config
from core.detection.saved import SavedDetector
from core.errors import CommandError
from core.files import PREFIX
from tests.waiting import PATIENCE_S, eventually


class Listener(BareBrowser):
    """A browser that keeps what it was told in notes; it may stop reading at once, or come with a cookie and a link."""

    def __init__(self, port: int, *, reads: bool = True, cookie: str = "", link: str = "") -> None:
        self.told: list[str] = []
        self._reads = threading.Event()
        if reads:
            self._reads.set()
        super().__init__(port, cookie=cookie, link=link)

    def close(self) -> None:
        self._reads.set()
        super().close()

    def _read(self) -> None:
        self._reads.wait()
        with contextlib.suppress(ConnectionClosed):
            super()._read()

    def _take(self, message: Mapping[str, Any]) -> None:
        super()._take(dict(message))
        if "Notification" in message["type"]:
            self.told.append(f"{message['props']['title']}: {message['props']['body']}")


@pytest.fixture
def workspace(tmp_path: Path, serve_recording: Path) -> Workspace:
    workspace = Workspace(tmp_path / "data")
    for name in "ab":
        shutil.copy(serve_recording, workspace.recording_path(name))
    return workspace


@pytest.fixture
def lab(workspace: Workspace) -> Iterator[App]:
    app = App(workspace, Library(workspace), "a", host="127.0.0.1", port=0)
    yield app
    app.stop()


def state_of(session: Session) -> ClientState:
    state = session.state
    assert state is not None
    return state


def tuning(lab: App, browser: BareBrowser) -> Session:
    session = browser.wait_session(lab, PATIENCE_S)
    session.send(SetMode("Tune"))
    browser.wait_picture(PATIENCE_S)
    return session


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def cut_to_nothing(path: Path) -> None:
    os.truncate(path, 0)


def replace(path: Path) -> None:
    other = path.with_name("other")
    other.write_bytes(b"no recording at all" * 1000)
    os.replace(other, path)


@pytest.mark.parametrize("harm", [cut, cut_to_nothing, Path.unlink, replace])
def test_a_recording_that_is_harmed_while_it_is_open_harms_nothing_else(
    lab: App, workspace: Workspace, harm: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    browser = Listener(lab.port)
    try:
        session = tuning(lab, browser)
        duration_us = state_of(session).playhead.duration_us
        harm(workspace.recording_path("a"))
        for share in (0.9, 0.1, 0.5):
            seen, told = browser.pictures, len(browser.told)
            session.send(Seek(int(share * duration_us)))
            eventually(lambda seen=seen, told=told: browser.pictures > seen or len(browser.told) > told, "any answer")
        seen = browser.pictures
        session.open_recording("b")
        eventually(lambda: state_of(session).recording == "b", "the other recording")
        session.send(Seek(int(0.3 * duration_us)))  # the two are the same: another time is another picture
        eventually(lambda: browser.pictures > seen, "a picture of the other recording")
        assert all("\n" not in note and "This is a bug" not in note for note in browser.told), browser.told
        assert not [record for record in caplog.records if record.levelno >= logging.ERROR], caplog.text
    finally:
        browser.close()


def test_a_browser_that_reads_nothing_costs_little_and_slows_no_one_down(lab: App) -> None:
    reader = Listener(lab.port)
    stalled = [Listener(lab.port, reads=False) for _ in range(3)]
    try:
        eventually(lambda: len(lab.sessions) == 4 and all(one.state is not None for one in lab.sessions), "all of them")
        for session in lab.sessions:
            session.send(SetMode("Tune"))
        reader.wait_picture(PATIENCE_S)
        before_mb = usage_of(os.getpid()).resident_mb

        def pictures(count: int) -> None:
            for number in range(count):
                seen = reader.pictures
                for session in lab.sessions:
                    session.send(Seek(20_000 + 997 * (number % 100)))
                eventually(lambda seen=seen: reader.pictures > seen, "a picture")

        pictures(60)
        waiting = [len(s.client._websock_connection._state.message_buffer.message_from_id) for s in lab.sessions]
        grown_mb = usage_of(os.getpid()).resident_mb - before_mb
        assert max(waiting) < 3000, waiting
        assert grown_mb < 150, f"{grown_mb:.0f} MB after 60 pictures for three that read nothing"
    finally:
        for one in (reader, *stalled):
            one.close()


def is_kept(lab: App, browser: str, state: ClientState) -> bool:
    kept = lab.services.browsers.recall(browser)
    return kept is not None and kept.configs == state.configs


@pytest.mark.parametrize("away_s", [1.0, 600.0])
def test_a_browser_that_comes_back_finds_what_it_had(lab: App, away_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    cookie = "0123456789abcdef" * 2
    edited = replace_setting(DetectorConfig(), ("cluster", "eps_px"), 4.5)
    browser = Listener(lab.port, cookie=cookie)
    session = tuning(lab, browser)
    eventually(lambda: session.page._kept, "what was found to be noted")  # changes are told from it
    session.send(UseConfig(edited))
    session.send(Seek(123_000))
    eventually(
        lambda: state_of(session).config == edited and state_of(session).playhead.anchor_us == 123_000, "the changes"
    )
    had = state_of(session)
    link = link_of(had, 123_000)
    browser.close()
    eventually(lambda: not lab.sessions, "it to be gone")
    eventually(lambda: is_kept(lab, cookie, had), "its settings to be stored, after it has gone")
    monotonic, wall = time.monotonic, time.time
    monkeypatch.setattr(time, "monotonic", lambda: monotonic() + away_s)
    monkeypatch.setattr(time, "time", lambda: wall() + away_s)
    again = Listener(lab.port, cookie=cookie, link=link)
    try:
        session = again.wait_session(lab, PATIENCE_S)
        eventually(lambda: state_of(session).playhead.anchor_us == 123_000, "its link to be followed")
        state = state_of(session)
        assert state.config == edited and state.mode == "Tune" and state.recording == "a"
        assert state.history.undo().present.a == had.history.undo().present.a == refined_config()
        assert state.playhead.anchor_us == 123_000
    finally:
        again.close()


def test_a_port_that_is_taken_at_the_last_moment_is_one_line(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gateway, "check_address", lambda host, port: None)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(CommandError, match=rf"cannot listen on 127.0.0.1:{port}; .*another") as error:
            App(workspace, Library(workspace), "a", host="127.0.0.1", port=port)
    assert "\n" not in str(error.value)


def test_two_servers_on_one_folder_show_each_others_work_and_take_nothing_away(lab: App, workspace: Workspace) -> None:
    with_upload = lab._front.pages.uploads.new_folder
    assert with_upload is not None
    receiving = with_upload()
    (receiving / "half.raw").write_bytes(b"x")
    second = App(Workspace(workspace.root), Library(Workspace(workspace.root)), "b", host="127.0.0.1", port=0)
    browsers = [Listener(app.port, cookie=f"{number:032x}") for number, app in enumerate((lab, second))]
    try:
        for number, (app, browser) in enumerate(zip((lab, second), browsers, strict=True)):
            session = tuning(app, browser)
            config = replace_setting(DetectorConfig(), ("cluster", "eps_px"), 4.0 + number)
            session.send(UseConfig(config))
            eventually(lambda session=session, config=config: state_of(session).config == config, "the config")
            app.services.workspace.keep_config("mine", SavedDetector("auto", config))
        assert set(workspace.config_names()) == {"mine", "mine-2"}
        assert (receiving / "half.raw").exists() and receiving.name.startswith(PREFIX)
        shutil.copy(workspace.recording_path("a"), workspace.recording_path("c"))
        assert lab.services.library.names() == second.services.library.names() == ("a", "b", "c")
    finally:
        for browser in browsers:
            browser.close()
        second.stop()
