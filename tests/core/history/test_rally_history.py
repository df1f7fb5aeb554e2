"""A rally over time, asked for any moment."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.modes.watch.status import moment_html
from app.shared.live_rally import positions
from core.chain.config import ChainConfig
from core.chain.control.controller import RacketDecision
from core.chain.follow import follow_recording, true_positions
from core.history.following import Following, Followings, is_stereo
from core.history.rally_history import BALL_US, OUTCOMES_KEPT, Outcome, RallyHistory
from core.history.rally_picture import LandingSpot
from core.physics.episode import Case
from core.recordings import open_recording
from core.simulation.episodes.racket import RacketTarget

pytestmark = pytest.mark.numeric


@pytest.fixture(scope="module")
def recording(serve_recording: Path):
    recording = open_recording(serve_recording)
    yield recording
    recording.close()


@pytest.fixture(scope="module")
def followed(recording) -> Following:
    following = Following(recording)
    following.wait()
    return following


def moment(following: Following, t_us: int):
    return following.history.at(t_us, positions(following.cameras))


def test_it_shows_the_ball_where_it_really_is(recording, followed) -> None:
    track = follow_recording(recording, ChainConfig(), 2000)
    shown = [moment(followed, int(t)).picture.ball for t in track.t_us]
    truth = true_positions(recording.ball, track.t_us)
    known = [(p, q) for p, q in zip(shown, truth, strict=True) if p is not None and np.isfinite(q).all()]
    assert len(known) > 50
    assert np.median([np.linalg.norm(p - q) for p, q in known]) < 0.005


def test_a_ball_that_is_no_longer_seen_is_no_longer_drawn(recording, followed) -> None:
    last_us = int(follow_recording(recording, ChainConfig(), 2000).t_us[-1])
    assert moment(followed, last_us).picture.ball is not None
    later = moment(followed, last_us + BALL_US + 1).picture
    assert later.ball is None and later.rays == ()


def test_rays_begin_at_the_cameras_and_end_at_the_ball(followed) -> None:
    pictures = [moment(followed, t).picture for t in range(0, followed.history.followed_us, 10_000)]
    seen = [picture for picture in pictures if picture.rays]
    assert seen
    for picture in seen:
        for start, end in picture.rays:
            assert any(np.array_equal(start, p) for p in positions(followed.cameras).values())
            np.testing.assert_array_equal(end, picture.ball)


def test_the_flight_is_predicted_before_the_bounce_and_again_after_it(followed) -> None:
    pictures = [moment(followed, t).picture for t in range(0, followed.history.followed_us, 4_000)]
    first = next(n for n, picture in enumerate(pictures) if len(picture.before_bounce))
    second = next(n for n, picture in enumerate(pictures) if len(picture.after_bounce))
    assert 0 < first < second
    assert abs(pictures[first].bounce[2] - 0.02) < 0.005
    before, after = pictures[first].before_bounce, pictures[second].after_bounce
    assert np.linalg.norm(before[-1] - after[-1]) < 0.25, "both end at the hitting plane"
    assert abs(after[-1][0] - before[-1][0]) < 1e-6


def test_nothing_of_the_future_is_shown(followed) -> None:
    early = moment(followed, 0).picture
    assert early.ball is None and len(early.trail) == 0 and len(early.before_bounce) == 0


def test_a_ball_that_is_suddenly_elsewhere_begins_a_trail_of_its_own() -> None:
    history = RallyHistory()

    def see(t_us: int, x_m: float, verdict: str) -> None:
        point = SimpleNamespace(t_us=t_us, p_world_m=np.array([x_m, 0.0, 0.3]), uvs_px={})
        chain = SimpleNamespace(
            t_us=t_us,
            detections={},
            used=frozenset(),
            is_new=False,
            point=point,
            verdict=verdict,
            seconds=SimpleNamespace(total=0.0),
        )
        history.add_step(SimpleNamespace(chain=chain, decision=None))

    for k in range(10):
        see(10_000 * k, -0.1 * k, "new flight" if k == 0 else "same flight")
    for k in range(3):
        see(100_000 + 10_000 * k, 1.2 - 0.1 * k, "new flight" if k == 0 else "same flight")
    assert len(history.at(90_000, {}).picture.trail) == 10
    np.testing.assert_allclose(history.at(120_000, {}).picture.trail[:, 0], [1.2, 1.1, 1.0])


def test_outcomes_count_from_their_time_on() -> None:
    history = RallyHistory()
    spots = [LandingSpot(0.8, 0.1, Case.RETURNED), LandingSpot(2.0, 0.0, Case.OUT)]
    for number, spot in enumerate(spots):
        history.add_outcome(Outcome(1000 * (number + 1), 0, 5.0, spot))
    assert history.at(999, {}).picture.spots == ()
    assert history.at(1000, {}).picture.spots == (spots[0],)
    now = history.at(5000, {})
    assert now.picture.spots == tuple(spots)
    text = moment_html(now, 15.0, 1.0)
    assert "1 of 2 returned (50 %)" in text and "out" in text


def test_a_long_live_rally_keeps_its_newest_outcomes_and_counts_all() -> None:
    history = RallyHistory()
    for number in range(5 * OUTCOMES_KEPT):
        history.add_outcome(Outcome(number, 0, 5.0, LandingSpot(0.8, 0.1, Case.RETURNED)))
        history.forget_before(number)
    kept = history.at(5 * OUTCOMES_KEPT, {}).outcomes
    assert OUTCOMES_KEPT <= len(kept) <= 2 * OUTCOMES_KEPT and kept[-1].t_us == 5 * OUTCOMES_KEPT - 1
    assert history.outcome_count == 5 * OUTCOMES_KEPT


def test_forgetting_keeps_what_is_younger(followed, recording) -> None:
    history = RallyHistory()
    history.add_truth(recording.ball)
    visible = recording.ball.t_us[recording.ball.visible]
    late_us = int(visible[-1])
    history.forget_before(late_us)
    assert history.at(late_us, {}).picture.truth is not None
    assert history.at(int(visible[0]), {}).picture.truth is None


def test_one_pass_is_shared_and_flat_recordings_have_none(recording) -> None:
    followings = Followings()
    try:
        assert is_stereo(recording)
        shared = followings.of(recording)
        assert isinstance(shared, Following) and list(shared.cameras) == list(recording.cameras)
        assert followings.of(recording) is shared
        paper = followings.of(recording, "paper")
        assert paper is not None and paper is not shared and followings.of(recording, "paper") is paper
        name, camera = next(iter(recording.cameras.items()))
        flat = SimpleNamespace(cameras={name: camera}, uuid="flat")
        assert followings.of(flat) is None  # type: ignore[arg-type]
    finally:
        followings.close()


def test_the_figures_say_how_far_the_chain_has_come() -> None:
    empty = RallyHistory().at(0, {})
    assert "43 %" in moment_html(empty, 15.0, 0.43) and "Followed" not in moment_html(empty, 15.0, 1.0)


def test_where_the_racket_was_sent_counts_and_not_what_the_chain_would_do_now(recording) -> None:
    following = Following(recording)
    following.wait()
    pose = RacketTarget(np.array([-1.4, 0.2, 0.3]), np.array([1.0, 0, 0, 0]), np.zeros(3), 0.5)
    goal = np.array([0.7, -0.2])
    action, unknown = np.array([0.0, 0.5, -0.5]), np.full(6, np.nan)
    sent = RacketDecision(t_us=100_000, stage="post", state=unknown, goal_m=goal, target=pose, action=action)
    following.history.add_targets([sent])
    assert moment(following, 99_999).picture.racket_target is None
    now = moment(following, 400_000)
    np.testing.assert_array_equal(now.picture.racket_target.p_world_m, pose.p_m)
    np.testing.assert_array_equal(now.picture.landing_target, goal)
    assert "+7.5&deg;, -7.5&deg; after the bounce" in moment_html(now, 15.0, 1.0)
    assert moment(following, 800_000).picture.racket_target is None, "the ball is long gone"
