"""Balls that are observed and played one at a time, wherever that is."""

import dataclasses

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.config import CurriculumConfig, EnvironmentConfig, RunConfig, default_run
from core.learning.evaluation.policy_evaluator import PolicyEvaluator, score_played
from core.learning.runs.training import Training
from core.learning.task.environment import ClosedFormBackend, ServeBatch, evaluation_balls, observe_all, play
from core.physics.episode import Case, Outcomes

pytestmark = pytest.mark.numeric
PREDICTED = EnvironmentConfig()
EVENTS = EnvironmentConfig(state_source="events")
SHIFT_M = 0.01


class BiasedBackend:
    """Cameras that see every ball a centimetre to the left, and every third one not at all."""

    def __init__(self) -> None:
        self.begun: list[int] = []
        self.observed = 0

    def begin(self, seed: int) -> None:
        self.begun.append(seed)

    def observe(self, batch: ServeBatch) -> ServeBatch:
        self.observed += 1
        seen = self.observed % 3 != 0
        states = batch.arrivals.observations + np.array([0, SHIFT_M, 0, 0, 0, 0])
        aim_p, aim_t = (states[:, :3], batch.arrivals.t_s) if seen else (np.full((1, 3), np.nan), np.full(1, np.nan))
        return dataclasses.replace(
            batch, seen=np.array([seen]), states=states if seen else 0 * states, aim_ps_m=aim_p, aim_t_s=aim_t
        )

    def play(self, batch: ServeBatch, action: np.ndarray) -> Outcomes:
        return play(batch, action, EVENTS)

    def close(self) -> None:
        pass


def middle(states: np.ndarray, racket_speeds_mps: np.ndarray, goals_m: np.ndarray) -> np.ndarray:
    """No turn of the racket."""
    return np.zeros((len(states), 3))


def test_the_closed_form_has_no_event_cameras_and_says_who_has() -> None:
    with pytest.raises(ConfigError, match="event_environment"):
        ClosedFormBackend(EVENTS)
    with pytest.raises(ConfigError, match="event cameras"):
        Training(RunConfig(environment=EVENTS), 0)


def test_one_ball_after_another_scores_as_all_at_once() -> None:
    balls = evaluation_balls(5.0, 30, PREDICTED)
    together = PolicyEvaluator(PREDICTED, 30).score(middle, 5.0)
    shares: list[float] = []
    one_by_one = score_played(ClosedFormBackend(PREDICTED), middle, balls, shares.append)
    np.testing.assert_array_equal(one_by_one.returned, together.returned)
    np.testing.assert_array_equal(one_by_one.errors_mm, together.errors_mm)
    assert shares[-1] == 1 and len(shares) == 30


def test_balls_met_one_by_one_can_be_played_together() -> None:
    drawn = evaluation_balls(5.0, 9, EVENTS)
    assert not drawn.seen.any()
    observed = observe_all(BiasedBackend(), drawn)
    np.testing.assert_array_equal(observed.seen, [True, True, False] * 3)
    np.testing.assert_allclose((observed.states - drawn.arrivals.observations)[observed.seen, 1], SHIFT_M)
    outcomes = play(observed, np.zeros((9, 3)), EVENTS)
    np.testing.assert_array_equal(outcomes.case == Case.MISSED, ~observed.seen)


def test_a_training_learns_from_what_its_court_saw() -> None:
    backend = BiasedBackend()
    curriculum = CurriculumConfig(speeds_mps=(5.0,), episodes=(9,), replay="retain")
    training = Training(
        dataclasses.replace(default_run("landing-model"), environment=EVENTS, curriculum=curriculum), 4, backend
    )
    lines = [training.play_episode() for _ in range(9)]
    assert backend.begun == [4] and backend.observed == 9
    assert [line["case"] == Case.MISSED for line in lines] == [False, False, True] * 3
    assert lines[-1]["buffer"] == 6  # what was never seen teaches nothing
