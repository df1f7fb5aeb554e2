"""The judge on hand-made tracks: what it says of clear balls, and that it doubts where nobody could know."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.outcomes import ClassifiedStroke, OutcomeClassifier
from core.physics.episode import Case
from core.table import BALL_RADIUS_M, GRAVITY_MPS2, NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric
Array = NDArray[np.float64]

HIT_M = np.array([-1.42, 0.1, 0.25])
HIT_S = 0.3
SIGMA_M = 2e-4
COVARIANCE = SIGMA_M**2 * np.eye(3)
PERIOD_S = 0.002


def fall(p_m: Array, v_mps: Array, t_s: Array) -> Array:
    ps = p_m + v_mps * t_s[:, None]
    ps[:, 2] -= 0.5 * GRAVITY_MPS2 * t_s**2
    return ps


def velocity_to(target_m: Array, flight_s: float) -> Array:
    """Off the racket, so that the ball is there so much later."""
    v = (target_m - HIT_M) / flight_s
    v[2] += 0.5 * GRAVITY_MPS2 * flight_s
    return v


def times(start_s: float, end_s: float) -> Array:
    return np.arange(start_s, end_s, PERIOD_S)


def incoming() -> tuple[Array, Array]:
    """A serve that comes down to the racket without a bounce: the judge does not mind."""
    t = times(0.0, HIT_S)
    v = np.array([-5.0, 0.2, 0.5])
    start = HIT_M - v * HIT_S
    start[2] += 0.5 * GRAVITY_MPS2 * HIT_S**2
    return t, fall(start, v, t)


def returned_track(v_mps: Array, flight_s: float, after: str, *, until_s: float = 0.25) -> tuple[Array, Array]:
    """In, off the racket, and for `until_s` after `flight_s` one of: bounce, pass, net (dropped), nothing (unseen)."""
    t0, p0 = incoming()
    t1 = times(0.012, flight_s)
    p1 = fall(HIT_M, v_mps, t1)
    parts_t, parts_p = [t0, HIT_S + t1], [p0, p1]
    if after != "nothing":
        t2 = times(1e-3, until_s)
        there = fall(HIT_M, v_mps, np.array([flight_s]))[0]
        v = v_mps - np.array([0, 0, GRAVITY_MPS2 * flight_s])
        if after == "bounce":
            v = v * np.array([0.9, 0.9, -0.9])
        elif after == "net":
            v = v * np.array([-0.1, 0.5, 0.5])
        parts_t.append(HIT_S + flight_s + t2)
        parts_p.append(fall(there, v, t2))
    return np.concatenate(parts_t), np.concatenate(parts_p)


def judge(t_s: Array, ps_m: Array, *, seed: int = 0, wait: bool = True) -> ClassifiedStroke:
    umpire = OutcomeClassifier()
    umpire.begin()
    said = feed(umpire, t_s, ps_m, seed=seed)
    assert len(said) < 2, "a ball was judged twice"
    found = said[0] if said else None
    for step in range(1, 12):
        found = found or (umpire.look(round(1e6 * t_s[-1]) + 100_000 * step) if wait else None)
    assert found is not None and found.final
    assert found.probabilities.sum() == pytest.approx(1.0)
    return found


def feed(
    umpire: OutcomeClassifier, t_s: Array, ps_m: Array, *, seed: int = 0, start_us: int = 0
) -> list[ClassifiedStroke]:
    """What is said at the points of a track."""
    rng = np.random.default_rng(seed)
    found = []
    for k, (t, p) in enumerate(zip(t_s, ps_m, strict=True)):
        noisy = p + SIGMA_M * rng.standard_normal(3)
        said = umpire.add(start_us + round(1e6 * t), noisy, COVARIANCE, is_new_flight=k == 0)
        found += [said] if said is not None else []
    return found


def test_a_ball_that_bounces_on_the_far_half_is_returned_there() -> None:
    target = np.array([0.8, -0.3, BALL_RADIUS_M])
    found = judge(*returned_track(velocity_to(target, 0.45), 0.45, "bounce"))
    assert found.case is Case.RETURNED and found.probability > 0.99
    np.testing.assert_allclose(found.landing_m, target, atol=2e-3)
    assert found.hit_us == pytest.approx(1e6 * HIT_S, abs=500)
    np.testing.assert_allclose(found.hit_state[3:], velocity_to(target, 0.45), atol=0.02)
    assert found.contact_us == pytest.approx(1e6 * (HIT_S + 0.45), abs=2000)


def test_a_ball_of_the_own_half_is_told_from_one_in_the_net() -> None:
    own = judge(*returned_track(velocity_to(np.array([-0.5, 0.2, BALL_RADIUS_M]), 0.2), 0.2, "bounce"))
    assert own.case is Case.OWN_HALF
    low = judge(*returned_track(velocity_to(np.array([-0.02, 0.2, 0.08]), 0.3), 0.3, "net"))
    assert low.case is Case.NET
    assert low.net_z_m == pytest.approx(0.08, abs=0.02) and low.net_sigma_m < 0.01


def test_a_ball_beside_the_table_is_out() -> None:
    target = np.array([0.9, TABLE_WIDTH_M / 2 + 0.15, BALL_RADIUS_M])
    found = judge(*returned_track(velocity_to(target, 0.5), 0.5, "pass"))
    assert found.case is Case.OUT
    np.testing.assert_allclose(found.landing_m, target, atol=3e-3)


@pytest.mark.parametrize(("after", "case"), [("bounce", Case.RETURNED), ("pass", Case.OUT)])
def test_on_the_line_what_follows_decides_and_without_it_nobody_is_sure(after: str, case: Case) -> None:
    target = np.array([TABLE_LENGTH_M / 2, 0.1, BALL_RADIUS_M])
    v = velocity_to(target, 0.5)
    seen = judge(*returned_track(v, 0.5, after))
    assert seen.case is case and seen.probability > 0.9
    t_s, ps_m = returned_track(v, 0.5, "nothing")
    early = t_s < HIT_S + 0.3
    lost = judge(t_s[early], ps_m[early])
    assert 0.02 < lost.probabilities[Case.RETURNED] < 0.98
    assert 0.02 < lost.probabilities[Case.OUT] < 0.98


@pytest.mark.parametrize(("after", "case"), [("net", Case.NET), ("pass", Case.RETURNED)])
def test_at_the_cord_what_follows_decides(after: str, case: Case) -> None:
    cord = np.array([0.0, 0.1, NET_HEIGHT_M + BALL_RADIUS_M])
    v = velocity_to(cord, 0.3)
    found = judge(*returned_track(v, 0.3, after, until_s=0.12))
    assert found.case is case
    assert found.net_z_m == pytest.approx(cord[2], abs=2e-3)


def test_the_less_is_seen_the_less_is_claimed() -> None:
    target = np.array([0.9, -0.2, BALL_RADIUS_M])
    t_s, ps_m = returned_track(velocity_to(target, 0.45), 0.45, "nothing")
    sigmas = []
    for seen_s in (0.03, 0.10, 0.40):
        early = t_s < HIT_S + seen_s
        found = judge(t_s[early], ps_m[early])
        off = (found.landing_m - target)[:2]
        assert off @ np.linalg.solve(found.landing_covariance_m2, off) < 16, "off by more than it says"
        sigmas.append(float(np.sqrt(np.trace(found.landing_covariance_m2))))
    assert sigmas[0] > 3 * sigmas[1] > 6 * sigmas[2]


def test_a_ball_that_goes_past_was_missed() -> None:
    t = times(0.0, 0.5)
    found = judge(t, fall(np.array([1.0, 0.0, 0.5]), np.array([-6.0, 0.0, 0.8]), t), wait=False)
    assert found.case is Case.MISSED and found.probability > 0.9
    assert np.isnan(found.landing_m).all() and np.isnan(found.hit_us)


def test_a_ball_that_is_not_seen_to_come_back_was_perhaps_missed() -> None:
    found = judge(*incoming())
    assert found.case is Case.MISSED and 0.5 < found.probability < 0.9


def test_a_serve_into_the_net_is_no_stroke() -> None:
    t0, t1 = times(0.0, 0.25), times(0.0, 0.2)
    p0 = fall(np.array([1.3, 0.0, 0.3]), np.array([-5.0, 0.0, 0.8]), t0)
    p1 = fall(p0[-1], np.array([0.6, 0.0, -0.5]), t1)
    found = judge(np.concatenate([t0, 0.252 + t1]), np.concatenate([p0, p1]))
    assert found.case is Case.MISSED


def test_strays_near_the_racket_and_anywhere_else_change_nothing() -> None:
    target = np.array([0.7, 0.4, BALL_RADIUS_M])
    t_s, ps_m = returned_track(velocity_to(target, 0.45), 0.45, "bounce")
    rng = np.random.default_rng(5)
    odd = rng.random(len(t_s)) < 0.03
    odd |= np.abs(t_s - HIT_S - 0.013) < 0.002
    ps_m[odd] += rng.uniform(-0.1, 0.1, (int(odd.sum()), 3))
    found = judge(t_s, ps_m)
    assert found.case is Case.RETURNED
    np.testing.assert_allclose(found.landing_m, target, atol=5e-3)


def test_balls_that_follow_one_another_are_each_judged_once_without_being_announced() -> None:
    umpire = OutcomeClassifier()
    found = []
    tracks = [
        returned_track(velocity_to(np.array([0.8, 0.0, BALL_RADIUS_M]), 0.45), 0.45, "bounce"),
        # This one is cut off by the next serve before anything could be seen of its end.
        returned_track(velocity_to(np.array([0.9, 0.2, BALL_RADIUS_M]), 0.5), 0.1, "nothing"),
        returned_track(velocity_to(np.array([-0.6, 0.2, BALL_RADIUS_M]), 0.2), 0.2, "bounce"),
    ]
    start_us = 0
    for t_s, ps_m in tracks:
        found += feed(umpire, t_s, ps_m, start_us=start_us)
        start_us += round(1e6 * t_s[-1]) + 20_000
    assert [one.case for one in found] == [Case.RETURNED, Case.RETURNED, Case.OWN_HALF]
    assert umpire.serve is not None and umpire.serve.t_us > 1_000_000


def test_speed_and_instant_of_a_serve_are_seen() -> None:
    umpire = OutcomeClassifier()
    umpire.begin()
    t_s, ps_m = incoming()
    feed(umpire, t_s, ps_m, start_us=700_000)
    serve = umpire.serve
    assert serve is not None and serve.t_us == 700_000
    v = np.array([-5.0, 0.2, 0.5])
    np.testing.assert_allclose(serve.v_world_mps, v, atol=0.05)
    assert abs(serve.speed_mps - np.linalg.norm(v)) < 4 * serve.sigma_mps + 1e-3


def test_nothing_seen_is_nothing_said() -> None:
    umpire = OutcomeClassifier()
    umpire.begin()
    assert umpire.look(5_000_000) is None and umpire.newest is None and umpire.serve is None


def test_a_ball_that_is_met_behind_the_plane_is_not_missed_before_it_is_hit() -> None:
    t_s, ps_m = returned_track(velocity_to(np.array([1.1, -0.1, BALL_RADIUS_M]), 0.5), 0.5, "bounce")
    ps_m[:, 0] -= 0.4
    at_plane, behind = OutcomeClassifier(), OutcomeClassifier()
    for umpire in (at_plane, behind):
        umpire.begin()
    target = SimpleNamespace(t_s=HIT_S)
    nothing = SimpleNamespace(prediction=None, point=None, verdict=None, t_us=0)
    behind.step(nothing, SimpleNamespace(state=np.array([-1.82, 0, 0, 0, 0, 0]), target=target))  # type: ignore[arg-type]
    assert [one.case for one in feed(at_plane, t_s, ps_m)][:1] == [Case.MISSED]
    assert [one.case for one in feed(behind, t_s, ps_m)][:1] == [Case.RETURNED]
