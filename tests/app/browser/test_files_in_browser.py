"""Open file, in a real browser: the dialog, a file of this computer, and one that is dropped onto the page."""

import base64
from pathlib import Path

from app.state.commands import SetZoom
from core.files import PREFIX
from tests.app.shared.event_files import write_csv, write_npz
from tests.waiting import eventually

DROP = """([name, data]) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([Uint8Array.from(atob(data), (one) => one.charCodeAt(0))], name));
  const canvas = document.querySelector("#root canvas");
  const how = { dataTransfer: transfer, bubbles: true, cancelable: true };
  for (const kind of ["dragenter", "dragover", "drop"]) canvas.dispatchEvent(new DragEvent(kind, how));
}"""


def drop(window, name: str, data: bytes) -> None:
    window.page.evaluate(DROP, [name, base64.b64encode(data).decode()])


def a_file_that_is_dropped_is_sent_imported_described_and_open(window, workspace, tmp_path) -> None:
    page = window.page
    drop(window, "../<b>rally</b> 1.npz", write_npz(tmp_path / "x.npz", 40_000).read_bytes())
    dialog = page.get_by_role("dialog", name="Open file")
    dialog.get_by_role("row", name="events").get_by_text("40,000: 20,000 ON, 20,000 OFF").wait_for()
    assert dialog.get_by_role("list", name="Assumed").get_by_text("does not name its sensor size").count() == 1
    dialog.get_by_label("Width").fill("64")
    dialog.get_by_role("button", name="Check").click()
    dialog.get_by_text("Width and Height go together").wait_for()
    window.screenshot("file-asked")
    dialog.get_by_label("Height").fill("48")
    dialog.get_by_label("Height").press("Enter")
    dialog.get_by_role("row", name="sensor").get_by_text("64x48, as given").wait_for()
    assert dialog.get_by_label("Width").input_value() == "64" and dialog.get_by_role("button", name="Import").count()
    window.screenshot("file-checked")
    drop(window, "another.npz", (tmp_path / "x.npz").read_bytes())
    dialog.get_by_text("waits for your answer: import or cancel it first. another.npz was not opened.").wait_for()
    assert dialog.get_by_label("Width").input_value() == "64", "what was filled in stays"
    dialog.get_by_role("button", name="Cancel").click()
    dialog.get_by_role("list", name="Files of the server").wait_for()
    eventually(lambda: not list(workspace.recordings.glob(f"{PREFIX}*")), "what was sent to be gone")
    page.keyboard.press("Escape")
    drop(window, "../<b>rally</b> 1.npz", (tmp_path / "x.npz").read_bytes())
    dialog.get_by_role("button", name="Import").click()
    card = page.locator("#rallyscope-opened")
    card.get_by_text("40,000 events").wait_for()
    eventually(lambda: window.state.recording == "b-1", "the dropped recording to be open")
    eventually(lambda: page.get_by_label("Recording").first.input_value() == "b-1", "its name in the list")
    assert card.get_by_text("NumPy").count() == 1 and not page.locator("#rallyscope-files").is_visible()
    assert not list(workspace.recordings.glob(f"{PREFIX}*"))
    window.screenshot("file-dropped")


def a_bad_file_is_one_line_and_the_recording_stays(window, workspace) -> None:
    before = sorted(workspace.recordings.iterdir())
    page = window.page
    page.keyboard.press("Control+o")
    page.get_by_role("dialog", name="Open file").wait_for()
    page.get_by_label("File of this computer").set_input_files(
        {"name": "evil.raw", "mimeType": "application/octet-stream", "buffer": b"\x00\xff no events"}
    )
    problem = page.locator("#rallyscope-files .problem")
    problem.get_by_text("evil.raw: The format is not recognised").wait_for()
    window.screenshot("file-refused")
    page.keyboard.press("Escape")
    page.get_by_role("dialog", name="Open file").wait_for(state="hidden")
    assert window.state.recording == "serve" and sorted(workspace.recordings.iterdir()) == before


def a_file_of_the_servers_folders_is_found_and_opened_by_keyboard(window, lab, tmp_path: Path) -> None:
    folder = tmp_path / "camera"
    folder.mkdir()
    for number in range(12):
        write_csv(folder / f"clip {number}.csv", 300)
    lab.services.files.folders = (folder,)
    page = window.page
    page.get_by_role("button", name="Open file...").click()
    page.get_by_label("Search the files").fill("clip 7")
    page.keyboard.press("Tab")
    eventually(lambda: page.locator("#rallyscope-files li").count() == 1, "one file to fit")
    window.screenshot("file-dialog")
    page.locator("#rallyscope-files li button").focus()
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Import").wait_for()  # it has the focus
    page.keyboard.press("Enter")
    eventually(lambda: window.state.recording == "clip-7", "the file to be open")
    assert window.state.mode == "Watch" and not window.state.playhead.playing, "the dialog keeps its keys"


def what_was_said_of_the_file_goes_with_another_recording_and_its_zoom_stays_behind(window) -> None:
    assert window.page.locator("#rallyscope-opened").is_visible()
    window.choose("Recording", "serve")
    eventually(lambda: window.state.recording == "serve", "the other recording")
    window.page.locator("#rallyscope-opened").wait_for(state="hidden")
    window.session.send(SetZoom(6.0))
    window.choose("Recording", "clip-7")
    eventually(lambda: window.state.recording == "clip-7", "the file again")
    assert window.state.tune.zoom == 1.0, "no ball is known in it"


def test_files_are_refused_found_and_dropped(window, lab, workspace, tmp_path: Path) -> None:
    a_bad_file_is_one_line_and_the_recording_stays(window, workspace)
    a_file_of_the_servers_folders_is_found_and_opened_by_keyboard(window, lab, tmp_path)
    a_file_that_is_dropped_is_sent_imported_described_and_open(window, workspace, tmp_path)
    what_was_said_of_the_file_goes_with_another_recording_and_its_zoom_stays_behind(window)
