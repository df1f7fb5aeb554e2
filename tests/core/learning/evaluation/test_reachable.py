"""What the racket's bounds leave a player, told in one line only where they limit."""

import dataclasses

import numpy as np
import pytest

from core.learning.config import environment_profile
from core.learning.evaluation.policy_evaluator import oracle_actions
from core.learning.evaluation.reachable import reachable, reachable_words
from core.learning.task.environment import play, validation_balls

pytestmark = pytest.mark.numeric
REAL = environment_profile("real", state_source="truth")
PAPER = environment_profile(state_source="truth")


def test_slow_serves_of_real_physics_are_limited_and_that_is_said() -> None:
    (line,) = reachable_words(REAL, (3.0, 5.0))
    found = reachable(REAL, 3.0)
    assert f"about {100 * found.share:.0f} % of these serves at 3 m/s" in line and "+-15 degrees, 3.8 m/s" in line
    assert 0.3 < found.share < 0.8 and found.falling_deg > 50 and found.height_m < 0.12


def test_nothing_is_said_where_nearly_every_ball_can_be_returned() -> None:
    assert reachable_words(PAPER, (3.0, 5.0, 9.0)) == ()


def test_it_is_the_share_that_the_oracle_returns() -> None:
    balls = validation_balls(3.0, 24, REAL)
    oracle = play(balls, oracle_actions(balls, REAL), REAL).returned.mean()
    assert abs(reachable(REAL, 3.0, 24).share - oracle) < 1.5 / 24


def test_how_the_ball_is_seen_changes_nothing_and_a_chosen_speed_is_named() -> None:
    noisy = dataclasses.replace(REAL, state_source="truth+noise", state="spin")
    assert reachable(noisy, 3.0, 16).share == reachable(REAL, 3.0, 16).share
    chosen = reachable(dataclasses.replace(REAL, racket="chosen"), 3.0, 16)
    assert "0.0 to 4.5 m/s" in chosen.bounds and chosen.share >= reachable(REAL, 3.0, 16).share - 1 / 16


def test_balls_that_are_gone_are_no_reason_to_fail() -> None:
    assert reachable_words(dataclasses.replace(REAL, recorded="/no/such/balls.json"), (5.0,)) == ()
    assert np.isfinite(reachable(PAPER, 5.0, 8).share)
