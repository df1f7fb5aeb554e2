"""Many drawn balls with measured noise: judged as the simulation tells, and with an honest covariance."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.rally.bench_outcomes import TrackNoise, draw_ball, judge_points
from core.learning.config import environment_profile
from core.outcomes import OutcomeClassifier
from core.physics.config import Profile
from core.physics.episode import Case

pytestmark = pytest.mark.numeric
BALLS = 40


@pytest.mark.parametrize(
    ("physics", "noise"),
    [
        ("paper", TrackNoise()),
        ("real", TrackNoise()),
        ("real", TrackNoise(lost=0.4, strays=0.02)),
    ],
    ids=["paper", "real", "real, with gaps and strays"],
)
def test_drawn_balls_are_judged_as_they_went(physics: Profile, noise: TrackNoise) -> None:
    rng = np.random.default_rng(771)
    environment = environment_profile(physics, state_source="truth")
    right, errors, squares, cases = 0, [], [], set()
    for _ in range(BALLS):
        ball = draw_ball(environment, rng, noise=noise)
        judged = judge_points(ball, OutcomeClassifier())
        assert judged is not None
        right += judged.case is ball.case
        cases.add(ball.case)
        if judged.case is ball.case and judged.points:
            off = judged.landing_m[:2] - ball.outcome.landings_m[0]
            errors.append(float(np.linalg.norm(off)))
            squares.append(float(off @ np.linalg.solve(judged.landing_covariance_m2, off)) / 2)
    assert len(cases) >= 4, "too few kinds of outcomes to say anything"
    assert right >= BALLS - 2
    assert np.median(errors) < 0.02
    assert 0.1 < np.mean(squares) < 1.5


def test_ten_times_the_noise_is_noticed() -> None:
    rng = np.random.default_rng(5)
    environment = environment_profile("paper", state_source="truth")
    loud = TrackNoise(noise_mm=(1.0, 2.0, 1.5), drift_mm=(0.5, 0.5, 0.5))
    sigmas, off_m = [], []
    for _ in range(15):
        ball = draw_ball(environment, rng, noise=loud, missed=0.0)
        judged = judge_points(ball, OutcomeClassifier())
        assert judged is not None
        if judged.case is ball.case and judged.case is Case.RETURNED:
            sigmas.append(float(np.sqrt(np.trace(judged.landing_covariance_m2))))
            off_m.append(float(np.linalg.norm(judged.landing_m[:2] - ball.outcome.landings_m[0])))
    assert len(sigmas) >= 3 and np.median(off_m) < 0.02
    assert np.mean(np.array(off_m) < 3 * np.array(sigmas)) > 0.7
