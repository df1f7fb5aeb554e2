"""A search as a child process of the app."""

import dataclasses
from pathlib import Path

import pytest

from app.modes.tune.auto.run import AutoTuneCancelledError, AutoTuneRequest, run_auto_tune
from core.config import replace_setting
from core.detection import DetectorConfig
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


def test_what_it_finds_comes_back_with_its_figures(request_: AutoTuneRequest) -> None:
    shares: list[float] = []
    lines: list[str] = []
    answer = run_auto_tune(request_, progress=shares.append, say=lines.append, cancelled=lambda: False)
    assert shares == sorted(shares) and shares[-1] == 1.0 and lines[-1].startswith("9 of 9 trials, best 0.")
    after = answer.config.geometry.circularity_min
    assert answer.report.trials == 9 and answer.report.changed == {"geometry.circularity_min": (0.9, after)}
    assert answer.report.best.tuned.objective > answer.report.start.tuned.objective
    assert dataclasses.replace(answer.config, geometry=STRICT.geometry) == STRICT


def test_a_refusal_is_said_in_the_words_of_the_verb(request_: AutoTuneRequest) -> None:
    off = dataclasses.replace(request_, parameters=("hot_pixels.tick_ms",))
    nobody = dataclasses.replace(request_, against="labels")
    for wrong, says in ((off, "^hot_pixels.tick_ms does nothing"), (nobody, "nobody has labelled this camera")):
        with pytest.raises(RallyscopeError, match=says):
            run_auto_tune(wrong, progress=lambda share: None, say=lambda line: None, cancelled=lambda: False)


def test_a_search_that_is_cancelled_is_over(request_: AutoTuneRequest) -> None:
    heard: list[str] = []
    long = dataclasses.replace(request_, trials=5000)
    with pytest.raises(AutoTuneCancelledError):
        run_auto_tune(long, progress=lambda share: None, say=heard.append, cancelled=lambda: len(heard) > 2)
