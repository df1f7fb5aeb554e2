"""Whatever is asked for: what passes the check is inside of all limits, and so is the way there."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from core.chain.control.controller import BuiltInController
from core.chain.control.hit_choice import (
    NO_TIME,
    OUT_OF_REACH,
    TILTED,
    TOO_SLOW,
    WAY_OUT,
    FaceTrajectory,
    HitChoiceConfig,
    choose_hit,
)
from core.chain.control.known_flight import KnownFlight
from core.errors import LinkError
from core.live.link.fields import read_fields, write_fields
from core.robot.motion_check import FaceMotion, face_normal, find_fault, reach_of, turned_by
from core.robot.robot_messages import RobotLimits
from core.trajectory.prediction import HitPlane
from tests.core.robot.limits import LIMITS

REST = FaceMotion.of((-1.6, 0.0, 0.25), (1, 0, 0, 0), (0, 0, 0))
HIT = FaceMotion.of((-1.42, 0.1, 0.3), (1, 0, 0, 0), (2.0, 0, 0))
ANY = st.floats(allow_nan=True, allow_infinity=True)
NEAR = st.floats(-3.0, 3.0)


def why(goal: FaceMotion, lead_us: int = 400_000, now: FaceMotion = REST, turn=None, limits=LIMITS) -> str:
    fault = find_fault(goal, turn, lead_us, now, limits)
    return "" if fault is None else fault.why


def test_a_usual_stroke_passes() -> None:
    assert why(HIT) == ""


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"p_m": np.array([-1.42, 1.01, 0.3])}, "bounds"),
        ({"p_m": np.array([-1.42, math.nan, 0.3])}, "bounds"),
        ({"v_mps": np.array([5.1, 0, 0])}, "bounds"),
        ({"v_mps": np.array([math.inf, 0, 0])}, "bounds"),
        ({"q_wxyz": np.array([0.9, 0, 0, 0])}, "bounds"),
        ({"q_wxyz": np.array([0.0, 0, 0, 1.0])}, "bounds"),  # the face looks back
        ({"p_m": np.array([-1.42, 0.98, 0.3]), "v_mps": np.array([0, 4.0, 0])}, "bounds"),  # cannot brake inside
        ({"p_m": np.array([-1.42, -0.9, 0.85])}, ""),
    ],
)
def test_what_is_out_of_bounds_is_found(change, found: str) -> None:
    assert why(dataclasses.replace(HIT, **change)) == found


def test_a_time_that_is_over_too_near_or_too_far_is_found() -> None:
    assert [why(HIT, lead_us) for lead_us in (0, -5, 2_000_001, 60_000)] == ["late", "late", "early", "unreachable"]
    turned = dataclasses.replace(HIT, q_wxyz=np.array([math.cos(0.5), 0, math.sin(0.5), 0]))
    assert why(turned, 45_000) == "unreachable" and why(turned) == "", "a radian at 20 rad/s takes 50 ms"
    assert why(HIT, turn=(0, 0, 21.0)) == "bounds" and why(HIT, turn=(0, 0, 19.0)) == ""


def test_a_racket_outside_of_its_box_may_come_back_but_go_no_farther() -> None:
    outside = FaceMotion.of((-2.3, 0, 0.25), (1, 0, 0, 0), (0, 0, 0))
    assert why(HIT, now=outside) == ""
    leaving = dataclasses.replace(outside, v_mps=np.array([-3.0, 0, 0]))
    assert why(HIT, 900_000, now=leaving) == "unreachable"


@settings(max_examples=400, deadline=None)
@example([0.0] * 10, [0.0, 0.0, -2.375, *[0.0] * 7], 153_497, True)
@given(
    st.lists(st.one_of(ANY, NEAR), min_size=10, max_size=10),
    st.lists(NEAR, min_size=10, max_size=10),
    st.integers(-(10**9), 10**9) | st.integers(30_000, 900_000),
    st.booleans(),
)
def test_nothing_that_passes_is_outside_of_a_limit(wanted, present, lead_us: int, tame: bool) -> None:
    """The way is walked in small steps, by other formulas than those of the check."""
    goal = FaceMotion.of(wanted[:3], wanted[3:7], wanted[7:])
    if tame:  # near the usual stroke, so that much passes
        shift = np.nan_to_num(np.array(wanted), nan=0, posinf=1, neginf=-1).clip(-1, 1)
        q = HIT.q_wxyz + 0.4 * shift[3:7]
        goal = FaceMotion.of(HIT.p_m + 0.3 * shift[:3], q / np.linalg.norm(q), HIT.v_mps + 2 * shift[7:])
    spread = np.array(present) / 10
    q_now = REST.q_wxyz + spread[3:7]
    now = FaceMotion.of(REST.p_m + spread[:3], q_now / np.linalg.norm(q_now), REST.v_mps + spread[7:])
    if find_fault(goal, None, lead_us, now, LIMITS) is not None:
        return
    low, high = np.array(LIMITS.low_m), np.array(LIMITS.high_m)
    assert np.isfinite([*goal.p_m, *goal.q_wxyz, *goal.v_mps]).all()
    assert 0 < lead_us <= LIMITS.max_lead_us and abs(np.linalg.norm(goal.q_wxyz) - 1) <= 1e-3
    assert math.acos(min(1.0, face_normal(goal.q_wxyz) @ LIMITS.normal)) <= LIMITS.max_tilt_rad + 1e-9
    assert turned_by(now.q_wxyz, goal.q_wxyz) <= LIMITS.max_turn_rate_radps * lead_us * 1e-6 + 1e-5
    s, T = np.linspace(0, 1, 400)[:, None], lead_us * 1e-6
    way = (  # the cubic of Hermite
        (2 * s**3 - 3 * s**2 + 1) * now.p_m
        + (s**3 - 2 * s**2 + s) * T * now.v_mps
        + (3 * s**2 - 2 * s**3) * goal.p_m
        + (s**3 - s**2) * T * goal.v_mps
    )
    # One that is outside may come back, and goes no farther out.
    assert (way >= np.minimum(low, now.p_m) - 1e-6).all() and (way <= np.maximum(high, now.p_m) + 1e-6).all()
    h = T / 399
    speeds = np.linalg.norm(np.diff(way, axis=0), axis=1) / h
    pushes = np.linalg.norm(np.diff(way, 2, axis=0), axis=1) / h**2
    assert speeds.max() <= 5.0 * 1.001 and pushes.max() <= 80.0 * 1.001
    stop = goal.p_m + goal.v_mps * np.linalg.norm(goal.v_mps) / 160
    assert (stop >= low - 1e-6).all() and (stop <= high + 1e-6).all()


def test_the_ways_that_pass_are_not_rare() -> None:
    """Else the property above says nothing."""
    rng = np.random.default_rng(3)
    goals = [
        FaceMotion.of(HIT.p_m + rng.normal(0, 0.1, 3), HIT.q_wxyz, HIT.v_mps + rng.normal(0, 0.5, 3))
        for _ in range(200)
    ]
    assert sum(why(goal) == "" for goal in goals) > 150


@pytest.mark.parametrize(
    "change",
    [{"low_m": (0.0, 0.0, 0.0), "high_m": (1.0, 0.0, 1.0)}, {"normal": (0.5, 0.0, 0.0)}, {"max_speed_mps": 21.0}],
)
def test_limits_that_are_none_are_refused(change) -> None:
    values = write_fields(LIMITS) | {name: list(v) if isinstance(v, tuple) else v for name, v in change.items()}
    with pytest.raises(LinkError):
        read_fields(RobotLimits, values, "limits")


@pytest.mark.parametrize("box", [{}, {"low_m": (-1.75, -0.6, 0.05), "high_m": (-1.1, 0.6, 0.7)}])
@pytest.mark.parametrize("tilt_deg", [60.0, 4.0])
def test_a_hit_that_is_chosen_within_the_limits_passes_the_check(box, tilt_deg: float) -> None:
    limits = dataclasses.replace(LIMITS, max_tilt_rad=math.radians(tilt_deg), **box)
    reach, controller, passed = reach_of(limits), BuiltInController(), 0
    for x_m in np.arange(-1.9, -0.9, 0.05):
        hit = hit_at((float(x_m), 0.1, 0.25))
        found = choose_hit(KnownFlight(0, "post", (), (hit,)), controller.strokes(), STILL, reach, HitChoiceConfig())
        if found.chosen is None:
            assert found.why_not in (OUT_OF_REACH, TILTED, WAY_OUT, NO_TIME, TOO_SLOW), found.why_not
            continue
        decision = controller.decide(hit.t_s, hit.p_world_m, hit.v_world_mps, stage="post", spin_radps=hit.spin_radps)
        assert decision is not None
        goal = FaceMotion.of(decision.target.p_m, decision.target.q_wxyz, decision.target.v_mps)
        fault = find_fault(goal, None, round(1e6 * hit.t_s), REST, limits)
        assert fault is None, (x_m, fault)
        passed += 1
    assert passed == 0 if tilt_deg < 5 else passed >= 3


STILL = FaceTrajectory(0.0, REST.p_m, np.zeros(3))


def hit_at(p_m: tuple[float, float, float]) -> HitPlane:
    """A ball at half a second, exactly known."""
    exact, v = np.zeros(3), np.array([-4.0, 0.0, -0.5])
    return HitPlane(0.5, 0.0, np.array(p_m), exact, v, exact, np.zeros((6, 6)), "post", np.zeros(3), exact)
