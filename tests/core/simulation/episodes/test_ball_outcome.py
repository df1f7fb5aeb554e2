"""The umpire: each sequence of events has one verdict."""

from __future__ import annotations

import numpy as np
import pytest

from core.physics.episode import Case
from core.physics.task import TaskConfig
from core.simulation.episodes.ball_outcome import RallyClassifier, RallyEvent, RallyEventKind, outcomes_of

pytestmark = pytest.mark.numeric


def event(kind: RallyEventKind, x_m: float = -0.8) -> RallyEvent:
    state = np.array([x_m, 0.0, 0.2, 4.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    return RallyEvent(kind, 1.0, state, state)


@pytest.mark.parametrize(
    ("after_the_serve", "verdicts"),
    [
        ([event("bounce"), event("hit", -1.42), event("bounce", 0.5), event("floor")], [Case.RETURNED]),
        ([event("bounce"), event("hit", -1.42), event("bounce", -0.5), event("bounce", 0.5)], [Case.OWN_HALF]),
        ([event("bounce"), event("hit", -1.42), event("net", 0.0), event("bounce", 0.5)], [Case.NET]),
        ([event("bounce"), event("hit", -1.42), event("end", -1.37)], [Case.OWN_HALF]),
        ([event("bounce"), event("hit", -1.42), event("end", 1.37)], [Case.OUT]),
        ([event("bounce"), event("hit", -1.42), event("floor", 3.0)], [Case.OUT]),
        ([event("bounce"), event("floor", -2.0)], [Case.MISSED]),
        ([event("bounce"), event("bounce"), event("hit", -1.42)], [Case.MISSED]),
        ([event("net", 0.0), event("bounce", 0.5)], [Case.MISSED]),
        ([event("bounce", 0.8), event("bounce"), event("hit", -1.42), event("bounce", 0.5)], [Case.RETURNED]),
        ([event("bounce", 0.8), event("bounce", 0.3)], [Case.MISSED]),
        ([event("bounce", 0.8), event("bounce"), event("bounce"), event("hit", -1.42)], [Case.MISSED]),
        ([event("bounce"), event("bounce", 0.8)], [Case.MISSED]),
        ([event("bounce"), event("hit_plane"), event("down"), event("top")], []),
        ([event("bounce"), event("serve")], [Case.MISSED]),
    ],
)
def test_each_course_of_a_ball_has_one_verdict(after_the_serve: list[RallyEvent], verdicts: list[Case]) -> None:
    judge = RallyClassifier(TaskConfig())
    assert [o.case for o in judge.feed([event("serve", 1.0), *after_the_serve])] == verdicts


def test_without_a_serve_there_is_nothing_to_judge() -> None:
    assert RallyClassifier(TaskConfig()).feed([event("hit", -1.42), event("bounce", 0.5)]) == ()


def test_a_missed_ball_has_no_landing_and_a_struck_one_has() -> None:
    judge = RallyClassifier(TaskConfig())
    missed, netted = judge.feed(
        [event("serve", 1.0), event("floor", -2.0), event("serve", 1.0), event("hit", -1.42), event("net", 0.0)]
    )
    assert np.isnan(missed.landing_m).all() and np.isnan(missed.net_z_m)
    assert netted.landing_m[2] == pytest.approx(0.02)
    t = 1.42 / 4.0
    assert netted.net_z_m == pytest.approx(0.2 + 2.0 * t - 0.5 * 9.81 * t * t)


def test_a_verdict_becomes_what_learning_needs_with_times_since_the_serve() -> None:
    judge = RallyClassifier(TaskConfig())
    served = event("serve", 1.0)
    hit = event("hit", -1.42)
    balls = judge.feed(
        [served, hit, event("bounce", 0.5), served, hit, event("net", 0.0), served, event("floor", -2.0)]
    )
    landed, stopped, lost = (outcomes_of(ball, 0.25) for ball in balls)
    for case, found in ((Case.RETURNED, landed), (Case.NET, stopped), (Case.MISSED, lost)):
        assert list(found.case) == [case] and len(found) == 1
        assert np.isnan(found.hit_t_s).all() and np.isnan(found.hit_states).all(), "the world does not report the hit"
        assert np.isnan(found.landing_states[0, 6:]).all(), "nor a spin"
    for ball, found in zip(balls[:2], (landed, stopped), strict=True):
        np.testing.assert_array_equal(found.landing_states[0, :6], [*ball.landing_m, *ball.landing_v_mps])
        np.testing.assert_array_equal(found.contact_states[0, 1:], found.landing_states[0, 1:])
        assert found.contact_t_s == pytest.approx(0.75) and found.net_z_m == ball.net_z_m
    assert landed.landing_t_s == pytest.approx(0.75)
    assert landed.contact_states[0, 0] == landed.landing_states[0, 0] > 0.0
    assert stopped.contact_states[0, 0] == 0.0 and np.isinf(stopped.landing_t_s), "it never comes down"
    assert np.isnan([lost.contact_t_s[0], lost.landing_t_s[0], lost.net_z_m[0]]).all()
