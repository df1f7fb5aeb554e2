"""The bounded racket: it arrives exactly when it can, and its limits hold when it cannot."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics.rotation import axis_quaternion, normals_from_orientations, orientations_from_actions
from core.physics.task import StrokeConfig
from core.simulation.episodes.racket import (
    RacketConfig,
    RacketState,
    RacketTarget,
    check_target,
    move_racket,
    target_for_ball,
    upright_racket,
)

pytestmark = pytest.mark.numeric
CONFIG = RacketConfig()
HOME_Q = np.array([1.0, 0, 0, 0])
TILTED = orientations_from_actions([0.0, 0.8, -0.6], StrokeConfig())
STROKE = RacketTarget(np.array([-1.44, 0.25, 0.30]), TILTED, np.array([1.0, 0, 0]), 0.40)


def run(target: RacketTarget | None, until_s: float, dt_s: float) -> list[RacketState]:
    states = [upright_racket(CONFIG)]
    for k in range(round(until_s / dt_s)):
        states.append(move_racket(states[-1], target, k * dt_s, dt_s, CONFIG, HOME_Q))
    return states


@pytest.mark.parametrize("dt_s", [0.01, 0.001, 0.016])
def test_a_reachable_stroke_is_reached_at_its_time_with_its_velocity_whatever_the_step(dt_s: float) -> None:
    racket = run(STROKE, 0.4, dt_s)[-1]
    assert racket.p_m == pytest.approx(STROKE.p_m, abs=1e-9)
    assert racket.v_mps == pytest.approx(STROKE.v_mps, abs=1e-7)
    assert racket.q_wxyz == pytest.approx(TILTED)


def test_it_follows_through_with_the_velocity_of_the_stroke() -> None:
    racket = run(STROKE, 0.45, 0.01)[-1]
    assert racket.p_m == pytest.approx(STROKE.p_m + 0.05 * STROKE.v_mps, abs=1e-9)


def test_the_limits_hold_when_the_target_is_too_far_too_soon_and_the_racket_comes_short() -> None:
    hurried = dataclasses.replace(STROKE, p_m=np.array([-1.0, 0.7, 0.5]), t_s=0.1)
    states = run(hurried, 0.1, 0.002)
    vs = np.array([state.v_mps for state in states])
    assert np.linalg.norm(np.diff(vs, axis=0), axis=1).max() <= CONFIG.max_acceleration_mps2 * 0.002 * (1 + 1e-9)
    assert np.linalg.norm(vs, axis=1).max() <= CONFIG.max_speed_mps * (1 + 1e-9)
    assert np.linalg.norm(states[-1].p_m - hurried.p_m) > 0.1


def test_it_turns_no_faster_than_its_rate() -> None:
    quarter = np.array([math.cos(math.pi / 4), 0, 0, math.sin(math.pi / 4)])
    first, second = run(dataclasses.replace(STROKE, q_wxyz=quarter), 0.05, 0.01)[2:4]
    angle = 2 * math.acos(abs(float(first.q_wxyz @ second.q_wxyz)))
    assert angle == pytest.approx(0.01 * CONFIG.max_turn_rate_radps)
    assert second.turn_radps == pytest.approx([0, 0, CONFIG.max_turn_rate_radps])


def test_what_is_left_to_turn_takes_one_step_if_the_rate_allows_it() -> None:
    left = 0.8 * 0.01 * CONFIG.max_turn_rate_radps
    turned = dataclasses.replace(upright_racket(CONFIG), q_wxyz=axis_quaternion(2, left))
    racket = move_racket(turned, None, 0.0, 0.01, CONFIG, HOME_Q)
    assert racket.q_wxyz == pytest.approx(HOME_Q)
    assert racket.turn_radps == pytest.approx([0, 0, -left / 0.01])


def test_without_a_target_it_settles_at_rest() -> None:
    state = RacketState(np.array([-1.3, 0.4, 0.5]), np.array([2.0, 0, 0]), TILTED, np.zeros(3))
    for k in range(200):
        state = move_racket(state, None, k * 0.01, 0.01, CONFIG, HOME_Q)
    assert state.p_m == pytest.approx(CONFIG.home_m, abs=1e-3)
    assert state.v_mps == pytest.approx(np.zeros(3), abs=1e-2)
    assert state.q_wxyz == pytest.approx(HOME_Q)


def test_the_face_of_a_target_for_a_ball_touches_the_ball_in_its_middle() -> None:
    ball = np.array([-1.42, 0.1, 0.2])
    target = target_for_ball(ball, TILTED, np.zeros(3), 1.0)
    assert ball - target.p_m == pytest.approx(0.02 * normals_from_orientations(TILTED))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"p_m": np.array([5.0, 0, 0])}, "out of reach"),
        ({"v_mps": np.array([9.0, 0, 0])}, "too fast"),
        ({"q_wxyz": np.array([1.0, 1, 0, 0])}, "unit quaternion"),
        ({"p_m": np.array([math.nan, 0, 0])}, "not finite"),
        ({"t_s": math.inf}, "not finite"),
        ({"p_m": np.zeros(2)}, "wrong shape"),
    ],
)
def test_targets_out_of_bounds_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        check_target(dataclasses.replace(STROKE, **change), CONFIG)  # pyright: ignore[reportArgumentType]
