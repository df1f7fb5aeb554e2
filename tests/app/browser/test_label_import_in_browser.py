"""Label files of another tool are looked at in the app before they are accepted, in a real browser."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from app.modes.label.label_files import FOLDER, RING
from labels.model import PositionSource
from labels.store import LabelStore, Layer, has_labels
from tests.app.browser.window import count_like
from tests.waiting import eventually

TIMES_US = tuple(range(250_000, 350_000, 10_000))


def test_labels_that_are_uploaded_are_shown_over_their_events_and_stored_only_when_accepted(
    window, workspace, tmp_path
) -> None:
    window.seek(300_000)
    window.press("Label")
    mode = window.session._modes["Label"]
    eventually(lambda: mode._editor is not None, "Label")
    recording = mode._editor.labelling.recording
    truth = recording.cameras["left"].truth.at(np.array(TIMES_US))
    folder = tmp_path / "packed" / "labels"
    folder.mkdir(parents=True)
    (folder / "classes.txt").write_text("person\nball\n")
    for t_us, u, v, r in zip(TIMES_US, truth.u_px, truth.v_px, truth.r_px, strict=True):
        box = f"{(u + 0.5) / 1280:.6f} {(v + 0.5) / 720:.6f} {2 * r / 1280:.6f} {2 * r / 720:.6f}"
        (folder / f"left_t{t_us:012d}us_png.rf.0a1b2c3d4e5f.txt").write_text(f"1 {box}\n0 0.5 0.5 0.2 0.2\n")
    (folder / "holiday.txt").write_text("1 0.5 0.5 0.01 0.01\n")
    layer = Layer(recording.uuid, "left", "imported")
    archive = Path(shutil.make_archive(str(tmp_path / "yolo of the lab"), "zip", tmp_path / "packed"))
    page = window.page
    page.get_by_text("Import labels", exact=True).click()
    window.press("Upload labels ...")
    sent, problem = (page.locator(f"#rallyscope-label-files {part}") for part in ("[type=file]", ".problem"))
    page.get_by_role("dialog", name="Upload labels").wait_for()
    sent.set_input_files({"name": "of bea.zip", "mimeType": "application/zip", "buffer": b"no zip"})
    eventually(lambda: "not a ZIP file that can be read" in problem.inner_text(), "it to be refused")
    window.screenshot("label-upload")
    sent.set_input_files(archive)
    page.get_by_role("dialog", name="Upload labels").wait_for(state="hidden")
    eventually(lambda: mode._imports._panel.chosen[0] == "yolo-of-the-lab", "the folder to be chosen")
    assert (workspace.root / FOLDER / "yolo-of-the-lab" / "classes.txt").exists()
    window.choose("Made by", "YOLO")
    eventually(lambda: mode._imports._panel._format.value == "YOLO", "the format")
    window.press("Look at them")
    accept = page.get_by_role("button", name="Accept 10 labels")
    accept.wait_for()
    accept.scroll_into_view_if_needed()
    page.get_by_text("rejected: class ... is not ...").wait_for()
    page.get_by_text("rejected: which picture is it?").wait_for()
    assert not has_labels(workspace.labels, layer)
    in_panel = (slice(None), slice(870, None))
    window.wait_for_pixels("label-import", lambda seen: count_like(seen, RING, 40) > 100, in_panel)  # the circles
    accept.click()
    page.get_by_text("10 labels stored for 'imported', camera left").wait_for()
    window.screenshot("label-imported")
    stored = LabelStore.read(workspace.labels, layer).all()
    assert [label.t_us for label in stored] == list(TIMES_US)
    assert (
        np.hypot(*(np.array([(one.x_px, one.y_px) for one in stored]) - np.stack([truth.u_px, truth.v_px], 1)).T).max()
        < 0.01
    )
    assert {label.provenance.source for label in stored} == {PositionSource.IMPORTED}
