"""Named runs: what is the paper's stays so under its name, and ours plays as many balls."""

from core.learning.config import RunConfig, default_run
from core.learning.runs.named_runs import NAMED_RUNS


def test_the_paper_s_run_is_the_default_one() -> None:
    assert NAMED_RUNS["paper"] == default_run() == RunConfig()


def test_placing_trains_as_many_balls_at_the_last_speed_only() -> None:
    placing = NAMED_RUNS["placing"]
    assert placing.episodes == RunConfig().episodes and placing.curriculum.speeds_mps == (5.0,)
