"""Export, in a real browser: make a file, see it listed, download it. Screenshots are kept under test-artifacts/."""

import subprocess
import sys

import pytest

from app.export.scenes.scene_file import export_scene
from app.export.selection import Span
from core.recordings import open_recording
from tests.app.browser.window import count_like, open_page, save_screenshot
from tests.app.export.tasks import task_of
from tests.waiting import PATIENCE_S, eventually

TABLE, TOO_BRIGHT = (45, 122, 205), (160, 205, 243)
"""The table in the light of the app, and in that of viser's own lamps beside it."""


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


def test_a_scene_as_a_page_is_lit_as_in_the_app_whenever_it_plays(chromium, serve_recording, tmp_path) -> None:
    with open_recording(serve_recording) as recording:
        span = Span(300_000, 340_000)
        (path,) = export_scene(task_of(recording, tmp_path / "scene.html", span, format="html", stride_us=20_000))
    page = open_page(chromium, 640, 400)
    page.goto(path.as_uri())
    seen = []

    def is_drawn() -> bool:
        seen.append(save_screenshot(page, "scene-page"))
        return count_like(seen[-1], TABLE, 25) > 5000

    eventually(is_drawn, "the table in the light of the app")
    for _ in range(3):  # it lasts 0.16 s: each picture is of another pass
        seen.append(save_screenshot(page, "scene-page"))
    assert max(count_like(picture, TOO_BRIGHT, 25) for picture in seen) < 500, "no lamps of the player's own"
    speed = page.locator("input.mantine-Select-input").input_value()
    assert speed == "0.25x", "of the recording's time, which the clock in the scene shows"
    assert page.locator(".mantine-NumberInput-root").count() == 1
    assert page.locator(".mantine-NumberInput-root").is_hidden(), "the player's own clock has another time, and no unit"
    page.close()
