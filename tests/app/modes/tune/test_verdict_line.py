"""The verdicts of a score are shown beside the camera, method and config that they are of, and nowhere else."""

from dataclasses import replace

import numpy as np

from app.modes.tune.verdict_line import NO_RUNS, ScoredConfig, VerdictLine
from app.panels.time_bar import Runs
from core.config import replace_setting
from core.detection.methods import method_config

SCORED = ScoredConfig("left", "refined", method_config("refined"))
RUNS = Runs(np.array([0]), np.array([1000]), ("missed",))


def make_line() -> tuple[VerdictLine, list[Runs]]:
    shown: list[Runs] = []
    line = VerdictLine(shown.append)
    line.keep(SCORED, RUNS)
    return line, shown


def test_verdicts_are_shown_beside_what_was_scored_only() -> None:
    line, shown = make_line()
    other = replace_setting(SCORED.config, ("refined", "radius_max_px"), 8.0)
    for seen in (SCORED, replace(SCORED, camera="right"), SCORED, replace(SCORED, config=other), SCORED, None):
        line.follow(seen)
    assert shown == [RUNS, NO_RUNS] * 3


def test_verdicts_are_sent_once_while_nothing_changes() -> None:
    line, shown = make_line()
    line.follow(SCORED)
    line.follow(replace(SCORED))
    assert shown == [RUNS]


def test_another_recording_has_no_verdicts() -> None:
    line, shown = make_line()
    line.follow(SCORED)
    line.forget()
    line.follow(SCORED)
    assert shown == [RUNS]
