"""The report of a search as Tune shows it."""

import json
import math

import pytest

from app.modes.tune.auto.report import TuningReport, read_report, report_html


def figures(objective: float, **other: object) -> dict[str, object]:
    return {"precision": 0.9, "recall": 0.8, "median_error_px": 1.25, "objective": objective, "balls": 99, **other}


def said(*, best_trial: int = 7, held_out: float = 0.75, **other: object) -> str:
    report = {
        "start": {"tuned": figures(0.61), "held_out": figures(0.7)},
        "best": {"tuned": figures(0.91), "held_out": figures(held_out)},
        "best_trial": best_trial,
        "better_held_out": held_out > 0.7,
        "trials": 64,
        "changed": {"cluster.eps_px": [3.0, 2.5], "polarity.leading_polarity": ["auto", "<b>"]},
        "importance": {"cluster.eps_px": 0.75, "geometry.solidity_min": 0.25},
    }
    return json.dumps(report | other)


def shown(report: TuningReport) -> str:
    return report_html("serve <1>", report)


def test_both_sides_stand_below_each_other_with_what_was_changed() -> None:
    text = shown(read_report(said()))
    for words in (
        "tuned on",
        "held out",
        "0.900",
        "1.25 px",
        "cluster.eps_px",
        "<td style",
        "2.5",
        "75 %",
        "64 trials",
    ):
        assert words in text
    assert text.index("0.610") < text.index("0.910") < text.index("0.700") < text.index("0.750")
    assert "geometry.solidity_min" in text and "as it was" in text and "serve &lt;1&gt;" in text


def test_what_was_changed_comes_first_then_what_counts_most() -> None:
    shares = {"roi.roi_expand_px": 0.5, "denoise.kernel_px": 0.3, "cluster.eps_px": 0.2}
    text = shown(read_report(said(importance=shares)))
    assert text.index("cluster.eps_px") < text.index("roi.roi_expand_px") < text.index("denoise.kernel_px")


def test_it_says_whether_the_result_holds_where_nothing_was_tuned() -> None:
    assert "better on the held-out windows, too" in shown(read_report(said()))
    assert "not better on the held-out windows (0.700 before, 0.650 now)" in shown(read_report(said(held_out=0.65)))
    assert "Nothing better was found" in shown(read_report(said(best_trial=0)))


def test_what_has_no_number_is_a_dash_and_what_was_changed_is_escaped() -> None:
    nothing = {"tuned": figures(-0.16, median_error_px=None, precision=None), "held_out": figures(0.7)}
    report = read_report(said(start=nothing, importance={}))
    assert math.isnan(report.start.tuned.median_error_px) and report.start.tuned.balls == 99
    assert ">-<" in shown(report) and "&lt;b&gt;" in shown(report) and "<b>" not in shown(report)


@pytest.mark.parametrize("line", ["", "{}", "[1]", "12 of 64 trials", '{"importance": 1'])
def test_what_is_no_report_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match=r".*"):
        read_report(line)
