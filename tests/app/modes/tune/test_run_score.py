"""The score of a config over a recording."""

from dataclasses import replace
from pathlib import Path

import pytest

from app.modes.tune.compare_run import CompareRequest, comparison_html, run_comparison
from app.modes.tune.run_score import run_score_row, run_scores_html, score_run
from app.state.client_state import Slot
from app.state.config_words import config_words
from core.config import replace_setting
from core.detection import DetectorConfig
from core.detection.methods import method_config
from core.detection.window import WHOLE, EarlyEnds
from core.metrics import known_truth
from core.metrics.streaming import asked_times
from core.recordings import CameraStream, open_recording


def request_of(stream: CameraStream, labels: Path, config: DetectorConfig, slot: Slot) -> CompareRequest:
    """Compares `auto` over the whole recording with the truth."""
    return CompareRequest(
        recording="serve",
        uuid="u",
        stream=stream,
        configs=(("auto", config),),
        slot=slot,
        agree_with=None,
        labels=labels,
        start_us=0,
        end_us=10_000_000,
        live=False,
    )


def test_score_and_compare_count_alike_and_name_the_same_config(serve_recording: Path, tmp_path: Path) -> None:
    config = replace_setting(method_config("auto"), ("localise", "radius_max_px"), 8.5)
    with open_recording(serve_recording) as recording:
        stream = recording.cameras["left"]
        score = score_run(
            stream, known_truth(stream), "auto", config, progress=lambda share: None, cancelled=lambda: False
        )
        request = request_of(stream, tmp_path, config, "B")
        answer = run_comparison(request, progress=lambda share: None, cancelled=lambda: False)
        (compared,) = answer.methods
        assert 0.05 < compared.judged.recall < 0.95, "some balls are larger than the config allows"
        assert score.judged.recall == compared.judged.recall
        assert score.judged.precision == compared.judged.precision
        assert score.judged.error_at(95) == compared.judged.error_at(95)
        title = config_words("auto", "B", config)
        assert title == "auto, config B (localise.radius_max_px 8.5)"
        assert score.judged.delay_us == compared.judged.delay_us != 0
        assert compared.judged.in_time is not None
        assert score.timed.in_time(0.0, asked_times(score.timed.answers)).fresh == pytest.approx(
            compared.judged.in_time.fresh, abs=0.05
        )
        row = run_score_row(title, score, added_us=0.0)
        assert f"{score.judged.delay_us} us" in row
        assert f"{compared.judged.recall:.3f}" in row and f"{score.judged.precision:.3f}" in row
        assert score.recall_in_time(0.0) > score.recall_in_time(200_000.0), "an answer 0.2 s late is of no use"
        assert "Judged against the simulation's truth, as in Compare over time." in run_scores_html([row])
        table = comparison_html(answer)
        assert "B: localise.radius_max_px 8.5" in table and f"{compared.judged.recall:.3f}" in table


def test_windows_that_end_early_are_scored_and_compared_alike_and_named(serve_recording: Path, tmp_path: Path) -> None:
    ends = EarlyEnds(motion_px=3.0)
    with open_recording(serve_recording) as recording:
        stream = recording.cameras["left"]
        config = method_config("auto")
        quiet = {"progress": lambda share: None, "cancelled": lambda: False}
        usual, early = (
            score_run(stream, known_truth(stream), "auto", config, ends=one, **quiet) for one in (WHOLE, ends)
        )
        assert len(early.timed.answers.end_us) > len(usual.timed.answers.end_us)
        request = replace(request_of(stream, tmp_path, config, "A"), ends=ends)
        answer = run_comparison(request, **quiet)
    (compared,) = answer.methods
    assert compared.judged.recall == early.judged.recall and compared.judged.precision == early.judged.precision
    assert answer.title.endswith(", windows end after 3 px of motion")


@pytest.mark.parametrize("method", ["auto", "refined", "ebpp"])
def test_a_config_as_it_is_at_first_has_default_settings(method: str) -> None:
    assert config_words(method, "A", method_config(method)) == f"{method}, config A (default settings)"
