"""The live rally in 3D, in headless Chromium: the whole chain runs on simulated events."""

import itertools
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.client_session.opening_moment import SLOW, SLOWEST, OpeningMoment
from app.client_session.tour import TOUR
from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally, SimulationProcess, join_simulation
from app.shared.workspace import Workspace
from app.state.client_state import ClientState
from app.state.commands import SetMethod
from core.chain.control.controller import BuiltInController
from core.history.rally_history import Outcome, RallyHistory
from core.history.rally_picture import LandingSpot
from core.learning.runs.run_files import create_run
from core.learning.runs.running import run_training
from core.live.link import messages as m
from core.physics.episode import Case
from core.recordings import open_recording
from labels.model import LabelState
from labels.store import find_layers
from tests.app.browser.window import choose_in, count_like
from tests.app.modes.train.small_runs import small_run
from tests.waiting import eventually

SPACE = (slice(0, 720), slice(320, 870))
TABLE_RGB = (48, 122, 202)
TIME_JS = "document.getElementById('rallyscope-us').textContent"


@pytest.fixture(scope="module")
def live_lab(tmp_path_factory: pytest.TempPathFactory, serve_recording: Path) -> Iterator[App]:
    workspace = Workspace(tmp_path_factory.mktemp("live"))
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    process = SimulationProcess("--auto-serve", "5", "--seed", "3")
    live = join_simulation(process.wait(), process=process)
    live.simulation.set_speed(0.5)  # so that a busy machine is no part of the test
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    yield lab
    lab.stop()


@pytest.fixture
def live_window(chromium, live_lab, open_window):
    with open_window(live_lab, in_space=True) as window:
        eventually(lambda: window.session.world.visible, "the 3D scene")
        yield window


def rally_of(lab: App) -> LiveRally:
    return lab.services.rallies.live


def is_above(position: np.ndarray) -> bool:
    """Over the table, and not beside it."""
    return bool(np.abs(position[:2]).max() < 0.5 and position[2] > 2.0)


def the_table_is_there_and_balls_come_back(live_window, live_lab) -> None:
    rally = rally_of(live_lab)
    eventually(lambda: rally.player.snapshot.returned >= 2, "two balls to be returned through perception")
    assert live_window.state.playhead.following
    live_window.wait_for_pixels("live", lambda image: count_like(image, TABLE_RGB, 45) > 20_000, SPACE)
    spots = lambda: rally.history.at(rally.history.followed_us, {}).picture.spots  # noqa: E731
    eventually(lambda: len(spots()) >= 2, "where they came down")  # the chain may be a little behind the outcomes


def a_page_that_the_processor_draws_is_spared_while_the_rally_runs(live_window) -> None:
    live_window.page.wait_for_function("rallyscope.rallyRuns")
    eventually(lambda: live_window.session.is_throttled, "the page to have told who draws it")
    live_window.press_play()
    live_window.page.wait_for_function("!rallyscope.rallyRuns")
    assert not live_window.session.is_throttled
    live_window.press_play()
    live_window.page.wait_for_function("rallyscope.rallyRuns")


def the_time_line_goes_on_with_the_bounces_and_hits_of_the_live_rally(live_window) -> None:
    opened_us = live_window.state.playhead.duration_us
    for kind in ("bounce", "hit"):
        eventually(
            lambda kind=kind: (live_window.session._bar.tracks.moments[kind] > opened_us).any(), f"a later {kind}"
        )


def a_page_that_the_processor_draws_is_told_how_the_rally_goes_on_when_a_frame_is_due(live_window, monkeypatch) -> None:
    page, pace = live_window.session.page, live_window.session._pace
    shown, send, is_due, turns = live_window.page.evaluate(TIME_JS), page.send, pace.is_due, []

    def send_and_note(kind: str, values: dict[str, object]) -> None:
        if kind == "bar":
            turns.append("told")
        send(kind, values)

    def ask_and_note(state: ClientState | None, wall_s: float) -> bool:
        answer = is_due(state, wall_s)
        turns.append("due" if answer else "spared")
        return answer

    monkeypatch.setattr(pace, "is_due", ask_and_note)  # how often that is: the tests of FrameThrottle, by their clock
    monkeypatch.setattr(page, "send", send_and_note)
    eventually(lambda: turns.count("told") > 5, "it to be told some times")
    monkeypatch.undo()
    assert all(before == "due" for before, what in itertools.pairwise(turns) if what == "told")
    eventually(lambda: live_window.page.evaluate(TIME_JS) != shown, "the page to show it")


@pytest.mark.gate
def test_a_rally_is_watched_and_its_clock_and_scene_are_changed(
    live_window, live_lab, open_window, monkeypatch
) -> None:
    the_table_is_there_and_balls_come_back(live_window, live_lab)
    a_page_that_the_processor_draws_is_spared_while_the_rally_runs(live_window)
    the_time_line_goes_on_with_the_bounces_and_hits_of_the_live_rally(live_window)
    a_page_that_the_processor_draws_is_told_how_the_rally_goes_on_when_a_frame_is_due(live_window, monkeypatch)
    the_clock_stops_for_everybody_and_the_picture_with_it(live_window, live_lab)
    a_person_may_look_back_while_the_rally_goes_on(live_window, live_lab)
    two_browsers_look_from_where_each_likes(live_window, live_lab, open_window)
    the_scene_is_chosen_in_the_browser_and_its_people_are_in_the_pictures(live_window, live_lab)


def test_a_browser_that_was_never_here_sees_a_bounce_in_slow_motion_and_then_the_rally(
    live_lab, open_window, monkeypatch
) -> None:
    follow, speeds, pictures = OpeningMoment.follow, [], []

    def follow_and_note(
        opening: OpeningMoment, state: ClientState, history: RallyHistory, wall_s: float
    ) -> ClientState:
        state = follow(opening, state, history, wall_s)
        if opening._bounce is not None and not pictures:
            pictures.append(history.at(opening._bounce.begin_us, {}).picture)
        if not speeds or speeds[-1] != state.playhead.speed:
            speeds.append(state.playhead.speed)
        return state

    monkeypatch.setattr(OpeningMoment, "follow", follow_and_note)  # it may be over before the window has come to rest
    with open_window(live_lab, in_space=True, first_time=True) as window:
        eventually(lambda: pictures, "the first bounce")
        window.screenshot("opening")  # to look at: how far it is by then is up to the machine
        (picture,) = pictures
        assert picture.ball is not None and len(picture.tube) and picture.racket is not None
        eventually(lambda: window.session._opening is None, "the return to be over")
        eventually(lambda: window.state.playhead.following and window.state.playhead.speed == 1.0, "it to go on live")
        assert speeds in ([1.0, SLOWEST, SLOW, 1.0], [SLOWEST, SLOW, 1.0])  # a bounce may be near at once
        card = window.page.get_by_role("dialog", name="A rally, seen by two event cameras")
        card.wait_for()
        window.page.keyboard.press("Escape")
        card.wait_for(state="hidden")
        eventually(lambda: TOUR in window.session.page.seen, "the skipped tour to be kept")


def test_the_rally_rests_without_a_browser_and_goes_on_with_one(chromium, live_lab, open_window) -> None:
    rally = rally_of(live_lab)
    eventually(lambda: not live_lab.sessions, "no browser to be left")
    eventually(lambda: rests(rally), "the simulation to rest")
    stood_us = rally.state.t_us
    with open_window(live_lab, in_space=True):  # it returns when the recording is open
        eventually(lambda: rally.state.t_us > stood_us, "the rally to go on")
    eventually(lambda: not live_lab.sessions and rests(rally), "it to rest again")
    eventually(lambda: rally.source.status == "connected", "the link to be known as alive")


SIGNS_OF_LIFE = 3
"""A simulation that runs says the same time twice at most: with a block, and that it lives."""


def rests(rally: LiveRally) -> bool:
    """Whether simulated time stands still while the simulation goes on to say that it lives."""
    times_us = set()
    for _ in range(SIGNS_OF_LIFE):
        before = rally.state
        eventually(lambda before=before: rally.state is not before, "a sign of life")
        times_us.add(rally.state.t_us)
    return len(times_us) == 1


def the_clock_stops_for_everybody_and_the_picture_with_it(live_window, live_lab) -> None:
    rally = rally_of(live_lab)
    live_window.press("Pause")
    eventually(lambda: rally.state.paused, "the simulation to pause")
    stood_us = rally.state.t_us
    live_window.press("+10 ms")
    eventually(lambda: rally.state.t_us == stood_us + 10_000, "one block of 10 ms")
    live_window.press("Run")
    eventually(lambda: not rally.state.paused, "the simulation to run")


def a_person_may_look_back_while_the_rally_goes_on(live_window, live_lab) -> None:
    rally = rally_of(live_lab)
    live_window.press_play()
    eventually(lambda: not live_window.state.playhead.playing, "the cursor to stand")
    here_us = live_window.state.playhead.anchor_us
    eventually(lambda: rally.recording.duration_us > here_us + 300_000, "the rally to go on")
    assert live_window.state.playhead.position_us(0.0) == here_us
    live_window.press_play()
    eventually(lambda: live_window.state.playhead.following, "the cursor to be live again")


def what_is_recorded_opens_again_and_shows_the_same(live_window, live_lab) -> None:
    rally = rally_of(live_lab)
    live_window.press("Record")
    eventually(lambda: rally.recorded is not None, "the recording to begin")
    path = rally.recorded
    played = rally.player.snapshot.played
    eventually(lambda: rally.player.snapshot.played >= played + 2, "two more balls")
    live_window.page.get_by_role("button", name="Stop recording").click()
    eventually(lambda: rally.recorded is None, "the recording to end")
    recording = open_recording(path)
    assert recording.duration_us > 500_000 and recording.ball is not None
    recording.close()
    eventually(lambda: path.stem in live_window.session.services.library.names(), "it to be listed")
    live_window.session.open_recording(path.stem)
    eventually(lambda: live_window.state.recording == path.stem, "it to open")
    following = live_lab.services.rallies.of(live_window.session.recording)
    eventually(lambda: following.followed == 1.0, "the chain to follow it")
    seen = [following.history.at(t, {}).picture for t in range(0, following.history.followed_us, 20_000)]
    assert any(picture.ball is not None for picture in seen)
    errors = [np.linalg.norm(p.ball - p.truth) for p in seen if p.ball is not None and p.truth is not None]
    assert np.median(errors) < 0.03, "the ball moves on by up to a window between the two"
    assert all(picture.racket is not None for picture in seen[1:])


def two_browsers_look_from_where_each_likes(live_window, live_lab, open_window) -> None:
    with open_window(live_lab, in_space=True) as other:
        eventually(lambda: other.session.world.visible, "the other 3D scene")
        other.session.later(lambda: other.session.world.look_from("Top"))
        eventually(lambda: other.session.world.view == "Top", "the other view")
        eventually(lambda: is_above(other.session.client.camera.position), "the camera to be up there")
        assert not is_above(live_window.session.client.camera.position)
        assert live_window.session.world.view == "Broadcast"
        other.screenshot("live-top")


def tune_and_the_flat_pictures_work_on_the_live_rally(live_window) -> None:
    live_window.press("Tune")
    eventually(lambda: live_window.session.sheet.pictures, "the picture of Tune")
    assert live_window.state.recording == LIVE
    live_window.session.send(SetMethod("refined"))
    live_window.page.get_by_role("button", name="edge points").wait_for()
    live_window.page.get_by_text(re.compile("^(ball at|no ball)")).first.wait_for()
    live_window.page.get_by_text("Compare methods", exact=True).click()
    live_window.press("Compare over time")
    live_window.page.get_by_text("against the truth").wait_for()
    live_window.screenshot("live-compare")
    live_window.press("Watch")
    eventually(lambda: live_window.session.world.visible, "the 3D scene again")
    live_window.press("Pictures")
    eventually(lambda: not live_window.session.world.visible, "the flat pictures")
    table = live_window.session._modes["Watch"]._simulation._returned
    counted = table.content
    eventually(lambda: table.content != counted, "balls to be counted beside flat pictures too")
    live_window.press("3D")
    eventually(lambda: live_window.session.world.visible, "the 3D scene once more")


def test_the_live_rally_is_tuned_on_recorded_and_opened_again(live_window, live_lab) -> None:
    tune_and_the_flat_pictures_work_on_the_live_rally(live_window)
    what_is_recorded_opens_again_and_shows_the_same(live_window, live_lab)


def test_labels_of_the_live_rally_belong_to_a_recording_that_it_is_frozen_into(live_window, live_lab) -> None:
    live_uuid = rally_of(live_lab).recording.uuid
    live_window.press("Label")
    mode = live_window.session._modes["Label"]
    eventually(lambda: mode._editor is not None and mode._pictures.shown is not None, "Label of the live rally")
    live_window.session.later(lambda: mode._use_name("lena"))
    said = live_window.page.get_by_text("live: the first label saves it as a recording")
    eventually(lambda: said.count() == 2, "it to be said in the panel and under the picture")
    assert not live_window.page.get_by_text("times checked").count()  # there is no end of a live rally
    live_window.screenshot("live-label")
    live_window.press_play()
    eventually(live_window.stands_in_label, "the cursor to stand")
    shown = mode._pictures.shown.plan.main
    live = rally_of(live_lab).recording.cameras[mode._editor.labelling.view.camera].slice(*shown.window_us)
    live_window.page.keyboard.press("x")
    live_window.page.get_by_text("Saving the live rally", exact=True).wait_for(state="attached")
    eventually(lambda: live_window.state.recording.startswith("live-"), "the frozen recording to open")
    eventually(lambda: mode._editor is not None and len(mode._editor.labelling.here.labels) == 1, "the label in it")
    now = mode._editor.labelling
    (label,) = now.here.labels.values()
    assert label.state is LabelState.NO_BALL and now.recording.uuid != live_uuid
    start_us = shown.window_us[0]
    frozen = now.source.stream.slice(*label.provenance.window_us)
    assert label.provenance.window_us[1] - label.provenance.window_us[0] == shown.window_us[1] - start_us
    assert len(live) == len(frozen) and np.array_equal(live.x_px, frozen.x_px), "the picture that was judged"
    (layer,) = find_layers(live_lab.services.workspace.labels)
    assert (layer.recording_uuid, layer.annotator) == (now.recording.uuid, "lena")
    live_window.screenshot("live-label-frozen")


def the_scene_is_chosen_in_the_browser_and_its_people_are_in_the_pictures(live_window, live_lab) -> None:
    rally = rally_of(live_lab)

    def median_events(since_us: int) -> float:
        counts = rally.recording.cameras["right"].counts_per_ms()[since_us // 1000 :]
        return float(np.median(counts)) if len(counts) > 200 else 0.0

    choose_in(live_window.page.get_by_label("Scene").first, "two-persons", exact=False)
    eventually(lambda: rally.state.scene == "two-persons", "the simulation to change the scene")
    since_us = rally.state.t_us
    eventually(lambda: median_events(since_us) > 400, "people's events: without them it is noise most of the time")
    live_window.screenshot("live-two-persons")
    rally.simulation.set_scene("ball")
    eventually(lambda: live_window.page.get_by_label("Scene").first.input_value() == "ball", "the choice of another")


def a_missed_ball_of_the_live_rally_is_frozen_and_looked_at_in_tune(live_window, live_lab) -> None:
    rally = rally_of(live_lab)
    eventually(lambda: rally.history.predicted_hits(), "a ball on its way")
    t_us = rally.history.followed_us
    rally.history.add_outcome(Outcome(t_us, t_us - 100_000, 5.0, LandingSpot(0.0, 0.0, Case.MISSED)))
    live_window.press("Look at it in Tune")
    eventually(lambda: live_window.state.mode == "Tune", "Tune")
    assert live_window.state.recording.startswith("live-") and not live_window.state.playhead.playing
    assert live_window.session.recording.duration_us > live_window.state.playhead.position_us(0.0) > 0
    live_window.screenshot("live-missed-in-tune")


def a_trained_policy_plays_and_what_it_returns_is_counted(live_window, live_lab) -> None:
    rally, workspace = rally_of(live_lab), live_lab.services.workspace
    run = workspace.run_path("learned")
    create_run(run, small_run(episodes=(60,)))
    assert run_training(run, progress=lambda share: None, stopped=lambda: False) == "finished"
    live_window.press("Train")
    live_window.page.get_by_role("button", name="Let it play").wait_for()
    live_window.screenshot("live-let-it-play")
    live_window.press("Let it play")
    eventually(lambda: rally.player.controller.name == "learned", "the policy to play")
    eventually(lambda: live_window.state.mode == "Watch" and live_window.state.recording == LIVE, "Watch")
    assert live_window.state.playhead.following
    eventually(lambda: any(rate.conditions.controller == "learned" for rate in rally.returns.rates()), "its ball")
    live_window.page.get_by_text("learned · ball").wait_for()
    live_window.screenshot("live-returned")
    live_window.press("Pause")  # the next ball would be counted at once
    eventually(lambda: rally.state.paused, "the simulation to pause")
    live_window.press("Reset counts")
    live_window.page.get_by_text("learned · ball").wait_for(state="hidden")
    assert rally.history.at(rally.history.followed_us, {}).picture.spots == (), "the landing spots are of the old count"
    live_window.press("Run")
    rally.player.use(BuiltInController())


def a_policy_learns_while_it_plays_and_forgets_when_it_is_told_to(live_window, live_lab) -> None:
    learning, page = rally_of(live_lab).learning, live_window.page
    page.get_by_label("Learn while it plays").check()
    eventually(lambda: learning.on, "the learning policy to play")
    eventually(lambda: learning.progress.learned >= 3, "three balls")
    page.get_by_text(re.compile(r"\d balls learned from")).wait_for()
    page.get_by_text("Reset learning").scroll_into_view_if_needed()
    live_window.screenshot("live-learning")
    live_window.press("Save as run")
    eventually(lambda: "learned-live-1" in live_lab.services.workspace.run_names(), "the run")
    before = learning.progress
    live_window.press("Reset learning")
    eventually(lambda: learning.progress is not before and len(learning.progress.balls) < 3, "it to forget")
    page.get_by_label("Learn while it plays").uncheck()
    eventually(lambda: not learning.on, "the built-in controller to play again")


def test_a_missed_ball_leads_to_tune_and_policies_play_and_learn_in_the_rally(live_window, live_lab) -> None:
    a_missed_ball_of_the_live_rally_is_frozen_and_looked_at_in_tune(live_window, live_lab)
    a_trained_policy_plays_and_what_it_returns_is_counted(live_window, live_lab)  # which leads back to it
    a_policy_learns_while_it_plays_and_forgets_when_it_is_told_to(live_window, live_lab)


def test_a_simulation_that_ends_is_said_and_the_rest_goes_on(live_window, live_lab) -> None:
    rally = rally_of(live_lab)
    rally.stop_simulation()
    eventually(lambda: rally.source.status == "lost", "the link to be lost")
    live_window.page.get_by_text("lost, ").wait_for()
    live_window.session.open_recording("serve")
    eventually(lambda: live_window.state.recording == "serve", "a recording to open all the same")
    assert isinstance(rally.state, m.WorldState)
