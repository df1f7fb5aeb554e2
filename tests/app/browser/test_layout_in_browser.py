"""Where things stand in the window, at two sizes: boxes as the browser draws them. Screenshots are kept."""

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from app.server import App
from app.views.image_view import UNIT, framing
from tests.app.browser.window import Window, open_page
from tests.waiting import eventually

PANEL = "[data-rallyscope-lower]"
Box = tuple[float, float, float, float]
"""Left, top, right, bottom, CSS px."""


def box_of(page: Page, selector: str) -> Box:
    found = page.locator(selector).first.bounding_box()
    assert found is not None, selector
    return found["x"], found["y"], found["x"] + found["width"], found["y"] + found["height"]


def picture_box(window: Window) -> Box:
    """The whole mosaic, as the browser's camera was put before it."""
    plane, (left, top, right, bottom) = window.session.plane, box_of(window.page, "#root canvas")
    sheet, aspect = plane.sheet, (right - left) / (bottom - top)
    visible, middle = framing(sheet.width, sheet.height, aspect, plane.panel_share)
    scale = (bottom - top) / visible
    x, y = (left + right) / 2 - sheet.width / 2 * scale, (top + bottom) / 2 - middle * scale
    return x, y, x + sheet.width * scale, y + sheet.height * scale


def camera_height(window: Window) -> float:
    """Visible height of the mosaic from where the browser's own camera is, in its pixels."""
    camera = window.session.client.camera
    return 2 * abs(camera.position[2]) * float(np.tan(camera.fov / 2)) / UNIT


def area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])


def assert_nothing_overlaps(window: Window, share: float) -> None:
    """The picture stands above the panel and that above the time bar; the picture has this share of what is free."""
    page = window.page
    canvas, panel, bar = (box_of(page, one) for one in ("#root canvas", PANEL, "#rallyscope-bar"))

    def stands() -> bool:
        picture = picture_box(window)
        inside = picture[0] >= canvas[0] - 1 and picture[2] <= canvas[2] + 1 and picture[1] >= canvas[1] - 1
        return inside and picture[3] <= box_of(page, PANEL)[1] + 1

    eventually(stands, "the picture above the panel", lambda: (picture_box(window), box_of(page, PANEL)))
    assert panel[3] <= bar[1] and panel[2] - panel[0] >= canvas[2] - canvas[0] - 20

    def shown_share() -> float:
        free = area((canvas[0], canvas[1], canvas[2], box_of(page, PANEL)[1]))
        return area(picture_box(window)) / free

    eventually(lambda: shown_share() > share, "the picture to take the shape of what is free", shown_share)


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1920, 1080)])
def test_picture_panel_and_bar_share_the_middle_and_the_panel_keeps_the_height_it_was_dragged_to(
    chromium: Browser, lab: App, width: int, height: int
) -> None:
    page = open_page(chromium, width, height)
    window = Window(page, lab, in_space=True)
    window.enter("Tune")  # from the 3D view, whose middle is narrower
    eventually(lambda: window.session.plane.sheet.pictures, "a picture")
    assert_nothing_overlaps(window, 0.8)
    shape = {"visible": 0.0}

    def as_framed() -> bool:
        plane, (left, top, right, bottom) = window.session.plane, box_of(page, "#root canvas")
        sheet = plane.sheet
        shape["visible"] = framing(sheet.width, sheet.height, (right - left) / (bottom - top), plane.panel_share)[0]
        return camera_height(window) == pytest.approx(shape["visible"], rel=0.01)

    eventually(as_framed, "the browser's camera to frame the picture", lambda: (camera_height(window), shape))
    before = box_of(page, PANEL)
    grip = page.locator(f"{PANEL} [data-dock-griphandle]").bounding_box()
    assert grip is not None
    x, y = grip["x"] + 60, grip["y"] + grip["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 60, steps=3)
    page.mouse.move(x, y - 120, steps=3)
    page.mouse.up()
    eventually(lambda: box_of(page, PANEL)[1] < before[1] - 110, "the panel to be higher")
    assert box_of(page, PANEL)[3] == pytest.approx(before[3], abs=1)
    assert_nothing_overlaps(window, 0.75)
    window.screenshot(f"layout-tune-{width}")
    tall = box_of(page, PANEL)
    page.reload()
    page.locator(PANEL).wait_for()
    eventually(lambda: abs(box_of(page, PANEL)[1] - tall[1]) <= 1, "the panel as high as it was left")
    page.close()


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1920, 1080)])
def test_labels_large_picture_has_most_of_the_middle(chromium: Browser, lab: App, width: int, height: int) -> None:
    page = open_page(chromium, width, height)
    window = Window(page, lab, in_space=True)
    window.enter("Label")  # from the 3D view, whose middle is narrower
    eventually(window.stands_in_label, "Label's picture")

    def share() -> float:
        canvas, bar = box_of(page, "#root canvas"), box_of(page, "#rallyscope-bar")
        picture, sheet = picture_box(window), window.session.plane.sheet
        large = sheet.pictures[0]
        scale = (picture[2] - picture[0]) / sheet.width
        return large.width * large.height * scale**2 / area((canvas[0], canvas[1], canvas[2], bar[1]))

    eventually(lambda: share() > 0.6, "the large picture to have most of the middle", share)
    window.screenshot(f"layout-label-{width}")
    page.close()
