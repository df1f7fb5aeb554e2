"""Tune's events in space and time, in a real browser. The screenshots are kept under test-artifacts/."""

import math

import numpy as np

from app.state.commands import SetMethod, SetOverlay, SetZoom
from core.geometry import look_at
from tests.app.browser.window import count_like
from tests.waiting import eventually

BALL_US = 300_000
YELLOW, WHITE = (255, 225, 60), (235, 235, 235)
PICKED = "tr[style*='255,140,40'], tr[style*='255, 140, 40']"


def test_events_are_shown_in_space_and_time_and_a_click_chooses_a_cluster(window) -> None:
    window.session.send(SetMethod("auto"))
    window.seek(BALL_US)
    window.press("Tune")
    window.session.send(SetZoom(8.0))
    window.session.send(SetOverlay("clusters"))
    window.page.get_by_text("ball at").first.wait_for()
    window.press("3D")
    window.page.get_by_text("17 windows, 34 ms").wait_for()
    window.wait_until_camera_stands()
    window.wait_for_pixels(
        "space-time", lambda canvas: count_like(canvas, YELLOW) > 200 and count_like(canvas, WHITE) > 100
    )
    assert window.page.locator(PICKED).count() == 0
    window.click_picture(*place_of(window, np.zeros(3)))  # the ball is in the middle of the zoomed region
    window.page.locator(PICKED).first.wait_for()
    window.press("Picture")
    eventually(lambda: window.session.plane.sheet.pictures and not window.state.tune.in_space, "the picture again")
    window.wait_for_pixels("space-time-left", lambda canvas: count_like(canvas, YELLOW) > 40)


def place_of(window, p: np.ndarray) -> tuple[int, int]:
    """Where a point of the scene is on the page."""
    camera, box = window.session.client.camera, window.page.locator("#root canvas").first.bounding_box()
    away = (p - camera.position) @ look_at(camera.position, camera.look_at)[:3, :3]
    x, y = away[:2] / away[2] / math.tan(camera.fov / 2) * box["height"] / 2
    return round(box["x"] + box["width"] / 2 + x), round(box["y"] + box["height"] / 2 + y)
