"""The page is there before the app behind it, and what the app shows is sent at once."""

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser
from viser._icons import svg_from_icon

from app.server import App
from app.session import Session
from app.shared.library import Library
from app.shared.live_rally import LIVE
from app.shared.workspace import Workspace
from app.startup.startup import Preparation, Step
from app.state.commands import SetMode, StepTime
from app.web import open_gateway
from benchmarks.app.bare_browser import BareBrowser
from tests.waiting import PATIENCE_S, eventually


@pytest.fixture
def served(tmp_path: Path, serve_recording: Path) -> Iterator[tuple[App, BareBrowser]]:
    """An app, and a browser that was there before it."""
    front = open_gateway("127.0.0.1", 0)
    browser = BareBrowser(front.server.get_port())
    eventually(front.server.get_clients, "the page")
    workspace = Workspace(tmp_path / "data")
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    app = App(workspace, Library(workspace), "serve", host="127.0.0.1", port=0, front=front)
    yield app, browser
    browser.close()
    app.stop()


def tuning(app: App, browser: BareBrowser) -> Session:
    session = browser.wait_session(app, PATIENCE_S)
    session.send(SetMode("Tune"))
    browser.wait_picture(PATIENCE_S)
    browser.wait_quiet(PATIENCE_S)
    return session


def test_a_browser_that_came_before_the_app_is_served(served: tuple[App, BareBrowser]) -> None:
    app, browser = served
    assert app.port == app.viser_server.get_port()
    tuning(app, browser)


def test_a_picture_does_not_wait_until_viser_has_rested(served: tuple[App, BareBrowser]) -> None:
    app, browser = served
    session = tuning(app, browser)
    states = app.viser_server._websock_server._client_state_from_id
    states[session.client.client_id].message_buffer.window_duration_sec = 1e6  # longer than any patience
    for step in (1, 1, 1):  # on and on: two that are taken at once, forth and back, would need no picture
        seen = browser.pictures
        session.send(StepTime(step))
        browser.wait_picture(PATIENCE_S, after=seen)


def test_a_recorded_rally_is_shown_while_the_app_is_prepared(tmp_path: Path) -> None:
    preparation = Preparation({"simulation": Step("Compiling the simulation")})
    preparation.begin("simulation")
    workspace = Workspace(tmp_path / "data")
    app = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, preparation=preparation)
    browser = BareBrowser(app.port)
    try:
        (session,) = eventually(lambda: app.sessions, "the browser")

        def ball() -> tuple[float, ...]:
            shown = session.world._drawn.ball
            return () if shown is None else tuple(shown)

        seen = eventually(ball, "a ball of the recorded rally")
        eventually(lambda: ball() not in ((), seen), "it to fly")
        assert session.state is None
    finally:
        browser.close()
        app.stop()


def test_icons_are_visers_and_its_archive_is_read_through_once(monkeypatch: pytest.MonkeyPatch) -> None:
    server = open_gateway("127.0.0.1", 0).server
    try:
        server.gui.add_button("first", icon=viser.Icon.HEARTBEAT)
        monkeypatch.setattr(zipfile.ZipFile, "_RealGetContents", lambda *_: pytest.fail("read through again"))
        button = server.gui.add_button("second", icon=viser.Icon.HOURGLASS)
        tab = server.gui.add_tab_group().add_tab("third", viser.Icon.HISTORY)
        monkeypatch.undo()
        assert button._impl.props._icon_html == svg_from_icon("hourglass")
        assert tab._parent._impl.props._tab_icons_html == (svg_from_icon("history"),)
    finally:
        server.stop()


@pytest.mark.gate
def test_the_app_starts_without_what_its_first_picture_does_not_need() -> None:
    code = "import app.cli.serve, app.startup.startup, app.server, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    ).stdout.split()
    heavy = {"av", "matplotlib", "mujoco", "rerun", "scipy.interpolate", "scipy.optimize", "scipy.special"}
    assert not (heavy | {"scipy.spatial", "scipy.stats", "sklearn", "torch"}) & set(loaded)
