"""The last missed ball before a moment."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from core.history.following import Following
from core.history.lead_time import true_crossings
from core.history.missed_balls import MissedBall, MissedBallRequest, find_missed_ball
from core.history.rally_history import Outcome, RallyHistory
from core.history.rally_picture import LandingSpot
from core.physics.episode import Case
from core.recordings import PixelTruth, open_recording

WINDOW_US = 2_000


def add_steps(history: RallyHistory, blind: dict[str, tuple[int, int]], end_us: int = 400_000) -> None:
    """Steps of 2 ms in which both cameras see the ball but for (start, end] of those that are named."""
    found = SimpleNamespace(u_px=1.0, v_px=2.0, r_px=3.0)
    for t_us in range(WINDOW_US, end_us + 1, WINDOW_US):
        hidden = {name for name, (start, end) in blind.items() if start < t_us <= end}
        detections = {name: None if name in hidden else found for name in ("left", "right")}
        seconds = SimpleNamespace(total=0.0)
        chain = SimpleNamespace(
            t_us=t_us,
            detections=detections,
            used=frozenset(),
            is_new=False,
            prediction=None,
            point=None,
            seconds=seconds,
        )
        history.add_step(SimpleNamespace(chain=chain, decision=None))


def recording_with_truth(visible_until_us: int = 400_000) -> SimpleNamespace:
    t_us = np.arange(0, 401_000, 1_000)
    ones = np.ones(len(t_us))
    truth = PixelTruth(t_us, ones, ones, ones, t_us <= visible_until_us)
    return SimpleNamespace(cameras={name: SimpleNamespace(truth=truth) for name in ("left", "right")})


def outcome(case: Case, t_us: int, serve_us: int) -> Outcome:
    return Outcome(t_us, serve_us, 5.0, LandingSpot(0.5, 0.0, case))


def find(recording, history: RallyHistory, t_us: int) -> MissedBall | None:
    return find_missed_ball(MissedBallRequest(recording, history, t_us))


def test_a_stretch_in_which_one_camera_did_not_see_the_ball_is_found_at_its_middle() -> None:
    history = RallyHistory()
    add_steps(history, {"right": (100_000, 130_000)})
    missed = find(recording_with_truth(), history, 400_000)
    assert missed == MissedBall(116_000, "right", "not seen", 30_000)
    assert find(recording_with_truth(), history, 100_000) is None


def test_some_windows_are_no_missed_ball_and_neither_is_a_ball_that_nobody_can_see() -> None:
    history = RallyHistory()
    add_steps(history, {"right": (100_000, 108_000), "left": (200_000, 260_000)})
    assert find(recording_with_truth(visible_until_us=199_000), history, 400_000) is None


def test_a_ball_that_did_not_come_back_is_looked_at_where_it_was_not_seen() -> None:
    history = RallyHistory()
    add_steps(history, {"left": (150_000, 170_000)})
    history.add_outcome(outcome(Case.MISSED, 300_000, 90_000))
    assert find(recording_with_truth(), history, 400_000) == MissedBall(160_000, "left", "not returned", 20_000)


def test_a_ball_that_was_seen_and_did_not_come_back_is_looked_at_when_it_was_to_be_hit() -> None:
    history = RallyHistory()
    add_steps(history, {})
    history.add_outcome(outcome(Case.RETURNED, 150_000, 20_000))
    history.add_outcome(outcome(Case.NET, 380_000, 200_000))
    history._hits.add(250_000, (250_000, SimpleNamespace(t_s=0.31)))
    assert find(recording_with_truth(), history, 400_000) == MissedBall(310_000, "left", "not returned")
    assert find(recording_with_truth(), history, 379_000) is None


def test_a_ball_that_nobody_followed_is_not_looked_at() -> None:
    history = RallyHistory()
    add_steps(history, {})
    history.add_outcome(replace(outcome(Case.MISSED, 300_000, 90_000), counted=False))
    assert find(recording_with_truth(), history, 400_000) is None


def test_a_ball_of_which_blocks_were_skipped_says_how_much() -> None:
    history, whole = RallyHistory(), RallyHistory()
    add_steps(whole, {"left": (180_000, 200_000)})
    for step in whole.steps_between(0, 400_000):
        if not 150_000 < step.t_us <= 170_000:
            history._steps.add(step.t_us, step)
    history.add_outcome(outcome(Case.MISSED, 300_000, 90_000))
    assert find(recording_with_truth(), history, 400_000) == MissedBall(190_000, "left", "not returned", 20_000, 22_000)


def test_a_racket_that_was_not_yet_where_it_was_sent_is_noted() -> None:
    for at_m, away_m in ((0.0, 0.0), (0.12, 0.12)):
        history = RallyHistory()
        add_steps(history, {"left": (180_000, 200_000)})
        target = SimpleNamespace(p_m=np.array([-1.5, 0.0, 0.2]), q_wxyz=np.array([1.0, 0, 0, 0]), t_s=0.3)
        sent = SimpleNamespace(target=target, landing_m=None)
        step = history.steps_between(0, 250_000)[-1]
        history._targets.add(step.t_us, sent)
        history.add_rackets(np.array([299_000]), target.p_m[None] + [0.0, at_m, 0.0], target.q_wxyz[None])
        history.add_outcome(outcome(Case.MISSED, 300_000, 90_000))
        missed = find(recording_with_truth(), history, 400_000)
        assert missed is not None and missed.away_m == pytest.approx(away_m) and missed.unseen_us == 20_000


def test_the_later_of_two_is_the_one() -> None:
    history = RallyHistory()
    add_steps(history, {"right": (330_000, 350_000)})
    history.add_outcome(outcome(Case.MISSED, 300_000, 90_000))
    missed = find(recording_with_truth(), history, 400_000)
    assert missed is not None and missed.kind == "not seen" and missed.t_us == 340_000


def test_a_camera_without_truth_is_not_said_to_have_missed_anything() -> None:
    history = RallyHistory()
    add_steps(history, {"right": (100_000, 130_000)})
    recording = SimpleNamespace(cameras={name: SimpleNamespace(truth=None) for name in ("left", "right")})
    assert find(recording, history, 400_000) is None
    assert find(recording, RallyHistory(), 400_000) is None


def test_of_a_real_pass_the_racket_was_to_be_there_when_the_ball_crossed_its_plane(serve_recording: Path) -> None:
    with open_recording(serve_recording) as recording:
        following = Following(recording)
        following.wait()
        following.history.add_outcome(outcome(Case.MISSED, 590_000, 10_000))
        missed = find(recording, following.history, 600_000)
        assert recording.ball is not None
        crossings_us, _ = true_crossings(recording.ball, following.history.predicted_hits()[-1][1].p_world_m[0])
    assert missed is not None and missed.kind == "not returned"
    assert missed.unseen_us > 0 or missed.t_us == pytest.approx(crossings_us[0], abs=5_000)
