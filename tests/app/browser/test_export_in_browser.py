"""Export, in a real browser: make a file, see it listed, download it. Screenshots are kept under test-artifacts/."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.browser


def test_a_part_of_a_recording_becomes_a_rerun_file_that_can_be_downloaded(window, lab, workspace, wait_for, tmp_path):
    page = window.page
    window.press("Export")
    wait_for(lambda: window.state.mode == "Export", "the mode")
    page.get_by_text("In the Rerun file").wait_for()
    page.get_by_text("config A, as it comes").wait_for()
    window.fill(window.field("From [s]"), "0.1")
    window.fill(window.field("To [s]"), "0.2")
    page.keyboard.press("Enter")
    page.wait_for_timeout(500)
    page.locator("button", has_text="Export").last.click()
    exporter = lab.services.exporter
    wait_for(lambda: exporter.files(), "the file", 90)
    (made,) = exporter.files()
    assert made.name == "serve-1.rrd"
    wait_for(lambda: list(workspace.exports.iterdir()) == [workspace.exports / made.name], "its folder to be gone")
    page.get_by_role("button", name="Download").wait_for()
    page.get_by_text("serve-1.rrd:").wait_for()
    window.screenshot("export")
    with page.expect_download(timeout=90_000) as waiting:
        page.get_by_role("button", name="Download").click()
    waiting.value.save_as(tmp_path / "down.rrd")
    assert (tmp_path / "down.rrd").read_bytes() == (workspace.exports / made.name).read_bytes()
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(tmp_path / "down.rrd")]
    assert subprocess.run(command, check=False, timeout=60).returncode == 0
    page.locator("button", has_text="Export").last.click()
    wait_for(lambda: len(exporter.files()) == 2, "the second file", 90)
    wait_for(lambda: page.get_by_label("File").first.input_value() == "serve-2.rrd", "the newest to be chosen")
