"""What the figures say of the live rally's health."""

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from app import theme
from app.formatting import html_text
from app.modes.watch.figures import STAGE_WORDS, learned_words
from app.modes.watch.missed_ball import missed_html
from app.modes.watch.status import drift_row, live_html, moment_html
from app.shared.rallies import WatchedRally
from core.cameras.stereo import EpipolarDrift
from core.chain.calibration_drift import DriftReport
from core.history.missed_balls import MissedBall
from core.history.rally_history import Outcome, RallyHistory, RallyMoment, RallyStep
from core.history.rally_picture import LandingSpot
from core.history.shown_prediction import ShownPrediction
from core.live.link.messages import WorldState
from core.live.live_player import NOBODY
from core.live.live_snapshot import STAGES, stage_latencies
from core.physics.episode import Case
from core.trajectory.filter_config import FilterConfig
from core.trajectory.learned_constants import nothing_learned

if TYPE_CHECKING:
    from app.shared.live_rally import LiveRally
    from core.chain.chain import BallPoint
    from core.history.following import Following


def state(**more) -> WorldState:
    times = np.empty(0, np.int64)
    return WorldState(
        session="s", seq=1, wall_ns=1, start_us=0, t_us=10_000, phase="idle", paused=False, speed_factor=1.0,
        noise_hz=0.1, auto_serve_mps=0.0, real_time_factor=1.2, served=0, returned=0, ball_t_us=times,
        ball=np.empty((0, 9)), ball_visible=np.empty(0, np.uint8), racket_t_us=times, racket=np.empty((0, 10)), **more,
    )  # fmt: skip


@pytest.fixture
def snapshot() -> SimpleNamespace:
    span = SimpleNamespace(p50_ms=0.2, p99_ms=1.0)
    health = SimpleNamespace(state_hz=400.0, step=span, window_to_sent=span, blocks_dropped=0, stages=())
    return SimpleNamespace(health=health, controller="built-in", problem="", learned=None)


def test_what_was_learned_of_air_and_table_is_said_once_there_was_a_ball(snapshot) -> None:
    assert "Air and table" not in live_html(snapshot, state(), "connected")
    nothing = nothing_learned(FilterConfig(perhaps_real=True))
    snapshot.learned = nothing
    said = live_html(snapshot, state(), "connected")
    assert "Air and table" in said and "published values" in said
    means, sigmas = np.array([0.451, 0.912, 0.233]), np.array([0.04, 0.01, 0.03])
    one = replace(nothing, means=means, variances=sigmas**2, air=0.98, balls=1)
    assert learned_words(one) == "drag 0.45 ± 0.04, restitution 0.91 ± 0.01, friction 0.23 ± 0.03 (learned from 1 ball)"
    assert learned_words(replace(one, air=0.03, balls=7)).startswith("no air, restitution 0.91 ± 0.01")
    assert "learned from 7 balls" in learned_words(replace(one, air=0.4, balls=7))
    assert learned_words(replace(one, air=0.4)).startswith("air or none (40 %), restitution")


def test_where_the_time_of_commands_goes_is_a_line_a_stage_once_one_was_sent(snapshot) -> None:
    assert "Where it goes" not in live_html(snapshot, state(), "connected")
    snapshot.health.stages = stage_latencies([tuple(float(number) for number in range(len(STAGES)))])
    said = live_html(snapshot, state(), "connected")
    assert "Where it goes" in said and said.count("<tr><td style=") >= len(STAGES)
    assert all(name in said and html_text(STAGE_WORDS[name]) in said for name in STAGES)


def test_a_player_that_loads_is_no_problem_and_has_no_figures_yet(snapshot) -> None:
    snapshot.problem = NOBODY
    said = live_html(snapshot, state(), "connected")
    assert "the player is loading" in said and theme.BAD not in said and "times a second" not in said
    snapshot.problem = "no calibration"
    assert theme.BAD in live_html(snapshot, state(), "connected")


def test_a_readout_in_time_is_not_spoken_of(snapshot) -> None:
    assert "Readout" not in live_html(snapshot, state(), "connected")


def test_late_and_lost_events_are_said(snapshot) -> None:
    late = live_html(snapshot, state(readout_delayed=1200, readout_longest_us=70), "connected")
    assert "1,200 late, up to 70 us" in late and "lost" not in late
    lost = live_html(snapshot, state(readout_delayed=5, readout_dropped=34_000), "connected")
    assert "34,000 events lost" in lost


def test_skipped_blocks_are_explained_and_not_red(snapshot) -> None:
    snapshot.health.blocks_dropped = 3
    said = live_html(snapshot, state(), "connected")
    assert "Skipped blocks" in said and "3 blocks of 10 ms since the session began" in said and theme.BAD not in said


def test_a_latency_of_a_slow_simulation_says_that_it_is_one_on_the_clock(snapshot) -> None:
    assert "on the clock" not in live_html(snapshot, state(), "connected")
    slow = live_html(snapshot, replace(state(), speed_factor=0.04), "connected")
    assert "1.0 ms (p99)" in slow and "on the clock, with 0.04 s simulated a second" in slow


def test_what_is_wrong_is_red_and_says_what_to_do(snapshot) -> None:
    assert theme.BAD not in live_html(snapshot, state(), "connected")
    slow = live_html(snapshot, replace(state(), real_time_factor=0.5), "connected")
    assert theme.BAD in slow and "only 0.50 x real time: choose a slower Pace" in slow
    paused = live_html(snapshot, replace(state(), real_time_factor=0.5, paused=True), "connected")
    assert theme.BAD not in paused and "press Run" in paused


def test_a_pace_that_was_settled_on_is_said_in_words_and_is_not_red(snapshot) -> None:
    said = live_html(snapshot, state(kept_share=0.5), "connected")
    assert "connected, 1/2 speed: this machine is busy" in said and "dropped" not in said
    assert theme.BAD not in said and "x real time" not in said
    slower = live_html(snapshot, replace(state(kept_share=0.25), speed_factor=0.5, real_time_factor=0.05), "connected")
    assert "1/8 speed instead of 1/2 speed: this machine is busy" in slower


def test_what_is_not_known_now_says_why_in_place_of_a_dash(snapshot) -> None:
    nothing = RallyMoment(0, RallyHistory().at(0, {}).picture, None, None, None, ())
    said = moment_html(nothing, 15.0, 1.0, cameras=("left", "right", "top"))
    assert ">-<" not in said and all(why in said for why in ("no ball followed", "no hit expected", "no ball in 3D"))
    nan = SimpleNamespace(p50_ms=float("nan"), p99_ms=float("nan"))
    snapshot.health.step = snapshot.health.window_to_sent = nan
    early = live_html(snapshot, state(), "connected")
    assert "no window yet" in early and "no command yet" in early and "- ms" not in early


def test_where_the_chain_has_not_been_no_earlier_place_of_the_ball_is_shown() -> None:
    point = SimpleNamespace(residual_px=0.04, covariance_m2=1e-6 * np.eye(3))
    step = RallyStep(300_000, cast("BallPoint", point), {}, None, None, None, 0.0, frozenset(("left", "right")))
    later = RallyMoment(900_000, RallyHistory().at(0, {}).picture, step, None, None, ())
    for reached in (True, False):
        said = moment_html(later, 15.0, 0.4, cameras=("left", "right", "top"), reached=reached)
        assert ("0.04 px" in said, "2 of 3 cameras" in said) == (reached, reached)
        assert ("not followed up to here yet" in said, "no hit expected" in said) == (not reached, reached)


def test_a_time_is_reached_once_the_chain_has_been_there_or_has_seen_all() -> None:
    history = cast("RallyHistory", SimpleNamespace(followed_us=300_000))
    for share, reached in ((0.4, False), (1.0, True)):
        rally = WatchedRally(history, {}, None, cast("Following", SimpleNamespace(share=share)))
        assert rally.has_reached(310_000) and rally.has_reached(900_000) == reached
    live = WatchedRally(history, {}, cast("LiveRally", SimpleNamespace()), None)
    assert live.has_reached(310_000) and not live.has_reached(900_000), "a live rally is never complete"


def test_figures_have_plain_names_with_their_meaning_as_a_tooltip() -> None:
    nothing = RallyMoment(0, RallyHistory().at(0, {}).picture, None, None, None, ())
    said = moment_html(nothing, 15.0, 1.0)
    for name in ("Stereo mismatch", "Hit predicted before the bounce", "Hit predicted after the bounce"):
        assert f"title='{name}: " in said


def test_an_expected_hit_goes_with_its_flight_as_in_the_3d_view() -> None:
    hit = SimpleNamespace(p_world_m=np.array([0.0, 0.125, 0.25]), v_world_mps=np.array([-5.0, 0, 0]), t_s=0.4)
    expected = ShownPrediction(300_000, np.empty((0, 3)), None, hit, SimpleNamespace(stage="pre"))
    step = RallyStep(300_000, None, {}, expected, None, None, 0.0)
    picture = RallyHistory().at(0, {}).picture
    for t_us, shown in ((300_000, True), (460_000, True), (461_000, False)):
        said = moment_html(RallyMoment(t_us, picture, step, None, None, ()), 15.0, 1.0)
        assert ("y +0.125, z +0.250 m, 5.00 m/s" in said) == shown


def test_the_time_of_the_hit_is_the_one_that_the_3d_view_counts_down_to() -> None:
    """The step may have an older prediction than the picture, and a countdown would be behind when it is read."""
    hit = SimpleNamespace(p_world_m=np.zeros(3), v_world_mps=np.array([-5.0, 0, 0]), t_s=0.789)
    expected = ShownPrediction(300_000, np.empty((0, 3)), None, hit, SimpleNamespace(stage="pre"))
    step = RallyStep(300_000, None, {}, expected, None, None, 0.0)
    picture = replace(RallyHistory().at(0, {}).picture, hit_in_s=0.16)
    said = moment_html(RallyMoment(300_000, picture, step, None, None, ()), 15.0, 1.0)
    assert "0.460 s" in said and "489" not in said


def test_how_many_came_back_is_said_once() -> None:
    nothing = RallyMoment(0, RallyHistory().at(0, {}).picture, None, None, None, ())
    one = replace(nothing, outcomes=(Outcome(590_000, 10_000, 5.0, LandingSpot(0.6, 0.1, Case.RETURNED)),))
    counted = moment_html(one, 15.0, 1.0, returned=False)
    assert "Last ball" in counted and "Returned" not in counted and "Returned" in moment_html(one, 15.0, 1.0)
    assert "Last ball" not in moment_html(nothing, 15.0, 1.0)  # a row comes with its value


def test_a_ball_that_one_camera_did_not_see_is_not_said_to_be_lost() -> None:
    unseen = MissedBall(3_120_000, "left", "not seen", 24_000)
    said = missed_html(unseen, copies=False)
    assert "3.120 s" in said and "in left for 24 ms. The track was not lost." in said and "returned" not in said
    assert "was not returned; the detector" in missed_html(replace(unseen, kind="not returned"), copies=False)
    seen = replace(unseen, kind="not returned", unseen_us=0)
    assert "was not returned; it was seen" in missed_html(seen, copies=False)


def test_a_landing_place_has_no_minus_zero() -> None:
    nothing = RallyMoment(0, RallyHistory().at(0, {}).picture, None, None, None, ())
    there = Outcome(590_000, 10_000, 5.0, LandingSpot(0.8, -0.001, Case.RETURNED))
    assert "0.80 / +0.00 m" in moment_html(replace(nothing, outcomes=(there,)), 10.0, 1.0)


def test_a_ball_of_which_blocks_were_skipped_is_no_fault_of_the_detector() -> None:
    late = missed_html(MissedBall(3_120_000, "left", "not returned", 14_000, 30_000), copies=False)
    assert "30 ms of its flight were skipped: this machine was busy" in late and "detector" not in late
    away = missed_html(MissedBall(3_120_000, "left", "not returned", 14_000, 0, 0.12), copies=False)
    assert "the racket was still 120 mm from where it was sent: the command came late" in away
    assert "detector" not in away


def test_a_lost_simulation_and_a_slow_one_are_bad(snapshot) -> None:
    good = live_html(snapshot, state(), "connected")
    assert live_html(snapshot, state(), "lost") != good and "lost, " in live_html(snapshot, state(), "lost")


PAIR = ("left", "<b>right")


def report(drift_px: float, *, alarm: bool) -> DriftReport:
    return DriftReport(400, 200, PAIR, EpipolarDrift(drift_px, 0.1, 0.02), alarm)


def test_it_says_how_many_points_are_missing() -> None:
    assert "Not yet known<" in drift_row(DriftReport())[1], "no chain yet: no verdict"
    name, said = drift_row(DriftReport(60, 200))
    assert name == "Calibration" and "Not yet known (60 of 200 points)" in said


def test_a_fit_is_green_with_its_figure() -> None:
    said = drift_row(report(0.21, alarm=False))[1]
    assert "fits to 0.21 px (400 points" in said and theme.GOOD in said


def test_an_alarm_is_red_and_says_who_how_far_and_what_to_do() -> None:
    said = drift_row(report(1.23, alarm=True))[1]
    assert "The calibration of left and &lt;b&gt;right has drifted: 1.2 px off. A camera or lens was moved" in said
    assert "calibrate again" in said and theme.BAD in said


def test_sightings_of_different_things_are_not_judged() -> None:
    said = drift_row(DriftReport(400, 200))[1]
    assert "unknown: the cameras" in said and "calibrate again" not in said
    assert "calibrate again" in drift_row(DriftReport(400, 200, alarm=True))[1]


def test_the_chosen_hit_has_its_chance_and_an_impossible_one_its_reason() -> None:
    hit = SimpleNamespace(p_world_m=np.array([-1.24, 0.0, 0.25]), v_world_mps=np.array([-5.0, 0, 0]), t_s=0.4)
    chosen, low = SimpleNamespace(chance=0.98, why_not=""), SimpleNamespace(chance=0.0, why_not="too low")
    choice = SimpleNamespace(chosen=chosen, candidates=(chosen, low, low))
    expected = ShownPrediction(300_000, np.empty((0, 3)), None, hit, SimpleNamespace(stage="post"), choice)
    picture = RallyHistory().at(0, {}).picture

    def said(shown: ShownPrediction, *, robot: bool = True) -> str:
        step = RallyStep(300_000, None, {}, None, shown, None, 0.0)
        return moment_html(RallyMoment(300_000, picture, step, None, None, ()), 15.0, 1.0, robot=robot)

    assert "x -1.24, z +0.25 m" in said(expected) and "98 %" in said(expected) and "1 of 3 places" in said(expected)
    refused = said(replace(expected, no_stroke="Ball cannot be returned: below the table's top"))
    assert theme.WARN in refused and "below the table" in refused and "places possible" not in refused
    assert "Hit chosen" not in said(expected, robot=False)
