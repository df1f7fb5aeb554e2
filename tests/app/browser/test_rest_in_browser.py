"""The live rally pauses behind another tab, in headless Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.server import App
from app.shared import rallies
from app.shared.library import Library
from app.shared.live_rally import LIVE, SimulationProcess, join_simulation
from app.shared.workspace import Workspace
from tests.waiting import eventually

TURN_AWAY = """state => {
  Object.defineProperty(document, "visibilityState", { value: state, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[App]:
    monkeypatch.setattr(rallies, "GRACE_S", 0.2)
    workspace = Workspace(tmp_path / "data")
    process = SimulationProcess("--auto-serve", "5", "--seed", "3", "--sensor", "160x120")
    live = join_simulation(process.wait(), process=process)
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    yield lab
    lab.stop()


def test_the_live_rally_pauses_behind_another_tab_and_goes_on_in_front(lab: App, open_window) -> None:
    with open_window(lab, in_space=True) as window:
        live = lab.services.rallies.live
        assert live is not None

        def goes_on() -> None:
            from_us = live.recording.duration_us
            eventually(lambda: live.recording.duration_us > from_us, "the rally to go on")

        goes_on()
        assert live.is_awake
        window.page.evaluate(TURN_AWAY, "hidden")
        eventually(lambda: not live.is_awake, "the rally to pause")
        window.page.evaluate(TURN_AWAY, "visible")
        eventually(lambda: live.is_awake, "the rally to be wanted again")
        goes_on()
        window.screenshot("rest-goes-on")
