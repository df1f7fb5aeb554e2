"""What axe-core finds on the page, mode by mode, and keys where controls have the focus."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import pytest

from app.modes.label.keys import KEYS
from tests.waiting import eventually

MODES = ("Watch", "Tune", "Label", "Train", "Export")
GRAVE = ("serious", "critical")
OF_VISER: tuple[str, ...] = ()
"""Selectors of viser's own widgets that are let off; none at present."""


def grave(page) -> list[Any]:
    """Rule and elements of what is serious."""
    found = page.evaluate(
        "exclude => axe.run({exclude: [['canvas'], ...exclude.map(one => [one])]}, {resultTypes: ['violations']})"
        ".then(found => found.violations)",
        list(OF_VISER),
    )
    return [(one["id"], [node["html"][:160] for node in one["nodes"][:5]]) for one in found if one["impact"] in GRAVE]


@pytest.mark.gate
def test_nothing_serious_is_found_in_any_mode(window) -> None:
    window.page.evaluate((files("axe_playwright_python") / "axe.min.js").read_text())
    for mode in MODES:
        if window.state.mode != mode:
            window.press(mode)
            eventually(lambda mode=mode: window.state.mode == mode, mode)
        found: list[Any] = []

        def none_left(found=found) -> bool:  # names are given a moment after the controls have come
            found[:] = grave(window.page)
            return not found

        eventually(none_left, f"names for all controls of {mode}", lambda found=found: found)
    wrong = "document.body.insertAdjacentHTML('beforeend', '<input id=\"nameless\"><img src=\"x.png\">')"
    window.page.evaluate(wrong)
    assert {"label", "image-alt"} <= {rule for rule, _ in grave(window.page)}, "what is wrong would have been found"


def labelling_of(window):
    return window.session._modes["Label"]._editor.labelling


def shown_us(window) -> int | None:
    """The time that Label shows; what is not on the screen yet is not judged by any key."""
    labelling = labelling_of(window)
    return labelling.t_us if labelling.on_screen else None


def keys_label_although_a_checkbox_was_clicked_last(window) -> None:
    page = window.page
    window.seek(100_000)
    box = page.get_by_label("Snap clicks to the events")
    box.click()
    assert page.evaluate("document.activeElement.type") == "checkbox"
    assert ("N", None, "next") in {key[:3] for key in KEYS}
    page.keyboard.press("n")
    eventually(lambda: shown_us(window) == 102_000, "the next time")
    was = box.is_checked()
    page.keyboard.press("Space")
    eventually(lambda: window.state.playhead.anchor_us == 104_000, "Space to go on")
    assert box.is_checked() == was, "Space was for the label, not for the box"
    field = window.field("Radius [px]")
    field.click()
    page.keyboard.press("n")
    field.blur()
    page.keyboard.press("p")
    eventually(lambda: shown_us(window) == 102_000, "the time before: the field kept the key that was pressed in it")


def keys_label_although_a_button_or_a_list_was_clicked_last(window) -> None:
    page = window.page
    window.seek(100_000)
    window.press("5x")
    page.get_by_role("button", name="● 5x").wait_for()
    page.keyboard.press("n")
    eventually(lambda: shown_us(window) == 102_000, "the next time")
    page.keyboard.press("Space")  # after another key Chromium shows the clicked button as if Tab had reached it
    eventually(lambda: window.state.playhead.anchor_us == 104_000, "Space to go on")
    page.get_by_label("Label every").first.click()
    page.locator("div[role=option]").get_by_text("5 ms", exact=True).click()
    eventually(lambda: labelling_of(window).step_us == 5000, "times 5 ms apart")
    page.wait_for_function("document.activeElement === document.body")  # given back by the closed list
    page.keyboard.press("n")
    eventually(lambda: window.state.playhead.anchor_us == 105_000, "the next time, 5 ms apart")
    assert page.get_by_label("Label every").first.input_value() == "5 ms", "nothing was typed into the list"


def test_keys_label_whatever_was_clicked_last(window) -> None:
    window.press("Label")
    eventually(lambda: window.state.mode == "Label", "Label")
    keys_label_although_a_checkbox_was_clicked_last(window)
    keys_label_although_a_button_or_a_list_was_clicked_last(window)
