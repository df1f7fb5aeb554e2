"""The task with nothing but events: every way to the truth is barred, and what is judged agrees with it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from core.learning.config import CurriculumConfig, EnvironmentConfig, default_run
from core.learning.evaluation.policy_evaluator import PolicyEvaluator
from core.learning.runs.training import Training
from core.learning.task.environment import ServeBatch, evaluation_balls, play
from core.live.worlds.simulated_backend import SimulatedBackend
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.outcomes.perceived_backend import PerceivedBackend
from core.physics.episode import Case, Outcomes
from core.simulation import SceneConfig, StereoConfig

pytestmark = pytest.mark.numeric
EVENTS = EnvironmentConfig(state_source="events", outcomes="events")
STROKES = np.array([[0.0, 0.0, 0.0], [0.3, -0.6, 0.5], [0.0, 0.9, -0.4]])


def without_arrivals(balls: ServeBatch) -> ServeBatch:
    """What a ball machine is told, and not how the balls will fly."""
    nowhere = dataclasses.replace(
        balls.arrivals,
        bounce_t_s=np.full(len(balls), np.nan),
        bounce_states=np.full((len(balls), 9), np.nan),
        t_s=np.full(len(balls), np.nan),
        states=np.full((len(balls), 9), np.nan),
    )
    return dataclasses.replace(balls, arrivals=nowhere, racket_speeds_mps=np.full(len(balls), np.nan))


@pytest.fixture(scope="module")
def backend() -> Iterator[PerceivedBackend]:
    """Of a world that tells nothing: asking it for anything but events fails."""

    def forbidden(*_: object) -> object:
        raise AssertionError("the truth was asked for")

    real_advance = SimulatedWorld.advance

    def blind_advance(world: SimulatedWorld) -> SimpleNamespace:
        block = real_advance(world)
        return SimpleNamespace(start_us=block.start_us, end_us=block.end_us, events=block.events)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SimulatedWorld, "advance", blind_advance)
        for name in ("ball_is_visible", "bodies", "readout"):
            patch.setattr(SimulatedWorld, name, property(forbidden))
        backend = PerceivedBackend(EVENTS, SimulatedBackend(EVENTS.task))
        yield backend
        backend.close()


@pytest.fixture(scope="module")
def played(backend: PerceivedBackend) -> list[tuple[ServeBatch, Outcomes, float]]:
    """Three balls at 5 m/s with a stroke each, and when the machine served them, from when that was seen."""
    balls = without_arrivals(evaluation_balls(5.0, len(STROKES), EVENTS))
    found = []
    for i, action in enumerate(STROKES):
        ball = backend.observe(balls[i : i + 1])
        outcome = backend.play(ball, action[None])
        assert backend.serve_seen is not None
        found.append((ball, outcome, (backend.served_us - backend.serve_seen.t_us) * 1e-6))
    return found


def test_what_is_judged_is_what_the_closed_form_says(played: list[tuple[ServeBatch, Outcomes, float]]) -> None:
    truth = evaluation_balls(5.0, len(STROKES), EVENTS)
    cases = set()
    for i, (ball, outcome, early_s) in enumerate(played):
        assert ball.seen[0] and ball.aim_t_s is not None
        told = dataclasses.replace(ball, arrivals=truth[i : i + 1].arrivals, aim_t_s=ball.aim_t_s - early_s)
        expected = play(told, STROKES[i : i + 1], EVENTS)
        assert outcome.case[0] == expected.case[0]
        cases.add(int(outcome.case[0]))
        np.testing.assert_allclose(outcome.landings_m, expected.landings_m, atol=0.02)
        np.testing.assert_allclose(outcome.net_z_m, expected.net_z_m, atol=0.01)
        np.testing.assert_allclose(outcome.hit_t_s - early_s, expected.hit_t_s, atol=0.002)
        assert (outcome.landings_m != expected.landings_m).all(), "the truth itself was given"
    assert len(cases) > 1, "all strokes alike show little"


def test_speed_and_instant_of_the_serve_are_seen_and_set_the_racket_s_speed(
    backend: PerceivedBackend, played: list[tuple[ServeBatch, Outcomes, float]]
) -> None:
    for ball, _, early_s in played:
        assert -0.1 < early_s < 0, "it is seen within a tenth of a second, and not before"
        expected = EVENTS.task.stroke.racket_speed.at(5.0)
        assert ball.racket_speeds_mps[0] == pytest.approx(expected, rel=0.05)
    assert backend.serve_seen is not None
    assert backend.serve_seen.speed_mps == pytest.approx(5.0, rel=0.08)


def test_a_policy_is_trained_and_evaluated_without_the_truth(backend: PerceivedBackend) -> None:
    curriculum = CurriculumConfig(speeds_mps=(4.0,), episodes=(2,), replay="retain")
    config = dataclasses.replace(default_run("ddpg"), environment=EVENTS, curriculum=curriculum)
    training = Training(config, 3, backend)
    lines = [training.play_episode() for _ in range(2)]
    assert training.finished and lines[-1]["buffer"] == 2
    for line in lines:
        assert line["case"] in set(Case) and np.isfinite(float(str(line["reward"])))
    assert backend.judged is not None and backend.judged.points > 0
    score = PolicyEvaluator(EVENTS, 1, backend).score(training.policy, 4.0)
    assert score.errors_mm.shape == (1,) and np.isfinite(score.counted_mm).all()


def test_a_ball_that_nobody_sees_is_missed() -> None:
    dark = SceneConfig(ball=0.12, table=0.12, line=0.12, floor=0.12, wall=0.12, net=0.12, ambient=1.0, shadow=0.0)
    world_backend = SimulatedBackend(EVENTS.task, world=WorldConfig(stereo=StereoConfig(scene=dark)))
    backend = PerceivedBackend(EVENTS, world_backend)
    try:
        ball = backend.observe(evaluation_balls(9.0, 1, EVENTS))
        assert not ball.seen[0]
        assert backend.play(ball, np.zeros((1, 3))).case[0] == Case.MISSED
        assert backend.judged is not None and backend.judged.probability < 0.9
    finally:
        backend.close()
