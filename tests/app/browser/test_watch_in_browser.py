"""Watch, in a real browser. The screenshots are kept under test-artifacts/."""

import pytest

from app.state.client_state import ClientState
from app.state.commands import SetPlaybackSpeed
from tests.app.browser.window import choose_in, count_like
from tests.waiting import eventually

YELLOW, ORANGE, BLUE = (255, 225, 60), (255, 150, 50), (80, 150, 255)
BALL_US = 340_000
"""A moment at which both cameras see the ball."""


def it_opens_on_both_cameras_and_finds_the_ball_in_them(window) -> None:
    window.seek(BALL_US)
    window.wait_for_pixels(  # the picture of the moment before may still be there, with a ball too
        "watch",
        lambda canvas: (
            min(count_like(half, YELLOW) for half in (canvas[:, :435], canvas[:, 435:])) > 15
            and min(count_like(canvas, ORANGE), count_like(canvas, BLUE)) > 50
        ),
    )


def the_space_bar_plays_and_pauses(window) -> None:
    window.session.send(SetPlaybackSpeed(0.001))  # so that it does not come to the end meanwhile
    eventually(lambda: window.state.playhead.speed == 0.001, "the speed")
    window.key(" ")
    eventually(lambda: window.state.playhead.playing, "play")
    first = window.session.sheet
    eventually(lambda: window.session.sheet is not first, "the picture to move")
    window.key(" ")
    eventually(lambda: not window.state.playhead.playing, "pause")
    assert window.state.playhead.anchor_us > 0


def steps_go_forth_and_back_by_button_and_key(window) -> None:
    window.seek(BALL_US)
    window.press("+10")
    eventually(lambda: window.state.playhead.anchor_us == BALL_US + 10_000, "ten steps on")
    window.key("p")
    eventually(lambda: window.state.playhead.anchor_us == BALL_US + 9_000, "one step back")


def the_event_rate_and_the_health_are_shown(window) -> None:
    window.page.get_by_role("tab", name="Health").click()
    window.page.get_by_text("busiest (").first.wait_for()  # the simulated sensor has some
    eventually(lambda: window.page.get_by_text("Mev/s").count() >= 2, "the rates of both cameras")
    window.screenshot("health")


def buttons_can_be_pressed_without_a_mouse(window) -> None:
    page = window.page
    play = page.get_by_role("button", name="Play", exact=True)
    page.get_by_role("button", name="Tune", exact=True).focus()
    page.keyboard.press("Enter")
    eventually(lambda: window.state.mode == "Tune", "Enter on Tune")
    page.get_by_role("button", name="Label", exact=True).focus()
    page.keyboard.press("Enter")
    eventually(lambda: window.state.mode == "Label", "Enter on Label")
    page.get_by_role("button", name="Watch", exact=True).click()
    eventually(lambda: window.state.mode == "Watch", "Watch")
    play.focus()
    page.keyboard.press("Enter")
    eventually(lambda: window.state.playhead.playing, "Enter on Play")


def an_event_file_in_the_folder_is_offered_and_imported_when_it_is_opened(window, workspace) -> None:
    rows = "\n".join(f"{10 * k},{k % 300},{k % 200},{k % 2}" for k in range(5000))
    (workspace.recordings / "clip.csv").write_text(f"t,x,y,p\n{rows}\n")
    offered = window.session._interface._recording._dropdown
    eventually(lambda: any(name.startswith("clip.csv") for name in offered.options), "the folder to be looked at")
    window.choose("Recording", "clip.csv (CSV, imported when opened)")
    window.page.get_by_role("button", name="Import", exact=True).click()
    eventually(lambda: window.state.recording == "clip", "the imported recording")
    assert workspace.recording_path("clip").is_file()
    window.page.get_by_text("Pictures only: 3D needs two cameras").wait_for()
    eventually(lambda: window.page.get_by_label("Recording").first.input_value() == "clip", "its name in the list")
    window.screenshot("imported")


def a_file_that_is_no_recording_is_reported_and_nothing_is_lost(window) -> None:
    before: ClientState = window.state
    choose_in(window.page.get_by_label("Recording").first, "broken")
    window.page.get_by_text("The text is not events").first.wait_for()
    chosen = window.page.get_by_label("Recording").first
    eventually(lambda: chosen.input_value() == "serve", "the choice to be the open recording again, after the message")
    window.session.open_recording("../../../etc/passwd")
    window.page.get_by_text("no such recording").first.wait_for()
    assert window.state.recording == before.recording and window.session.sheet.pictures


def the_look_of_the_pictures_can_be_changed(window) -> None:
    window.seek(BALL_US)
    choose_in(window.page.get_by_label("ON / OFF").first, "red / green")
    eventually(lambda: window.state.look.colours == "red / green", "other colours")
    window.wait_for_pixels(
        "red-green", lambda canvas: count_like(canvas, BLUE) < 20 < count_like(canvas, (255, 80, 80))
    )


def a_second_browser_has_its_own_time_and_mode(window, open_window, lab) -> None:
    with open_window(lab) as other:
        opened_us = other.state.playhead.anchor_us
        assert 0 < opened_us < BALL_US, "at the first ball"
        window.seek(BALL_US)
        other.press("Tune")
        eventually(lambda: other.state.mode == "Tune", "the other browser's mode")
        assert window.state.mode == "Watch"
        assert other.state.playhead.anchor_us == opened_us


@pytest.mark.gate
def test_a_recording_is_watched_by_mouse_and_by_key(window, lab, open_window) -> None:
    it_opens_on_both_cameras_and_finds_the_ball_in_them(window)
    a_second_browser_has_its_own_time_and_mode(window, open_window, lab)
    steps_go_forth_and_back_by_button_and_key(window)
    the_space_bar_plays_and_pauses(window)
    the_look_of_the_pictures_can_be_changed(window)
    the_event_rate_and_the_health_are_shown(window)
    buttons_can_be_pressed_without_a_mouse(window)


@pytest.mark.gate
def test_files_of_the_folder_are_opened_imported_or_refused(window, workspace) -> None:
    a_file_that_is_no_recording_is_reported_and_nothing_is_lost(window)
    an_event_file_in_the_folder_is_offered_and_imported_when_it_is_opened(window, workspace)
