"""Balls in Watch: found with one click, selected by conditions, and a click opens their moment."""

from __future__ import annotations

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
