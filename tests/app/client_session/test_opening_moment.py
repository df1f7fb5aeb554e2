"""The first bounce in slow motion, on the chain's own history of a recorded serve."""

from dataclasses import replace
from pathlib import Path

import pytest

from app.client_session.opening_moment import AFTER_US, BEFORE_US, SLOW, SLOWEST, OpeningMoment, bounce_near
from app.state.client_state import ClientState, Configs, History, Playhead
from app.state.commands import SetMode, TogglePlay
from core.detection import DetectorConfig
from core.history.following import Followings
from core.history.rally_history import RallyHistory
from core.recordings import open_recording
from core.recordings.truth import turning_points
from tests.waiting import eventually


@pytest.fixture(scope="module")
def followed(serve_recording: Path) -> tuple[RallyHistory, int]:
    """The history of the serve, and when it really bounces."""
    followings = Followings()
    with open_recording(serve_recording) as recording:
        following = followings.of(recording)
        assert following is not None and recording.ball is not None
        eventually(lambda: following.share == 1.0, "the serve to be followed", lambda: following.share)
        bounce_us = int(turning_points(recording.ball).bounces_us[0])
        followings.close()
        return following.history, bounce_us


def live_state() -> ClientState:
    head = Playhead(600_000, live=True, following=True, playing=True, speed=1.0)
    return ClientState("live", ("left", "right"), "left", head, History(Configs(DetectorConfig(), DetectorConfig())))


def test_the_bounce_is_known_a_little_before_it_comes(followed) -> None:
    history, bounce_us = followed
    assert bounce_near(history, bounce_us - 2 * BEFORE_US) is None
    bounce = bounce_near(history, bounce_us - BEFORE_US // 2)
    assert bounce is not None and abs(bounce.t_us - bounce_us) < 15_000
    assert bounce.back_us > bounce.t_us + 300_000
    assert bounce_near(RallyHistory(), 0) is None


def test_it_is_slowest_round_the_bounce_and_live_again_after_the_return(followed) -> None:
    history, bounce_us = followed
    begun: list[bool] = []
    opening = OpeningMoment(lambda: begun.append(True))
    state, wall_s, seen = live_state(), 100.0, []
    while not opening.over:
        state = replace(state, playhead=state.playhead.grown(0, round((wall_s - 99.4) * 1e6)))  # the rally goes on
        state = opening.follow(state, history, wall_s)
        seen.append((state.playhead.position_us(wall_s), state.playhead.speed))
        wall_s += 0.1
        assert wall_s < 130.0
    assert begun == [True] and state.playhead.following and state.playhead.speed == 1.0
    positions = [t_us for t_us, _ in seen[:-1]]
    assert positions == sorted(positions) and positions[0] < bounce_us < positions[-1]
    assert {speed for t_us, speed in seen if abs(t_us - bounce_us) < BEFORE_US // 2} == {SLOWEST}
    assert {speed for t_us, speed in seen[:-1] if t_us > bounce_us + 2 * AFTER_US} == {SLOW}
    assert 5.0 < wall_s - 100.0 < 18.0, "seconds, and fewer than the live rally remembers"


@pytest.mark.parametrize("touch", [TogglePlay(), SetMode("Tune")])
def test_whoever_touches_a_control_has_it(followed, touch) -> None:
    history, _ = followed
    opening = OpeningMoment(lambda: None)
    state = opening.follow(live_state(), history, 100.0)
    assert state.playhead.speed == SLOWEST and not opening.over
    touched = touch.apply(state, 101.0)
    assert opening.follow(touched, history, 101.0) == touched and opening.over
    assert opening.follow(touched, history, 140.0) == touched


def test_a_rally_that_stands_still_is_shown_live_when_the_cursor_has_caught_up(followed) -> None:
    history, _ = followed
    opening = OpeningMoment(lambda: None)
    state = opening.follow(live_state(), history, 100.0)
    settled = replace(state, playhead=state.playhead.settle(150.0))
    assert settled.playhead.following and settled.playhead.speed == SLOWEST
    state = opening.follow(settled, history, 150.0)
    assert opening.over and state.playhead.following and state.playhead.playing and state.playhead.speed == 1.0


def test_a_recording_is_left_as_it_is(followed) -> None:
    state = replace(live_state(), playhead=Playhead(600_000))
    opening = OpeningMoment(lambda: pytest.fail("nothing begins"))
    assert opening.follow(state, None, 1.0) == state and opening.over
