"""Export, in a real browser: make a file, see it listed, download it. Screenshots are kept under test-artifacts/."""

import subprocess
import sys

import pytest

from tests.waiting import PATIENCE_S, eventually


@pytest.mark.gate
def test_a_part_of_a_recording_becomes_a_rerun_file_that_can_be_downloaded(window, lab, workspace, tmp_path):
    page = window.page
    window.press("Export")
    eventually(lambda: window.state.mode == "Export", "the mode")
    page.get_by_text("In the Rerun file").wait_for()
    page.get_by_text("config A: method refined, default settings").wait_for()
    window.fill(window.field("From [s]"), "0.1")
    window.fill(window.field("To [s]"), "0.2")
    page.keyboard.press("Enter")
    plan = window.session._modes["Export"]._plan
    eventually(lambda: (plan.plan.start_us, plan.plan.end_us) == (100_000, 200_000), "the part")
    page.locator("button", has_text="Export").last.click()
    exporter = lab.services.exporter
    eventually(lambda: exporter.files(), "the file")
    (made,) = exporter.files()
    assert made.name == "serve-1.rrd"
    eventually(lambda: list(workspace.exports.iterdir()) == [workspace.exports / made.name], "its folder to be gone")
    page.get_by_role("button", name="Download").wait_for()
    page.get_by_text("serve-1.rrd:").wait_for()
    window.screenshot("export")
    with page.expect_download() as waiting:
        page.get_by_role("button", name="Download").click()
    waiting.value.save_as(tmp_path / "down.rrd")
    assert (tmp_path / "down.rrd").read_bytes() == (workspace.exports / made.name).read_bytes()
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(tmp_path / "down.rrd")]
    assert subprocess.run(command, check=False, timeout=PATIENCE_S).returncode == 0
    page.locator("button", has_text="Export").last.click()
    eventually(lambda: len(exporter.files()) == 2, "the second file")
    eventually(lambda: page.get_by_label("File").first.input_value() == "serve-2.rrd", "the newest to be chosen")
