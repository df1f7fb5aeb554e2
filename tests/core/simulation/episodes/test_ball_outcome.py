"""The umpire: each sequence of events has one verdict."""

from __future__ import annotations

import numpy as np
import pytest

from core.physics.episode import Case
from core.physics.task import TaskConfig
from core.simulation.episodes.ball_outcome import RallyClassifier, RallyEvent, RallyEventKind

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
