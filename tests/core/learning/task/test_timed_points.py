"""What is known at the decision: nothing of what comes after it, a bounce that is found, a racket with limits."""

import dataclasses

import numpy as np
import pytest

from core.learning.config import EnvironmentConfig, TimingConfig
from core.learning.task.environment import draw_serve_batch, play, strokes_of
from core.learning.task.timed_points import FollowingRacket, observe_in_time, turned_share
from core.physics.episode import Case
from core.simulation.episodes.racket import RacketConfig

pytestmark = pytest.mark.numeric
TIMED = EnvironmentConfig(state_source="timed")
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def timed(**changes: float) -> EnvironmentConfig:
    return dataclasses.replace(TIMED, timing=TimingConfig(**changes))  # type: ignore[arg-type]


def drawn(config: EnvironmentConfig, speed: float = 5.0, count: int = 12, seed: int = 3):
    return draw_serve_batch(speed, count, config, np.random.default_rng(seed))


def test_without_errors_the_state_is_nearly_the_truth_and_the_bounce_was_found_by_itself() -> None:
    balls = drawn(timed(error_scale=0.0))
    assert balls.seen.all() and balls.aim_t_s is not None
    off = balls.states - balls.arrivals.observations
    assert np.abs(off[:, :3]).max() < 0.002 and np.abs(off[:, 3:]).max() < 0.05
    assert np.abs(balls.aim_t_s - balls.arrivals.t_s).max() < 1e-3


def test_errors_grow_with_their_scale() -> None:
    small, large = (drawn(timed(error_scale=scale), count=30) for scale in (1.0, 10.0))
    spread = [np.abs(b.states - b.arrivals.observations)[b.seen].mean() for b in (small, large)]
    assert 0 < 2 * spread[0] < spread[1]


@pytest.mark.parametrize("lead_ms", [50.0, 90.0])
def test_the_stroke_is_decided_a_block_at_most_before_the_lead_is_all_that_is_left(lead_ms: float) -> None:
    config = timed(lead_ms=lead_ms)
    balls = drawn(config)
    assert balls.turn_s is not None
    left_ms = 1e3 * balls.turn_s[balls.seen]
    assert (left_ms < lead_ms).all() and (left_ms > lead_ms - 1e3 * 0.0101 - 5).all()


def test_nothing_that_happens_after_the_decision_changes_what_is_known() -> None:
    """The same balls with another arrival: the truth behind the decision is bent, and nobody notices."""
    config = timed()
    balls = drawn(config)
    again = observe_in_time(balls.serves, balls.arrivals, config, 1.0, np.random.default_rng(8))
    late = dataclasses.replace(balls.arrivals, states=balls.arrivals.states + 5.0)
    bent = observe_in_time(balls.serves, late, config, 1.0, np.random.default_rng(8))
    np.testing.assert_array_equal(bent.states, again.states)
    assert (again.decided_t_s < balls.arrivals.t_s - 0.035).all()


def test_every_ball_has_a_racket_speed_of_its_own() -> None:
    """Recorded balls arrive at all speeds: each is watched with its own racket, not with that of the first."""
    config = timed(lead_ms=10.0)  # so late that the racket cannot make up for what is new
    balls = drawn(config)

    def aims(speeds_mps: object) -> np.ndarray:
        rng = np.random.default_rng(8)
        return observe_in_time(balls.serves, balls.arrivals, config, speeds_mps, rng).aim_ps_m  # type: ignore[arg-type]

    slow, fast, each = aims(0.5), aims(4.5), aims(np.where(np.arange(12) % 2, 4.5, 0.5))
    assert not np.array_equal(slow[1::2], fast[1::2])
    np.testing.assert_array_equal(each[::2], slow[::2])
    np.testing.assert_array_equal(each[1::2], fast[1::2])


def test_a_decision_before_the_bounce_is_predicted_through_it() -> None:
    early = drawn(timed(lead_ms=200.0), count=30)
    assert early.turn_s is not None and early.aim_t_s is not None
    before = early.aim_t_s - early.turn_s < early.arrivals.bounce_t_s
    assert before.any(), "no ball was decided on before its bounce"
    off = np.abs(early.states - early.arrivals.observations)[before]
    assert 1e-5 < off[:, 1:3].max() < 0.02 and 1e-4 < off[:, 3:].max() < 0.2


def test_a_ball_that_is_never_seen_is_missed() -> None:
    balls = drawn(timed(seen_from_x_m=-1.4))
    assert not balls.seen.any()
    assert (play(balls, np.zeros((12, 3)), TIMED).case == Case.MISSED).all()


def test_balls_that_are_seen_are_met_by_the_racket() -> None:
    balls = drawn(TIMED)
    assert (play(balls, np.zeros((12, 3)), TIMED).case != Case.MISSED).all()


def test_the_paper_s_rule_sees_less_well_than_the_filter() -> None:
    paper = dataclasses.replace(TIMED, timing=TimingConfig(predictor="paper"))
    ours, theirs = drawn(TIMED, count=30), drawn(paper, count=30)
    both = ours.seen & theirs.seen
    assert both.sum() > 10
    spread = [np.abs(b.states - b.arrivals.observations)[both].mean() for b in (ours, theirs)]
    assert spread[1] > spread[0]


def test_a_racket_that_is_told_in_time_gets_there_and_one_that_is_told_late_does_not() -> None:
    aim = np.array([-1.42, 0.3, 0.3])
    early, late = FollowingRacket(UPRIGHT, 1.0), FollowingRacket(UPRIGHT, 1.0)
    for racket, told_s in ((early, 0.1), (late, 0.47)):
        racket.move(told_s)
        racket.aim(aim, 0.5)
    assert np.linalg.norm(early.short_of_m()) < 0.002
    assert np.linalg.norm(late.short_of_m()) > 0.1


def test_a_racket_refuses_what_is_out_of_reach() -> None:
    racket = FollowingRacket(UPRIGHT, 1.0)
    racket.aim(np.array([-1.42, 5.0, 0.3]), 0.5)
    assert (racket.short_of_m() == 0).all(), "it stays where it is, and has no target to fall short of"


def test_a_turn_takes_its_time() -> None:
    rate = RacketConfig().max_turn_rate_radps
    angles = np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.2, 0.0], [0.2, 0.0, 0.0]])
    share = turned_share(angles, np.array([0.1 / rate, 0.1, 0.05, -1.0]))
    assert share == pytest.approx([0.5, 1.0, 1.0, 0.0])
    balls = drawn(TIMED, count=3)
    actions = np.full((3, 3), 0.5)
    hurried = dataclasses.replace(balls, turn_s=np.zeros(3))
    still = strokes_of(hurried, actions, TIMED).qs_wxyz
    np.testing.assert_allclose(still, strokes_of(hurried, np.zeros((3, 3)), TIMED).qs_wxyz)
    assert not np.allclose(still, strokes_of(balls, actions, TIMED).qs_wxyz)
