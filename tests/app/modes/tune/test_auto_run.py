"""A search for thresholds from the page: what it is given, what it answers, and what is shown."""

import dataclasses
import json
import math
from pathlib import Path

import pytest

from app import theme
from app.modes.tune.auto_run import (
    AutoTuneCancelledError,
    AutoTuneRequest,
    TuningReport,
    read_report,
    report_html,
    run_auto_tune,
    running_html,
    tune_command,
)
from core.config import replace_setting
from core.detection import DetectorConfig
from core.detection.window import EarlyEnds
from core.errors import RallyscopeError
from core.recordings import open_recording

STRICT = replace_setting(DetectorConfig(), ("geometry", "circularity_min"), 0.9)


@pytest.fixture
def request_(serve_recording: Path, tmp_path: Path) -> AutoTuneRequest:
    with open_recording(serve_recording) as recording:
        uuid = recording.uuid
    return AutoTuneRequest(
        title="serve",
        recording=serve_recording,
        uuid=uuid,
        camera="left",
        all_cameras=False,
        method="auto",
        against="truth",
        labels=tmp_path / "labels",
        parameters=("geometry.circularity_min",),
        trials=9,
        seed=0,
        start=STRICT,
        where=("--jobs", "1"),
    )


@pytest.mark.gate
def test_what_it_finds_comes_back_with_its_figures(request_: AutoTuneRequest) -> None:
    shares: list[float] = []
    lines: list[str] = []
    answer = run_auto_tune(request_, progress=shares.append, say=lines.append, cancelled=lambda: False)
    assert shares == sorted(shares) and shares[-1] == 1.0 and lines[-1].startswith("9 of 9 trials, best 0.")
    after = answer.config.geometry.circularity_min
    assert answer.report.trials == 9 and answer.report.changed == {"geometry.circularity_min": (0.9, after)}
    assert answer.report.best.tuned.objective > answer.report.start.tuned.objective
    assert dataclasses.replace(answer.config, geometry=STRICT.geometry) == STRICT


def test_a_search_in_time_is_asked_for_with_its_latency(request_: AutoTuneRequest, tmp_path: Path) -> None:
    def words(request: AutoTuneRequest) -> list[str]:
        return tune_command(request, tmp_path / "a.toml", tmp_path / "b.toml")

    assert "--streaming" not in words(request_)
    asked = words(dataclasses.replace(request_, added_us=3000))
    assert asked[asked.index("--streaming") :] == ["--streaming", "--delay-us", "3000"]
    early = words(dataclasses.replace(request_, ends=EarlyEnds(events=500, motion_px=1.5)))
    assert early[early.index("--window-events") :] == ["--window-events", "500", "--window-px", "1.5"]


def test_a_refusal_is_said_in_the_words_of_the_verb(request_: AutoTuneRequest) -> None:
    off = dataclasses.replace(request_, parameters=("hot_pixels.tick_ms",))
    nobody = dataclasses.replace(request_, against="labels")
    for wrong, says in ((off, "^hot_pixels.tick_ms does nothing"), (nobody, "this camera has no labels")):
        with pytest.raises(RallyscopeError, match=says):
            run_auto_tune(wrong, progress=lambda share: None, say=lambda line: None, cancelled=lambda: False)


def test_a_search_that_is_cancelled_is_over(request_: AutoTuneRequest) -> None:
    heard: list[str] = []
    long = dataclasses.replace(request_, trials=5000)
    with pytest.raises(AutoTuneCancelledError):
        run_auto_tune(long, progress=lambda share: None, say=heard.append, cancelled=lambda: len(heard) > 2)


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
    at = [text.index(f">{objective}<") for objective in ("0.6100", "0.9100", "0.7000", "0.7500")]
    assert at == sorted(at)
    assert "geometry.solidity_min" in text and "as it was" in text and "serve &lt;1&gt;" in text


def test_what_was_changed_comes_first_then_what_counts_most() -> None:
    shares = {"roi.roi_expand_px": 0.5, "denoise.kernel_px": 0.3, "cluster.eps_px": 0.2}
    text = shown(read_report(said(importance=shares)))
    assert text.index("cluster.eps_px") < text.index("roi.roi_expand_px") < text.index("denoise.kernel_px")


def test_it_says_whether_the_result_holds_where_nothing_was_tuned() -> None:
    assert "also better on the held-out windows" in shown(read_report(said()))
    assert "not better on the held-out windows (0.7000 before, 0.6500 now)" in shown(read_report(said(held_out=0.65)))
    assert "No better config was found" in shown(read_report(said(best_trial=0)))


def test_what_has_no_number_is_a_dash_and_what_was_changed_is_escaped() -> None:
    nothing = {"tuned": figures(-0.16, median_error_px=None, precision=None), "held_out": figures(0.7)}
    report = read_report(said(start=nothing, importance={}))
    assert math.isnan(report.start.tuned.median_error_px) and report.start.tuned.balls == 99
    assert ">-<" in shown(report) and "&lt;b&gt;" in shown(report) and "<b>" not in shown(report)


@pytest.mark.parametrize("line", ["", "{}", "[1]", "12 of 64 trials", '{"importance": 1'])
def test_what_is_no_report_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match=r".*"):
        read_report(line)


def test_a_share_that_is_not_whole_never_reads_1() -> None:
    almost = {side: figures(0.997, precision=2183 / 2184, recall=1.0) for side in ("tuned", "held_out")}
    text = shown(read_report(said(best=almost)))
    assert "0.999" in text and text.count("1.000") == 2, "the two recalls"


def test_what_reads_alike_on_the_held_out_windows_is_not_called_better() -> None:
    before = {"tuned": figures(0.9), "held_out": figures(0.9970, balls=2184)}
    for after, words in ((0.9971, "No measurable difference"), (0.9985, "B is also better"), (0.99, "B is not better")):
        best = {"tuned": figures(0.95), "held_out": figures(after, balls=2184)}
        text = shown(read_report(said(start=before, best=best, better_held_out=after > 0.997)))
        assert f"{words} on the held-out windows (0.9970 before, {after:.4f} now)" in text
        assert (theme.GOOD in text) is (after == 0.9985)


def test_a_result_names_its_method_and_says_what_importance_means() -> None:
    assert "Result of serve &lt;1&gt;" in shown(read_report(said()))
    assert "changed in B or not" in shown(read_report(said()))
    assert "changed in B or not" not in shown(read_report(said(importance={})))


def test_a_running_search_is_shown_before_its_first_trial() -> None:
    assert "Auto-tune runs: refined, &lt;a&gt;: reading the recording" in running_html("refined, <a>")
    assert "trial 2 of 9" in running_html("refined", "trial 2 of 9")
