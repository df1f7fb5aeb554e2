"""What is said of a live source that is no simulation."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app import theme
from app.modes.watch.status import moment_html
from app.modes.watch.stream_status import camera_rows, device_rows, lost_words, stream_html
from core.chain.control.controller import RacketDecision
from core.devices import ClockEstimate
from core.devices.camera_feed import FeedCounts
from core.history.rally_history import Outcome, RallyHistory, RallyMoment
from core.history.rally_picture import LandingSpot
from core.live.camera_source import CameraReport
from core.live.stream_watch import CameraHealth, StreamHealth
from core.physics.episode import Case
from core.simulation.episodes.racket import RacketTarget

WELL = StreamHealth(1.0, 0.01, False, 0, (CameraHealth("left", 0, 0, 0), CameraHealth("right", 0, 0, 0)))


@pytest.fixture
def snapshot() -> SimpleNamespace:
    span = SimpleNamespace(p50_ms=0.2, p99_ms=1.0)
    return SimpleNamespace(
        health=SimpleNamespace(state_hz=400.0, step=span, blocks_dropped=0, stages=(), pictures=0, pictures_skipped=0),
        problem="",
        learned=None,
    )


@pytest.fixture
def source() -> SimpleNamespace:
    state = SimpleNamespace(speed_factor=1.0)
    return SimpleNamespace(description="replay of <b>.h5", status="connected", state=state, behind_s=0.0, robot=None)


def test_a_source_that_is_well_says_its_pace_and_that_it_has_no_robot(source, snapshot) -> None:
    said = stream_html(source, WELL, snapshot)
    assert "replay of &lt;b&gt;.h5, 1.00 x real time" in said and "There is no robot" in said
    assert not any(colour in said for colour in (theme.BAD, theme.WARN)) and "left" not in said


def test_a_pace_that_is_not_kept_is_said_with_what_was_lost_by_it(source, snapshot) -> None:
    source.behind_s, snapshot.health.blocks_dropped = 2.34, 1200
    said = stream_html(source, replace(WELL, pace=0.62), snapshot)
    assert "only 0.62 x real time instead of 1: this machine is busy" in said
    assert "2.3 s in all" in said and "1,200 blocks of 10 ms" in said


def test_a_stream_that_stops_is_red_and_so_is_one_that_failed(source, snapshot) -> None:
    assert "no data for 4 s" in (said := stream_html(source, replace(WELL, quiet_s=4.2, stopped=True), snapshot))
    assert theme.BAD in said
    source.status = "lost"
    assert "stopped. Restart Rallyscope" in stream_html(source, WELL, snapshot)


def test_a_lost_camera_a_silent_one_and_lost_blocks_are_said(source, snapshot) -> None:
    lost, silent = CameraHealth("left", 120, 1_200_000, 1_200_000), CameraHealth("right", 0, 0, 2_500_000)
    said = stream_html(source, replace(WELL, blocks_lost=7, cameras=(lost, silent)), snapshot)
    assert "lost, no data for 1.2 s; 120 blocks of 10 ms never came. The rest continues" in said
    assert "no events for 2.5 s" in said and "7 of 10 ms never came" in said
    assert dict(camera_rows((CameraHealth("left", 3, 0, 0),)))["left"].count("3 blocks of 10 ms never came") == 1


def test_why_there_is_no_ball_in_space_is_said_in_place_of_how_it_is_followed(source, snapshot) -> None:
    snapshot.problem = "two cameras are needed"
    said = stream_html(source, WELL, snapshot)
    assert "two cameras are needed" in said and "Followed" not in said


def test_without_a_robot_and_outcomes_no_figure_speaks_of_them() -> None:
    pose = RacketTarget(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0.3)
    sent = RacketDecision(
        stage="post", state=np.zeros(6), goal_m=np.zeros(2), target=pose, action=np.zeros(3), landing_m=np.ones(2)
    )
    returned = Outcome(0, 0, 5.0, LandingSpot(0.8, 0.1, Case.RETURNED))
    moment = RallyMoment(9, RallyHistory().at(0, {}).picture, None, sent, None, (returned,))
    alone = moment_html(replace(moment, outcomes=()), 15.0, 1.0, robot=False, outcomes=False)
    for name in ("Racket turned by", "Racket pose", "Aims at", "Last ball", "Returned"):
        assert name not in alone and name in moment_html(moment, 15.0, 1.0)
    assert "Hit predicted after the bounce" in alone


def test_where_nobody_tells_outcomes_strokes_that_were_seen_are_counted() -> None:
    seen = tuple(Outcome(k, 0, 5.0, LandingSpot(0.8, 0.1, case)) for k, case in enumerate((Case.NET, Case.RETURNED)))
    moment = RallyMoment(9, RallyHistory().at(0, {}).picture, None, None, None, seen)
    said = moment_html(moment, 15.0, 1.0, robot=False, outcomes=False)
    assert "Strokes, as seen" in said and "1 of 2 returned" in said and "0.80 / +0.10 m" in said
    assert "Last ball" not in said


CLOCK = ClockEstimate(0.0, 0.0, 12.34e-6, 420.0, 60_000_000)


def report(name: str, **changed) -> CameraReport:
    told = {
        "name": name, "serial": "00<1>", "model": "Prophesee EVK4", "counts": FeedCounts(events=5), "rate_hz": 1.25e6,
        "clock": CLOCK, "clock_restarts": 0, "problem": "",
    }  # fmt: skip
    return CameraReport(**(told | changed))


def test_two_cameras_that_are_well_say_their_rate_and_clocks() -> None:
    rows = dict(device_rows((report("left"), report("right", clock=None)), cable=False))
    assert rows["left"] == "Prophesee EVK4 00&lt;1&gt;, 1.2 million events/s"
    assert rows["Clock of left"] == "+12.3 ppm against this machine, packets up to 0.4 ms late"
    assert rows["Clock of right"] == "not known yet" and not any("Lost" in name for name in rows)


def test_how_the_second_clock_becomes_the_first_is_said() -> None:
    both = (report("left"), report("right", clock_restarts=2))
    assert "shifted to left's" in dict(device_rows(both, cable=False))["Clock of right"]
    said = dict(device_rows(both, cable=True))["Clock of right"]
    assert "one with left's, by cable" in said and "restarted 2 times" in said


def test_a_camera_that_is_gone_says_why() -> None:
    (row,) = device_rows((report("left", problem="1: the camera is gone; plug <it> in"),), cable=False)
    assert row[0] == "left" and theme.BAD in row[1] and "plug &lt;it&gt; in" in row[1]


def test_losses_are_said_and_nothing_where_there_are_none() -> None:
    assert lost_words(FeedCounts(events=10)) == ""
    said = lost_words(FeedCounts(packets_dropped=1200, gaps=3, events_given_up=4, packets_refused=1))
    assert said.startswith("1,200 USB packets") and "4 events that came too late" in said
    assert said.endswith("; 1 invalid packet")
    assert lost_words(FeedCounts(gaps=3)) == "3 gaps in what the camera sent"


def test_pictures_that_were_skipped_are_said_with_why(source, snapshot) -> None:
    assert "Pictures" not in stream_html(source, WELL, snapshot)
    snapshot.health.pictures, snapshot.health.pictures_skipped = 1200, 0
    said = stream_html(source, WELL, snapshot)
    assert "1,200 looked at" in said and "kipped" not in said
    snapshot.health.pictures_skipped = 34
    assert "34: yolo is too slow" in stream_html(source, WELL, snapshot)
