"""Strokes of a source that tells no outcomes, judged while it is watched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.rally.bench_outcomes import NoisyBall, draw_ball
from core.chain.chain import BallPoint, ChainState, StageSeconds
from core.history.following import Following
from core.history.rally_history import RallyHistory
from core.history.seen_outcomes import SeenOutcomes
from core.learning.config import environment_profile
from core.physics.episode import Case
from core.recordings import open_recording
from core.simulation.episodes.ball_outcome import BallOutcome
from tests.waiting import eventually

pytestmark = pytest.mark.numeric
Array = NDArray[np.float64]


def steps_of(ball: NoisyBall, start_us: int) -> list[ChainState]:
    """Every point as the chain would tell it, and half a second of nothing."""
    points, found = ball.points, []
    for k, t_s in enumerate(points.t_s):
        t_us = start_us + round(1e6 * t_s)
        point = BallPoint(t_us, points.ps_m[k], 0.1, points.covariances_m2[k], {})
        verdict = "new flight" if k == 0 else "same flight"
        found.append(ChainState(t_us, {}, point, verdict, None, False, (), StageSeconds(0, 0, 0)))
    last_us = found[-1].t_us
    quiet = range(last_us + 2000, last_us + 500_000, 2000)
    return [*found, *(ChainState(t, {}, None, None, None, False, (), StageSeconds(0, 0, 0)) for t in quiet)]


def test_strokes_are_counted_as_they_went_and_balls_that_nobody_struck_are_not() -> None:
    rng, environment = np.random.default_rng(8), environment_profile(state_source="truth")
    balls = [draw_ball(environment, rng, missed=share) for share in (0.0, 1.0, 0.0, 0.0)]
    history = RallyHistory()
    seen = SeenOutcomes(history)
    try:
        struck, start_us = 0, 0
        for ball in balls:
            steps = steps_of(ball, start_us)
            for step in steps:
                seen.add_step(step)
            start_us = steps[-1].t_us + 100_000
            struck += ball.case is not Case.MISSED
            eventually(lambda struck=struck: history.outcome_count == struck, "the stroke to be judged")
    finally:
        seen.close()
    told = [ball for ball in balls if ball.case is not Case.MISSED]
    found = history.outcomes_between(-1, start_us)
    assert len(found) == 3 and [one.spot.case for one in found] == [ball.case for ball in told]
    for one, ball in zip(found, told, strict=True):
        assert abs(one.speed_mps - ball.speed_mps) < 0.3
        np.testing.assert_allclose([one.spot.x_m, one.spot.y_m], ball.outcome.landings_m[0], atol=0.01)


def test_a_session_that_begins_anew_forgets_the_ball_that_flew() -> None:
    rng, environment = np.random.default_rng(3), environment_profile(state_source="truth")
    first, second = (draw_ball(environment, rng, missed=0.0) for _ in range(2))
    history = RallyHistory()
    seen = SeenOutcomes(history)
    try:
        for step in steps_of(first, 0)[:150]:
            seen.add_step(step)
        seen.begin_anew()
        for step in steps_of(second, 0):
            seen.add_step(step)
        eventually(lambda: history.outcome_count > 0, "the stroke to be judged")
    finally:
        seen.close()
    (only,) = history.outcomes_between(-1, 10**9)
    assert only.spot.case == second.case


def test_a_recording_that_tells_nothing_is_followed_and_its_stroke_judged(
    stroke_recording: tuple[Path, BallOutcome],
) -> None:
    path, told = stroke_recording
    with open_recording(path) as recording:
        following = Following(recording)
        following.wait()
    (seen,) = following.history.outcomes_between(-1, 10**9)
    assert seen.spot.case == told.case
    np.testing.assert_allclose([seen.spot.x_m, seen.spot.y_m], told.landing_m[:2], atol=0.02)
    assert abs(seen.speed_mps - 6.0) < 0.4 and 0 < seen.serve_us < 200_000
