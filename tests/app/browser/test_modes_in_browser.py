"""From one mode to the next, in a real browser. Screenshots are kept under test-artifacts/."""

import shutil
import zipfile
from pathlib import Path

import pytest

from app.modes.watch.commands import ShowSpace
from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.state.commands import SetCamera, StopAt
from core.history.missed_balls import MissedBallRequest, find_missed_ball
from core.history.rally_history import Outcome
from core.history.rally_picture import LandingSpot
from core.physics.episode import Case
from labels.model import Label, LabelState
from labels.store import LabelStore
from tests.app.browser.window import choose_in
from tests.app.export.rrd.rerun_viewer import entities, viewer
from tests.waiting import eventually


@pytest.mark.gate
def test_a_missed_ball_in_watch_is_looked_at_in_tune_and_labelled(window, lab) -> None:
    window.session.send(ShowSpace(True))
    following = lab.services.rallies.of(window.session.recording)
    eventually(lambda: following.followed == 1.0, "the chain to follow the recording")
    following.history.add_outcome(Outcome(590_000, 10_000, 5.0, LandingSpot(0.0, 0.0, Case.MISSED)))
    window.session.send(StopAt(595_000))
    window.page.get_by_text("was not returned").wait_for()
    missed = find_missed_ball(MissedBallRequest(window.session.recording, following.history, 595_000))
    window.screenshot("watch-missed")
    window.press("Look at it in Tune")
    eventually(lambda: window.state.mode == "Tune", "Tune")
    assert window.state.playhead.position_us(0.0) == missed.t_us and window.state.camera == missed.camera
    other = next(name for name in window.state.cameras if name != missed.camera)
    window.session.send(SetCamera(other))
    window.press("Watch")
    eventually(lambda: window.state.mode == "Watch", "Watch again")
    window.session.send(StopAt(595_000))
    window.press("Label it")
    label = window.session._modes["Label"]
    eventually(lambda: window.state.mode == "Label" and label._editor is not None, "Label")
    eventually(lambda: label._editor.labelling.view.camera == missed.camera, "its camera")
    eventually(lambda: abs(label._editor.labelling.t_us - missed.t_us) <= window.state.step_us, "its moment")
    assert window.state.recording == "serve"


def test_labels_are_exported_and_the_detector_is_scored_against_them(window, workspace, tmp_path) -> None:
    recording, page = window.session.recording, window.page
    truth = recording.cameras["left"].truth
    with LabelStore.open(workspace.labels, recording.uuid, "left", "anna") as store:
        for t_us in range(200_000, 260_000, 4_000):
            at = truth.at([t_us])
            x, y, r = (float(column[0]) for column in (at.u_px, at.v_px, at.r_px))
            store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x, y_px=y, r_px=r))
    window.press("Label")
    label = window.session._modes["Label"]
    eventually(lambda: label._editor is not None, "Label")
    window.session.later(lambda: label._use_name("anna"))
    eventually(lambda: len(label._editor.labelling.here.labels) == 15, "the labels")
    choose_in(page.get_by_label("Format", exact=True).first, "COCO", exact=False)
    with page.expect_download() as waiting:
        window.press("Download labels")
    waiting.value.save_as(tmp_path / "labels.zip")
    (made,) = workspace.exports.glob("*.zip")
    assert made.name == "serve-left-anna-coco-1.zip" and (tmp_path / "labels.zip").read_bytes() == made.read_bytes()
    assert any(name.endswith(".json") for name in zipfile.ZipFile(made).namelist())
    page.get_by_text("15 labels, 0 pictures").wait_for()
    window.screenshot("label-exported")
    window.press("Score the detector")
    eventually(lambda: window.state.mode == "Tune", "Tune")
    page.get_by_text("The detector against your labels").wait_for()
    page.get_by_text("15 labels by anna").first.wait_for()
    over = page.locator("[class*=mantine-Modal-content]")
    eventually(lambda: over.bounding_box()["width"] > 900, "room for the table and the picture")
    right = max(box["x"] + box["width"] for box in (part.bounding_box() for part in over.locator("th, svg").all()))
    assert right < over.bounding_box()["x"] + over.bounding_box()["width"], "nothing is cut off"
    window.screenshot("label-scored")
    window.press("Back to Label")
    over.wait_for(state="detached")
    eventually(lambda: window.state.mode == "Label", "Label again")
    assert window.state.score_by is None and window.state.camera == "left"
    window.press("Export")
    eventually(lambda: window.state.mode == "Export", "Export")
    export = window.session._modes["Export"]
    eventually(lambda: export._plan.plan.annotator == "anna", "the labels that are there to be part of a Rerun file")


def test_a_recording_is_streamed_to_the_viewer_of_the_command_line(
    open_window, tmp_path, serve_recording: Path
) -> None:
    workspace = Workspace(tmp_path / "workspace")
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    with viewer(tmp_path / "seen.rrd") as (address, _):
        lab = App(workspace, Library(workspace), "serve", host="127.0.0.1", port=0, viewer_address=address)
        try:
            with open_window(lab) as window:
                window.press("Export")
                window.page.get_by_text(address).wait_for()
                window.fill(window.field("From [s]"), "0.2")
                window.fill(window.field("To [s]"), "0.3")
                window.page.keyboard.press("Enter")
                plan = window.session._modes["Export"]._plan
                eventually(lambda: (plan.plan.start_us, plan.plan.end_us) == (200_000, 300_000), "the part")
                window.press("Stream to Rerun")
                window.page.get_by_text("serve: all of it was sent").wait_for()
                window.screenshot("export-stream")
                eventually(lambda: "world/ball/triangulated" in entities(tmp_path / "seen.rrd"), "the viewer to write")
        finally:
            lab.stop()
