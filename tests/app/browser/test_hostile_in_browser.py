"""Names and messages of a recording, labels, a config and a training are markup: nothing of it runs in the page."""

from collections.abc import Iterator

import pytest

from app.server import App
from app.shared.library import Library
from app.shared.trainer import LOG_NAME
from app.shared.workspace import Workspace
from core.learning.runs.run_files import create_run
from core.recordings import open_recording
from labels.model import Label, LabelState
from labels.store import LabelStore
from tests.app.hostile_recording import HOSTILE, write_hostile_recording
from tests.app.modes.train.small_runs import small_run
from tests.waiting import eventually

RUNS_IF_MARKUP = "<img src=x onerror=window.__pwned=1>"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    workspace = Workspace(tmp_path_factory.mktemp("hostile"))
    path = workspace.recording_path("hostile")
    write_hostile_recording(path)
    with open_recording(path) as recording:
        for camera in recording.cameras:
            with LabelStore.open(workspace.labels, recording.uuid, camera, HOSTILE[:100]) as store:
                store.edit(put=[Label(t_us=0, state=LabelState.NO_BALL)])
    workspace.config_path("mine").write_text(f"method = {RUNS_IF_MARKUP!r}\n")
    create_run(workspace.run_path("mine"), small_run())
    (workspace.run_path("mine") / LOG_NAME).write_text(HOSTILE)
    lab = App(workspace, Library(workspace), "hostile", host="127.0.0.1", port=0)
    yield lab
    lab.stop()


@pytest.mark.gate
def test_nothing_that_a_file_says_runs_in_the_page(window) -> None:
    page = window.page
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    for mode in ("Tune", "Label", "Train", "Export", "Watch"):
        window.enter(mode)  # at rest: else a tab of the mode before is still there, and goes as it is clicked
        for tab in page.get_by_role("tab").all():
            if tab.is_visible():
                tab.click()
                window.wait_for_frame()
    window.screenshot("hostile")
    eventually(lambda: "window.__pwned=1" in page.content(), "the hostile text: if it is not shown nothing is proved")
    assert page.evaluate("window.__pwned") is None
    assert not [url for url in requests if url.endswith("/x")], "an image of the hostile text was asked for"
