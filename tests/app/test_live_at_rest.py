"""The live rally runs for who watches, records or streams it; otherwise its time stands still, and nothing is lost."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.server import App
from app.session import Session
from app.shared import rallies
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally, SimulationProcess, join_simulation
from app.shared.workspace import Workspace
from app.state.client_state import ModeName
from app.state.commands import SetMode
from benchmarks.app.bare_browser import BareBrowser
from core.live.link import messages as m
from tests.waiting import PATIENCE_S, eventually


@pytest.fixture
def live() -> LiveRally:
    process = SimulationProcess("--auto-serve", "5", "--seed", "3", "--sensor", "160x120")
    return join_simulation(process.wait(), process=process)


@pytest.fixture(autouse=True)
def _no_grace(monkeypatch: pytest.MonkeyPatch) -> None:
    """It need not run on for a page that is loaded anew."""
    monkeypatch.setattr(rallies, "GRACE_S", 0.2)


@pytest.fixture
def lab(tmp_path: Path, serve_recording: Path, live: LiveRally) -> Iterator[App]:
    workspace = Workspace(tmp_path / "data")
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    app = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    yield app
    app.stop()


class Beats:
    """A LinkListener that counts the signs of life since the last block."""

    count = 0

    def on_session(self, welcome: m.Reply) -> None: ...
    def on_events(self, batch: m.EventBatch) -> None: ...
    def on_notice(self, notice: m.Notice) -> None: ...

    def on_state(self, state: m.WorldState) -> None:
        self.count = 0 if state.ends_block else self.count + 1


def wait_until_it_stands(live: LiveRally) -> None:
    """While it runs, at most six signs of life are sent between two blocks: at 1/64 of the speed, one in 0.64 s."""
    beats = Beats()
    live.source.add_listener(beats)
    eventually(lambda: not live.is_awake and beats.count >= 8, "the simulation to stand still")
    live.source.remove_listener(beats)


def time_passes(live: LiveRally) -> None:
    from_us = live.recording.duration_us
    eventually(lambda: live.recording.duration_us > from_us + 100_000, "ten blocks")


def stands_until(live: LiveRally, session: Session, leave: Callable[[], None], come_back: Callable[[], None]) -> None:
    """It stands from one action to the other, and then goes on where it was."""
    time_passes(live)
    session.later(leave)
    wait_until_it_stands(live)
    stood_us, identity = live.recording.duration_us, live.recording.uuid
    wait_until_it_stands(live)
    assert live.recording.duration_us == stood_us
    session.later(come_back)
    time_passes(live)
    assert live.recording.uuid == identity and live.watch.health().blocks_lost == 0
    eventually(lambda: not live.watch.health().stopped, "the source to be known as alive", live.watch.health)


def test_it_stands_while_nobody_watches_and_goes_on_where_it_was(lab: App, live: LiveRally, tmp_path: Path) -> None:
    browser = BareBrowser(lab.port)
    session = browser.wait_session(lab, PATIENCE_S)

    def enter(mode: ModeName) -> Callable[[], None]:
        return lambda: session.send(SetMode(mode))

    stands_until(live, session, lambda: session.open_recording("serve"), lambda: session.open_recording(LIVE))
    stands_until(live, session, enter("Train"), enter("Tune"))
    hidden, seen = ({"visible": visible} for visible in (False, True))
    stands_until(live, session, lambda: session._see_page(hidden), lambda: session._see_page(seen))

    browser.close()
    wait_until_it_stands(live)
    live.record(tmp_path / "recorded.h5")
    eventually(
        lambda: live.recorded_s > 0.1, "ten blocks in the file"
    )  # the first one may end a gap, and is not written
    assert live.stop_recording() > 100_000
    wait_until_it_stands(live)
    with live.kept_awake():
        time_passes(live)
    wait_until_it_stands(live)
