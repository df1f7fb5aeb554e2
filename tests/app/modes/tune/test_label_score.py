"""The table of a score against labels."""

import math

import numpy as np

from app.modes.tune.label_score import LabelScore, label_score_html
from labels.score import GroupScore, ScoreAt
from labels.score_picture import TOLERANCES, ScoreCurves

NONE = math.nan


def test_a_detector_that_answers_nothing_has_dashes_for_its_errors() -> None:
    at = tuple(ScoreAt(px, NONE, 0.0, 0.0) for px in (1.0, 2.0, 4.0, 8.0))
    group = GroupScore("all", 3, 3, at, NONE, NONE, NONE, NONE, NONE)
    curves = ScoreCurves(np.full(len(TOLERANCES), NONE), np.zeros(len(TOLERANCES)), np.zeros((0, 2)))
    html = label_score_html("serve", LabelScore("anna", 3, (group,), curves, (group, group), None))
    table = html[html.index("<table>") : html.index("</table>")]
    assert "nan" not in table and table.count("- / 0.000") == 3 * 4 and table.count(">-</td>") == 3 * 4
