"""What Tune says of one window, and of the stages that led to it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from app.modes.tune.candidates import ComparedTrace, candidates_html, compared_html, side_by_side_html
from app.modes.tune.settings import count_html
from core.detection.method_trace import CandidateRow, MethodTrace, StageCount, View
from core.detection.reasons import Reason


def make_trace(rows: int) -> MethodTrace:
    row = CandidateRow(0, ("7",), (), "ball", 1.0, np.zeros(1), np.zeros(1))
    return MethodTrace(
        views=(View("result", "result", None),),
        counts={},
        noun="fit",
        titles=("points",),
        candidates=(row,) * rows,
        detection=None,
        reasons=(),
    )


@pytest.mark.parametrize(("rows", "tables"), [(0, 0), (2, 1)])
def test_a_table_has_a_head_only_above_rows(rows: int, tables: int) -> None:
    html = candidates_html(make_trace(rows))
    assert html.count("<th") == tables * 4 and html.count("<table") == tables
    assert f"{rows} fits" in html


def test_figures_have_a_gap_and_stay_on_one_line() -> None:
    html = candidates_html(make_trace(1))
    cells = re.findall(r"<t[dh] style='([^']*)'", html)
    assert cells and all("padding:0 10px 0 0" in style and "white-space:nowrap" in style for style in cells)


def test_the_verdict_stands_before_the_figures() -> None:
    html = candidates_html(make_trace(1))
    assert html.index("verdict") < html.index("points") and html.rindex(">ball<") < html.index(">7<")


def rejected_html(reasons: int) -> str:
    reason = Reason("coverage of one edge 0.125 < 0.25", "edge coverage min")
    trace = make_trace(1)
    row = replace(trace.candidates[0], reasons=(reason,) * reasons)
    return candidates_html(replace(trace, candidates=(row,)))


def test_many_reasons_stand_below_the_figures_and_leave_the_columns_in_sight() -> None:
    one, many = rejected_html(1), rejected_html(6)
    assert one.count("<tr") == 2 and "colspan" not in one
    assert many.count("<tr") == 3 and many.count("<a href") == 6
    assert many.index(">no ball<") < many.index(">7<") < many.index("colspan='3'") < many.index("<a href")


def test_two_configs_share_a_table_whose_rows_alternate_and_need_no_second_width() -> None:
    html = compared_html([ComparedTrace("Config A", make_trace(2)), ComparedTrace("Config B", make_trace(1))])
    assert html.count("<table") == 1 and html.count(">config</th>") == 1
    assert re.findall(r"<tr><td style='[^']*'>(\w)</td>", html) == ["A", "B", "A"]
    assert html.index("Config A:") < html.index("Config B:") < html.index("<table")
    assert (
        compared_html([ComparedTrace("Config A", make_trace(0)), ComparedTrace("Config B", make_trace(0))]).count(
            "no ball"
        )
        == 2
    ), "without candidates each still says what it answers"


def test_two_answers_stand_side_by_side_and_do_not_overlap_where_they_wrap() -> None:
    html = side_by_side_html(["<b>A</b>", "<b>B</b>"])
    assert "flex-wrap:wrap;row-gap:8px" in html and html.count("<div style='flex:1 1 ") == 2


def test_a_single_candidate_is_a_row_and_needs_no_count() -> None:
    html = candidates_html(make_trace(1))
    assert "1 fit" not in html and "<th" in html


@pytest.mark.parametrize(
    ("count", "text"),
    [
        (StageCount(1, 3, unit="edge points", unit_in="attempts"), "1 attempt &rarr; <b>3</b> edge points"),
        (StageCount(2, 3, unit="edge points", unit_in="attempts"), "2 attempts &rarr;"),
        (StageCount(1, 1, unit="ball", unit_in="confirmed"), "1 confirmed &rarr;"),
        (StageCount(9192, 0, unit_in="blobs", not_run="not searched: a ball is tracked"), "not searched: a ball is"),
    ],
)
def test_a_stage_counts_in_words_that_fit_the_number(count: StageCount, text: str) -> None:
    assert text in count_html(count)


def test_a_stage_that_was_not_run_has_no_numbers() -> None:
    assert "9192" not in count_html(StageCount(9192, 0, not_run="not searched: a ball is tracked"))
