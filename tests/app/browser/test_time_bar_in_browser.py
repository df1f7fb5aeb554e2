"""The bar under the picture, by mouse and by key."""

from app.state.commands import SetPlaybackSpeed
from tests.waiting import eventually


def line_of(window) -> dict:
    line = window.page.locator("#rallyscope-line")
    line.wait_for()
    box = line.bounding_box()
    assert box is not None
    return box


def a_click_on_the_line_goes_there_and_a_drag_scrubs(window) -> None:
    box, duration_us = line_of(window), window.state.playhead.duration_us
    middle = box["y"] + box["height"] / 2
    window.page.mouse.click(box["x"] + box["width"] / 4, middle)
    eventually(lambda: abs(window.state.playhead.anchor_us - duration_us / 4) < duration_us / 100, "a quarter")
    window.page.mouse.move(box["x"] + box["width"] / 4, middle)
    window.page.mouse.down()
    window.page.mouse.move(box["x"] + box["width"] / 2, middle, steps=6)
    window.page.mouse.move(box["x"] + 0.75 * box["width"], middle, steps=6)
    window.page.mouse.up()
    eventually(lambda: abs(window.state.playhead.anchor_us - 0.75 * duration_us) < duration_us / 100, "three quarters")
    window.screenshot("time-bar")


def a_section_is_repeated_until_it_is_released(window) -> None:
    box = line_of(window)
    window.page.keyboard.down("Shift")
    window.page.mouse.move(box["x"] + 100, box["y"] + 20)
    window.page.mouse.down()
    window.page.mouse.move(box["x"] + 200, box["y"] + 20, steps=5)
    window.page.mouse.up()
    window.page.keyboard.up("Shift")
    eventually(lambda: window.state.playhead.loop_us is not None, "the section")
    start_us, end_us = window.state.playhead.loop_us
    scale = window.state.playhead.duration_us / box["width"]
    assert abs(start_us - 100 * scale) < 3 * scale and abs(end_us - 200 * scale) < 3 * scale
    window.page.get_by_role("button", name="Stop repeating").click()
    eventually(lambda: window.state.playhead.loop_us is None, "its end")


def the_keys_of_editing_tables_and_the_arrows_work(window) -> None:
    window.seek(100_000)
    press = window.page.keyboard.press
    press("ArrowRight")
    eventually(lambda: window.state.playhead.anchor_us == 101_000, "a step on")
    press("Shift+ArrowLeft")
    eventually(lambda: window.state.playhead.anchor_us == 91_000, "ten steps back")
    window.session.send(SetPlaybackSpeed(0.01))  # so that it does not come to the end meanwhile
    eventually(lambda: window.state.playhead.speed == 0.01, "the speed")
    speed = window.state.playhead.speed
    press("l")
    eventually(lambda: window.state.playhead.playing, "L to play")
    press("l")
    eventually(lambda: window.state.playhead.speed > speed, "L to go faster")
    press("j")
    eventually(lambda: window.state.playhead.speed == speed, "J to go slower")
    press("k")
    eventually(lambda: not window.state.playhead.playing, "K to pause")
    press("Home")
    eventually(lambda: window.state.playhead.anchor_us == 0, "the start")


def stands_at(window) -> int | None:
    """Where the cursor stands, µs; None until the page knows it, too."""
    told = window.page.evaluate("document.getElementById('rallyscope-line').getAttribute('aria-valuenow')")
    return int(told) if int(told) == window.state.playhead.anchor_us else None


def marks_and_bounces_are_gone_to(window) -> None:
    window.seek(123_000)
    window.page.keyboard.press("'")
    eventually(lambda: window.state.marks_us == (123_000,), "the mark")
    window.page.keyboard.press("End")
    eventually(lambda: stands_at(window) == window.state.playhead.duration_us, "the end")
    for _ in range(30):
        before_us = window.state.playhead.anchor_us
        window.page.keyboard.press("[")
        eventually(lambda before_us=before_us: stands_at(window) not in (None, before_us), "the one before")
        if window.state.playhead.anchor_us == 123_000:
            break
    assert window.state.playhead.anchor_us == 123_000


def modes_are_chosen_by_key_wherever_the_focus_is_but_in_a_field(window) -> None:
    window.page.get_by_role("button", name="Play", exact=True).focus()
    window.page.keyboard.press("Shift+Digit2")
    eventually(lambda: window.state.mode == "Tune", "Tune")
    field = window.page.get_by_label("Time", exact=True)
    field.focus()
    window.page.keyboard.press("Shift+Digit1")
    field.blur()
    before_us = window.state.playhead.anchor_us
    window.page.keyboard.press("ArrowLeft")
    eventually(lambda: window.state.playhead.anchor_us == before_us - 1_000, "the key that came after it")
    assert window.state.mode == "Tune"
    window.page.keyboard.press("Shift+Digit4")
    eventually(lambda: window.state.mode == "Train", "Train")
    window.page.locator("#rallyscope-bar").wait_for(state="hidden")


def a_bar_button_is_pressed_by_enter(window) -> None:
    window.seek(50_000)
    window.page.get_by_role("button", name="+1", exact=True).focus()
    window.page.keyboard.press("Enter")
    eventually(lambda: window.state.playhead.anchor_us == 51_000, "Enter on a button")


LEGEND = """() => {
    const legend = document.getElementById("rallyscope-legend"), end = legend.getBoundingClientRect().bottom;
    const seen = [...legend.children].filter(one => !one.hidden && one.getBoundingClientRect().bottom <= end + 1);
    return [seen.map(one => one.textContent), legend.dataset.more || "", legend.title]; }"""
"""What the legend has in sight, how many it has left out, and its tooltip."""


MORE = """rallyscope.handlers.tracks({ duration: 600000, rates: { left: [], right: [] }, contacts: [], top_hz: 0,
    moments: { bounce: [1], hit: [2] }, runs: { detector: [[0, 1, "found"], [1, 2, "missed"], [2, 3, "false"]] } })"""
"""Tracks of a recording in which more has happened."""


def the_legend_names_all_that_happened_at_1280_px(window) -> None:
    names, legend = ["left", "right", "bounce"], lambda: window.page.evaluate(LEGEND)
    eventually(lambda: legend() == [names, "", ", ".join(names)], "all names in sight", legend)


def a_legend_without_room_for_all_says_how_many_it_leaves_out(window) -> None:
    window.page.evaluate(MORE)
    seen, more, title = window.page.evaluate(LEGEND)
    names = ["left", "right", "bounce", "hit", "found", "missed", "false"]
    assert title == ", ".join(names) and 3 < len(seen) < len(names)
    assert (seen, more) == (names[: len(seen)], f"+{len(names) - len(seen)}")
    window.screenshot("time-bar-legend")


def test_the_bar_is_used_by_mouse_and_by_key(window) -> None:
    the_legend_names_all_that_happened_at_1280_px(window)
    a_click_on_the_line_goes_there_and_a_drag_scrubs(window)
    a_section_is_repeated_until_it_is_released(window)
    the_keys_of_editing_tables_and_the_arrows_work(window)
    marks_and_bounces_are_gone_to(window)
    a_bar_button_is_pressed_by_enter(window)
    a_legend_without_room_for_all_says_how_many_it_leaves_out(window)
    modes_are_chosen_by_key_wherever_the_focus_is_but_in_a_field(window)
