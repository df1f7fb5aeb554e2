"""Events in space and time in Tune and Label, in a real browser. The screenshots are kept under test-artifacts/."""

import math

import numpy as np

from app.pictures.palette import PaletteIndex, palette
from app.state.commands import SetMethod, SetOverlay, SetZoom
from core.geometry import look_at
from labels.model import Label, LabelState
from tests.app.browser.window import count_like
from tests.waiting import eventually

BALL_US = 300_000
YELLOW, WHITE = (255, 225, 60), (235, 235, 235)
LABELLED = tuple(palette("orange / blue")[PaletteIndex.LABEL].tolist())
LABELLED_IN_SPACE = (167, 227, 198)
"""The same as the scene's tone mapping draws lines of it."""
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


def test_label_shows_its_labels_in_space_and_time_and_a_click_there_chooses_the_cluster_in_tune(window) -> None:
    window.session.send(SetMethod("auto"))
    window.seek(BALL_US)
    window.enter("Label")
    mode, host = window.session._modes["Label"], window.session
    eventually(lambda: "left" in mode._editor.labelling.saved, "the labels to be read")
    truth = host.recording.cameras["left"].truth
    for t_us in range(BALL_US - 8_000, BALL_US + 10_000, 2_000):
        u, v, r = (float(one[0]) for one in (truth.at(t_us).u_px, truth.at(t_us).v_px, truth.at(t_us).r_px))
        label = Label(t_us=t_us, state=LabelState.VISIBLE, x_px=u, y_px=v, r_px=r)
        mode._editor.writer.write(
            mode._editor.labelling.layer, lambda store, label=label: (store.put(label), ())[1], print, print
        )
    host.later(lambda: mode._editor.change_view({"zoom": 10.0}))
    window.press("3D")
    window.page.get_by_text("17 windows, 34 ms").wait_for()
    eventually(lambda: host.space.visible and not host.plane._visible and not host.world.visible, "one view at a time")
    window.press("verdict")
    green = palette("orange / blue")[PaletteIndex.HULL]
    eventually(lambda: (host.space._shown.colours == green).all(axis=1).any(), "the ball in the colour of its verdict")
    window.wait_until_camera_stands()
    window.wait_for_pixels("label-space-time", lambda canvas: count_like(canvas, LABELLED_IN_SPACE) > 200)
    window.click_picture(*place_of(window, np.zeros(3)))
    eventually(lambda: host.state.tune.picked is not None, "the cluster to be chosen")
    window.press("Picture")
    eventually(lambda: not host.space.visible and host.plane._visible, "the picture again")
    window.wait_for_pixels("label-space-time-left", lambda canvas: count_like(canvas, LABELLED) > 40)
    window.enter("Tune")
    window.page.locator(PICKED).first.wait_for()


def place_of(window, p: np.ndarray) -> tuple[int, int]:
    """Where a point of the scene is on the page."""
    camera, box = window.session.client.camera, window.page.locator("#root canvas").first.bounding_box()
    away = (p - camera.position) @ look_at(camera.position, camera.look_at)[:3, :3]
    x, y = away[:2] / away[2] / math.tan(camera.fov / 2) * box["height"] / 2
    return round(box["x"] + box["width"] / 2 + x), round(box["y"] + box["height"] / 2 + y)
