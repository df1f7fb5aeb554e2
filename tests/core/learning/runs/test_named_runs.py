"""Named runs: what is the paper's stays so under its name, and ours plays as many balls."""

import dataclasses

from core.learning.config import DdpgConfig, RunConfig, default_run
from core.learning.runs.named_runs import NAMED_RUNS


def test_the_paper_s_run_is_the_default_one() -> None:
    assert NAMED_RUNS["paper"] == default_run() == RunConfig()


def test_placing_trains_as_many_balls_at_the_last_speed_only() -> None:
    placing = NAMED_RUNS["placing"]
    assert placing.episodes == RunConfig().episodes and placing.curriculum.speeds_mps == (5.0,)


def test_steady_keeps_the_paper_s_rules_and_changes_how_it_learns() -> None:
    assert dataclasses.replace(NAMED_RUNS["steady"], ddpg=DdpgConfig()) == RunConfig()
