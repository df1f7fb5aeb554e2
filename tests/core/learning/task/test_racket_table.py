"""The table of racket speeds: how fast the balls of each stage arrive, and how fast the racket meets them."""

import dataclasses

import numpy as np
import pytest

from core.learning.agents.policy import Policy
from core.learning.config import CurriculumConfig, RunConfig
from core.learning.task.environment import evaluation_balls, racket_table

pytestmark = pytest.mark.numeric
RUN = RunConfig(curriculum=CurriculumConfig(speeds_mps=(5.0, 3.0, 9.0, 5.0), episodes=(1, 1, 1, 1)))


def test_each_speed_of_the_stages_is_there_once_in_ascending_order_of_arrival() -> None:
    incoming, racket = racket_table(RUN)
    assert len(incoming) == 3 and (incoming > 0).all() and (np.diff(incoming) > 0.5).all()
    assert racket == pytest.approx([3.0, 1.0, -1.1])  # of 3, 5 and 9 m/s; see RacketSpeedConfig
    assert incoming.dtype == racket.dtype == np.float32


def test_a_policy_meets_the_balls_of_each_stage_with_its_racket_speed() -> None:
    policy = Policy((), "relu", "tanh", False, *racket_table(RUN))
    for speed, expected in ((3.0, 3.0), (5.0, 1.0), (9.0, -1.1)):
        balls = evaluation_balls(speed, 40, dataclasses.replace(RUN.environment, state_source="truth"))
        read = [policy.racket_speed_mps(state) for state in balls.states]
        assert np.mean(read) == pytest.approx(expected, abs=0.06)
