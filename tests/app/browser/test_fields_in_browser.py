"""Fields that take text, one rule for all: typed by a hand that does not wait."""

import shutil
from urllib.parse import parse_qs

import pytest

from labels.model import Label, LabelState
from labels.store import LabelStore
from tests.app.browser.window import Window
from tests.waiting import eventually

BALL_US = 300_000
KEYBOARD = "() => document.activeElement.tagName"


def enter_label(window: Window):
    """Label mode of a window at the ball, with its picture on the screen."""
    window.seek(BALL_US)
    window.enter("Label")
    mode = window.session._modes["Label"]
    eventually(lambda: mode._editor is not None and window.stands_in_label(), "the picture")
    return mode


def label_at(mode, t_us: int):
    return mode._editor.labelling.here.labels.get(t_us)


def type_fast(window: Window, text: str, *then: str, delay_ms: float = 0) -> None:
    """Type into what has the focus and press keys after it, all without waiting for the page."""
    window.page.keyboard.type(text, delay=delay_ms)
    for key in then:
        window.page.keyboard.press(key)


def is_page_typed_to(window: Window) -> bool:
    return window.page.evaluate(KEYBOARD) != "INPUT"


def a_name_given_in_the_window_is_whole(window: Window, mode, name: str, delay_ms: float) -> None:
    window.page.mouse.move(400, 300)
    window.page.keyboard.press("x")
    field = window.field("Your name")
    field.wait_for()
    type_fast(window, name, "Enter", delay_ms=delay_ms)
    eventually(lambda: label_at(mode, BALL_US), "the label that was asked for")
    assert label_at(mode, BALL_US).provenance.annotator == name


LATE_FIELD = """
async () => {
  const over = document.body.appendChild(document.createElement("section"));
  over.className = "mantine-Modal-content";
  over.tabIndex = -1;
  over.focus();
  await new Promise(requestAnimationFrame);
  over.appendChild(document.createElement("input"));
  await new Promise(requestAnimationFrame);
  const typedTo = document.activeElement.tagName;
  over.remove();
  return typedTo;
}
"""
"""A window that takes the keyboard before its field has come, as on a slow page."""


UNFOCUSED = """
() => {
  const over = document.body.appendChild(document.createElement("section"));
  over.className = "mantine-Modal-content";
  over.appendChild(document.createElement("input")).value = "offered";
}
"""
"""A window that is seen and has not taken the keyboard yet."""
TAKE_AWAY = """
() => {
  const over = document.querySelector("section.mantine-Modal-content"), { value } = over.querySelector("input");
  over.remove();
  return value;
}
"""


def a_field_that_comes_late_has_the_keyboard(window: Window) -> None:
    assert window.page.evaluate(LATE_FIELD) == "INPUT"
    window.page.evaluate(UNFOCUSED)
    type_fast(window, "anna")
    assert window.page.evaluate(TAKE_AWAY) == "anna", "typed before the window took the keyboard"


def a_name_in_the_panel_gives_the_keyboard_back(window: Window, mode, name: str, delay_ms: float) -> None:
    t_us = mode._editor.labelling.t_us
    field = window.field("Annotator")
    field.click()
    field.select_text()
    type_fast(window, name, "Enter", "x", delay_ms=delay_ms)
    eventually(lambda: label_at(mode, t_us), "the label of the key after it")
    assert field.input_value() == name and is_page_typed_to(window)
    assert label_at(mode, t_us).provenance.annotator == mode._editor.labelling.view.annotator == name


def a_name_that_cannot_be_is_refused(window: Window, mode) -> None:
    before, field = mode._editor.labelling.view.annotator, window.field("Annotator")
    for wrong, why in (("x" * 41, "too long a name"), ("", "a name is missing")):
        field.click()
        field.select_text()
        window.page.keyboard.press("Delete")
        type_fast(window, wrong, "Enter")
        window.page.get_by_text(why).first.wait_for()
        eventually(lambda: field.input_value() == before, "the name that holds")
        assert mode._editor.labelling.view.annotator == before and is_page_typed_to(window)


def a_ball_is_typed_box_after_box(window: Window, mode, t_us: int) -> None:
    """The boxes are empty without a label, and no label is placed before all three are filled."""
    window.seek(t_us)
    eventually(lambda: mode._editor.labelling.t_us == t_us and window.stands_in_label(), "the time without a label")
    row = window.page.locator("label", has_text="Centre [px]").locator("xpath=ancestor::*[.//input][1]")
    across, down, radius = row.locator("input").nth(0), row.locator("input").nth(1), window.field("Radius [px]")
    for box, text in ((radius, "5"), (across, "100"), (down, "50")):
        eventually(lambda box=box: box.input_value() == "", "an empty box")
        assert label_at(mode, t_us) is None
        box.click()
        type_fast(window, text, "Enter")
    eventually(lambda: label_at(mode, t_us), "the label")
    label = label_at(mode, t_us)
    assert (label.x_px, label.y_px, label.r_px) == (100.0, 50.0, 5.0)


def a_time_gives_the_keyboard_back(window: Window, mode, text: str, t_us: int, shown: str) -> None:
    field = window.page.get_by_label("Time", exact=True)
    field.click()
    field.select_text()
    type_fast(window, text, "Enter", "Shift+X")
    eventually(lambda: label_at(mode, t_us), "the label of the key after it")
    assert label_at(mode, t_us).state.name == "OUT_OF_FRAME"
    assert is_page_typed_to(window)
    window.page.get_by_text(f"{mode._editor.labelling.t_us} µs", exact=True).wait_for()


def what_is_no_time_is_refused_and_escape_leaves(window: Window, mode) -> None:
    window.seek(BALL_US)
    field, line = window.page.get_by_label("Time", exact=True), window.page.locator("#rallyscope-message")
    for wrong, why in (("12ab000", '"12ab000" is no time'), ("1:00:00.000", "1:00:00.000 is outside this recording")):
        field.click()
        field.select_text()
        type_fast(window, wrong, "Enter")
        eventually(lambda why=why: why in line.inner_text(), "the line that says so")
        assert field.input_value() == "0:00:00.300" and is_page_typed_to(window)
    window.screenshot("field-refused")
    field.click()
    type_fast(window, "77", "Escape")
    assert field.input_value() == "0:00:00.300" and is_page_typed_to(window)
    assert window.state.playhead.anchor_us == BALL_US


@pytest.mark.gate
def test_what_is_typed_counts_whole_and_the_keyboard_comes_back(open_window, lab) -> None:
    for first, second, delay_ms in (("anna", "emil", 0), ("olga", "iwan", 25)):
        with open_window(lab) as window:
            mode = enter_label(window)
            a_name_given_in_the_window_is_whole(window, mode, first, delay_ms)
            a_name_in_the_panel_gives_the_keyboard_back(window, mode, second, delay_ms)
            if not delay_ms:
                a_field_that_comes_late_has_the_keyboard(window)
                a_name_that_cannot_be_is_refused(window, mode)
                a_ball_is_typed_box_after_box(window, mode, 150_000)
                a_time_gives_the_keyboard_back(window, mode, "200000", 200_000, "0:00:00.200")
                a_time_gives_the_keyboard_back(window, mode, "0:00:00.250", 250_000, "0:00:00.250")
                what_is_no_time_is_refused_and_escape_leaves(window, mode)
                export_takes_the_labels_of_who_is_signed_in(window, second)


def export_takes_the_labels_of_who_is_signed_in(window: Window, name: str) -> None:
    window.enter("Export")
    plan = window.session._modes["Export"]._plan
    eventually(lambda: plan.plan.annotator == name, "the labels of who is signed in, not of the first in the alphabet")


def export_asks_whose_labels_are_meant(window: Window, lab, names: tuple[str, str]) -> None:
    for name in names:
        with LabelStore.open(lab.services.workspace.labels, window.session.recording.uuid, "left", name) as store:
            store.put(Label(t_us=BALL_US, state=LabelState.NO_BALL))
    window.enter("Export")
    window.page.get_by_text("You are asked whose labels are meant.").wait_for()
    window.fill(window.field("To [s]"), "0.02")
    window.page.locator("button", has_text="Export").last.click()
    asked = window.page.get_by_role("dialog").filter(has_text="Whose labels?")
    asked.wait_for()
    window.screenshot("export-whose-labels")
    asked.get_by_label("Labels of").first.click()
    window.page.get_by_role("option", name=names[1], exact=True).last.click()
    asked.get_by_role("button", name="Export").click()
    eventually(lambda: window.session._modes["Export"]._plan.plan.annotator == names[1], "the chosen one")
    eventually(lambda: lab.services.exporter.files(), "the file")


def a_number_is_whole_within_its_bounds_or_refused(window: Window) -> None:
    window.enter("Tune")
    field, line = window.field("Zoom"), window.page.locator("#rallyscope-message")
    for text, key, zoom, why in (
        ("12", "Enter", 12.0, None),
        ("99", "Enter", 20.0, "Zoom: 99 does not fit, 20 is taken."),
        ("", "Enter", 20.0, 'Zoom: a number is expected, not ""; it stays 20.'),
        ("5", "Escape", 20.0, None),
    ):
        field.click()
        field.select_text()
        window.page.keyboard.press("Delete")
        type_fast(window, text, key, "Home")
        eventually(lambda zoom=zoom: window.state.tune.zoom == zoom, f"zoom {zoom}")
        eventually(lambda: window.state.playhead.anchor_us == 0, "the key after it")
        eventually(lambda zoom=zoom: field.input_value() == f"{zoom:g}", "the field to show what holds")
        assert is_page_typed_to(window)
        if why is not None:
            eventually(lambda why=why: line.inner_text() == why, why)
        window.seek(BALL_US)


def a_key_that_does_nothing_says_so(window: Window) -> None:
    line = window.page.locator("#rallyscope-message")
    for key, why in (
        ("x", "Key X does nothing in Tune."),
        ("r", "Key R (Redo a slider) changes nothing here in Tune."),
    ):
        window.page.keyboard.press(key)
        eventually(lambda why=why: line.inner_text().startswith(why), why)


def back_and_forward_go_through_modes_and_recordings(window: Window, other: str) -> None:
    first, page = window.state.recording, window.page

    def is_at(recording: str, mode: str) -> bool:
        link = parse_qs(page.evaluate("location.hash.slice(1)"))
        at_page = (link["recording"], link.get("mode", ["Watch"])) == ([recording], [mode])
        return at_page and (window.state.recording, window.state.mode) == (recording, mode)

    eventually(lambda: is_at(first, "Tune"), "the address of Tune")
    window.enter("Watch")
    eventually(lambda: is_at(first, "Watch"), "the address of Watch")
    window.session.open_recording(other)
    eventually(lambda: is_at(other, "Watch"), "the address of the other recording")
    for step, recording, mode in ((page.go_back, first, "Watch"), (page.go_back, first, "Tune")):
        step()
        eventually(lambda recording=recording, mode=mode: is_at(recording, mode), f"back to {mode}")
    for recording, mode in ((first, "Watch"), (other, "Watch")):
        page.go_forward()
        eventually(lambda recording=recording, mode=mode: is_at(recording, mode), f"forward to {recording}")


@pytest.mark.gate
def test_numbers_idle_keys_history_and_whose_labels_are_exported(window, lab, workspace) -> None:
    shutil.copy(workspace.recording_path("serve"), workspace.recording_path("other"))
    a_number_is_whole_within_its_bounds_or_refused(window)
    a_key_that_does_nothing_says_so(window)
    back_and_forward_go_through_modes_and_recordings(window, "other")
    export_asks_whose_labels_are_meant(window, lab, ("ann", "zoe"))
