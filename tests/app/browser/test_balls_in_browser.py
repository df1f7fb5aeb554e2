"""Balls in Watch: found with one click, selected by conditions or with a lasso, and a click opens their moment."""

from __future__ import annotations

import numpy as np

from app.modes.watch.ball_scatter import WIDTH_PX, ScatterAxes, draw_scatter
from app.shared.ball_index import ball_sources, index_balls
from core.data_sets import CARD, read_manifest
from labels.balls.to_label import read_moments
from tests.waiting import eventually


def test_balls_are_found_selected_and_opened_at_their_moment(window) -> None:
    page = window.page
    page.get_by_text("Balls", exact=True).click()
    page.get_by_role("button", name="Find balls").click()
    flight, bounce = page.locator("a", has_text="flight"), page.locator("a", has_text="bounce")
    flight.wait_for()
    assert (flight.count(), bounce.count()) == (1, 1)
    window.screenshot("balls")
    window.fill(window.field("Conditions"), "kind=bounce speed_mps=5..6")
    flight.wait_for(state="detached")
    t_us = round(1e6 * float(bounce.inner_text().split()[1]))
    bounce.click()
    eventually(lambda: window.state.playhead.anchor_us == t_us, "the bounce")
    page.get_by_role("button", name="Tune", exact=True).last.click()
    page.locator("a[href*='mode=Tune']").click()
    eventually(lambda: window.state.mode == "Tune", "Tune")
    assert window.state.playhead.anchor_us == t_us


def test_a_point_opens_its_moment_and_a_lasso_is_what_is_labelled(window) -> None:
    page = window.page
    page.get_by_text("Balls", exact=True).click()
    page.get_by_role("button", name="Find balls").click()
    points = page.locator("[data-rallyscope-balls]")
    flight, bounce = page.locator("a", has_text="flight"), page.locator("a", has_text="bounce")
    bounce.wait_for()
    points.scroll_into_view_if_needed()
    root, box = window.lab.services.workspace.root, points.bounding_box()
    scatter = draw_scatter(index_balls(ball_sources(root), root).table, np.arange(2), ScatterAxes())
    x, y = np.array([box["x"], box["y"]]) + scatter.places_px[1] * box["width"] / WIDTH_PX
    window.screenshot("ball-points")
    page.mouse.click(x, y)
    t_us = round(1e6 * float(bounce.inner_text().split()[1]))
    eventually(lambda: window.state.playhead.anchor_us == t_us, "the bounce")
    page.mouse.move(x - 9, y - 9)
    page.mouse.down()
    for dx, dy in ((9, -9), (9, 9), (-9, 9)):
        page.mouse.move(x + dx, y + dy)
    page.mouse.up()
    flight.wait_for(state="detached")
    window.screenshot("ball-lasso")
    page.get_by_role("button", name="To label").click()
    uuid = window.session.recording.uuid
    eventually(lambda: read_moments(root, uuid) == (t_us,), "the list to label")
    made = root / "data-sets" / "balls"
    page.get_by_role("button", name="Data set").click()
    eventually(lambda: (made / CARD).is_file(), "the data set")
    page.get_by_text("1 flight (1 training").wait_for()
    window.screenshot("ball-data-set")
    (entry,) = read_manifest(made)["recordings"]
    assert entry["flight"]["start_us"] < t_us < entry["flight"]["end_us"], "the flight of the bounce"
    assert "a line drawn round points" in (made / CARD).read_text()
    page.get_by_role("button", name="Show all again").click()
    flight.wait_for()
