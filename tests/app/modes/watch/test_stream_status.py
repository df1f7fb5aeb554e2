"""What is said of a live source that is no simulation."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from app import theme
from app.modes.watch.status import moment_html
from app.modes.watch.stream_status import camera_rows, stream_html
from core.history.rally_history import Outcome, RallyHistory, RallyMoment
from core.history.rally_picture import LandingSpot
from core.live.stream_watch import CameraHealth, StreamHealth
from core.physics.episode import Case

WELL = StreamHealth(1.0, 0.01, False, 0, (CameraHealth("left", 0, 0, 0), CameraHealth("right", 0, 0, 0)))


@pytest.fixture
def snapshot() -> SimpleNamespace:
    span = SimpleNamespace(p50_ms=0.2, p99_ms=1.0)
    return SimpleNamespace(
        health=SimpleNamespace(state_hz=400.0, step=span, blocks_dropped=0), problem="", learned=None
    )


@pytest.fixture
def source() -> SimpleNamespace:
    state = SimpleNamespace(speed_factor=1.0)
    return SimpleNamespace(description="replay of <b>.h5", status="connected", state=state, behind_s=0.0, robot=None)


def test_a_source_that_is_well_says_its_pace_and_that_it_has_no_robot(source, snapshot) -> None:
    said = stream_html(source, WELL, snapshot)
    assert "replay of &lt;b&gt;.h5, 1.00 x real time" in said and "It has no robot" in said
    assert not any(colour in said for colour in (theme.BAD, theme.WARN)) and "left" not in said


def test_a_pace_that_is_not_kept_is_said_with_what_was_lost_by_it(source, snapshot) -> None:
    source.behind_s, snapshot.health.blocks_dropped = 2.34, 1200
    said = stream_html(source, replace(WELL, pace=0.62), snapshot)
    assert "only 0.62 x real time instead of 1: this machine is busy" in said
    assert "2.3 s in all" in said and "1,200 blocks of 10 ms" in said


def test_a_stream_that_stops_is_red_and_so_is_one_that_failed(source, snapshot) -> None:
    assert "nothing has come for 4 s" in (
        said := stream_html(source, replace(WELL, quiet_s=4.2, stopped=True), snapshot)
    )
    assert theme.BAD in said
    source.status = "lost"
    assert "stopped: nothing more comes" in stream_html(source, WELL, snapshot)


def test_a_lost_camera_a_silent_one_and_lost_blocks_are_said(source, snapshot) -> None:
    lost, silent = CameraHealth("left", 120, 1_200_000, 1_200_000), CameraHealth("right", 0, 0, 2_500_000)
    said = stream_html(source, replace(WELL, blocks_lost=7, cameras=(lost, silent)), snapshot)
    assert "lost, nothing of it for 1.2 s; 120 blocks of 10 ms never came. The rest goes on" in said
    assert "not one event for 2.5 s" in said and "7 of 10 ms never came" in said
    assert dict(camera_rows((CameraHealth("left", 3, 0, 0),)))["left"].count("3 blocks of 10 ms never came") == 1


def test_why_there_is_no_ball_in_space_is_said_in_place_of_how_it_is_followed(source, snapshot) -> None:
    snapshot.problem = "two cameras are needed"
    said = stream_html(source, WELL, snapshot)
    assert "two cameras are needed" in said and "Followed" not in said


def test_without_a_robot_and_outcomes_no_figure_speaks_of_them() -> None:
    nothing = RallyMoment(0, RallyHistory().at(0, {}).picture, None, None, None, ())
    alone = moment_html(nothing, 15.0, 1.0, robot=False, outcomes=False)
    for name in ("Racket turned by", "Racket pose", "Aims at", "Last ball", "Returned"):
        assert name not in alone and name in moment_html(nothing, 15.0, 1.0)
    assert "Hit predicted after the bounce" in alone


def test_where_nobody_tells_outcomes_strokes_that_were_seen_are_counted() -> None:
    seen = tuple(Outcome(k, 0, 5.0, LandingSpot(0.8, 0.1, case)) for k, case in enumerate((Case.NET, Case.RETURNED)))
    moment = RallyMoment(9, RallyHistory().at(0, {}).picture, None, None, None, seen)
    said = moment_html(moment, 15.0, 1.0, robot=False, outcomes=False)
    assert "Strokes, as seen" in said and "1 of 2 returned" in said and "0.80 / +0.10 m" in said
    assert "Last ball" not in said
