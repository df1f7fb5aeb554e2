"""The table's corners are clicked in both pictures, and the live source goes on with the poses that they give."""

import math
import re
from dataclasses import replace

import numpy as np

from app.modes.watch.table import ChooseTableCorner
from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from app.views.image_view import FOV_RAD, UNIT
from core.cameras import load_calibration, stereo_preset
from core.cameras.calibration.table_corners import CORNERS
from core.geometry import look_at
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from tests.waiting import eventually

CLICKED = ("net-left", "net-right", "robot-centre", "post-left", "post-right")
"""Both cameras see these."""


def test_corners_that_are_clicked_place_the_cameras_of_a_live_source(
    chromium, tmp_path, serve_recording, open_window
) -> None:
    true = stereo_preset()
    elsewhere = {name: replace(one, T_world_camera=look_at((-3.0, 0.3, 2.0), (0, 0, 0))) for name, one in true.items()}
    source = ReplaySource(open_recording(serve_recording), "serve.h5", speed=0.5)
    source.recalibrate({"left": elsewhere["left"]})
    workspace, live = Workspace(tmp_path), LiveRally(source)
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    try:
        with open_window(lab) as window:
            page, session = window.page, window.session
            eventually(lambda: live.cameras and live.cameras["left"].position_world_m[0] < -2.9, "wrong poses")
            page.get_by_role("button", name="Pictures", exact=True).or_(
                page.get_by_role("button", name="● Pictures", exact=True)
            ).first.click()
            eventually(lambda: len(session.plane.sheet.pictures) == 2, "both pictures")
            page.get_by_text("Table", exact=True).click()
            page.get_by_label("Click the corners").check()
            eventually(lambda: window.state.watch.table.active, "clicks to be corners")
            for number, (name, camera) in enumerate(true.items()):
                for corner in CLICKED:
                    u_px, v_px = camera.project(np.array([CORNERS[corner]]))[0].tolist()
                    session.send(ChooseTableCorner(corner))
                    eventually(lambda corner=corner: window.state.watch.table.corner == corner, corner)
                    count = len(window.state.watch.table.of(name))
                    page.mouse.click(*_screen(window, number, u_px, v_px), delay=60)
                    eventually(lambda name=name, n=count: len(window.state.watch.table.of(name)) == n + 1, f"{corner}")
            page.get_by_text("px off, most").nth(1).wait_for()
            window.press("Undo the click")
            eventually(lambda: len(window.state.watch.table.of("right")) == len(CLICKED) - 1, "the click to be undone")
            page.get_by_text("px off, most").nth(1).wait_for()
            page.get_by_text("Sweep of the ball", exact=True).click()
            page.get_by_label("Show missing parts").check()
            page.get_by_text("of 48 parts").nth(1).wait_for()
            eventually(lambda: len(window.state.watch.swept.missing("left")) < 48, "the ball to be counted")
            window.screenshot("table-clicked")
            drift = live._drift
            window.press("Use these poses")
            page.get_by_text("Calibration written").first.wait_for()
            eventually(
                lambda: live.cameras["left"].position_world_m[0] > -2.0, "the source to go on with the new poses"
            )
            eventually(lambda: live._drift is not drift and live.drift.points > 0, "the poses to be watched from anew")
            window.press("3D")
            page.get_by_text(re.compile(r"Not yet known|points of the ball")).first.wait_for()
        (path,) = workspace.cameras.glob("table-*.toml")
        assert path.with_suffix(".csv").exists()
        for name, written in load_calibration(path).items():
            assert np.linalg.norm(written.position_world_m - true[name].position_world_m) < 0.1
            np.testing.assert_allclose(live.cameras[name].T_world_camera, written.T_world_camera)
    finally:
        lab.stop()


def _screen(window, number: int, u_px: float, v_px: float) -> tuple[float, float]:
    """CSS pixels of a sensor point of one of the pictures."""
    tile = window.session.plane.sheet.pictures[number]
    x = tile.x + (u_px + 0.5 - tile.region.x) / tile.region.width * tile.width
    y = tile.y + (v_px + 0.5 - tile.region.y) / tile.region.height * tile.height
    box = window.page.locator("canvas").first.bounding_box()
    camera = window.session.client.camera
    scale = box["height"] / (2 * abs(camera.position[2]) * math.tan(FOV_RAD / 2))
    return (
        box["x"] + box["width"] / 2 + (x * UNIT - camera.look_at[0]) * scale,
        box["y"] + box["height"] / 2 + (y * UNIT - camera.look_at[1]) * scale,
    )
