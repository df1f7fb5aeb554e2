"""What Tune says when a method finds no ball in a whole recording."""

from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import pytest

from app.modes.tune.nothing_found import NothingFound, SampleRequest, answer_sample, nothing_found_html
from core.config import replace_setting
from core.detection.methods import method_config
from core.metrics.sample import sample_method
from core.recordings import CameraStream, open_recording

STRICT = replace_setting(method_config("refined"), ("refined", "points_min"), 200)


@pytest.fixture(scope="module")
def stream(serve_recording: Path) -> Iterator[CameraStream]:
    with open_recording(serve_recording) as recording:
        yield recording.cameras["left"]


@pytest.fixture(scope="module")
def request_of(stream: CameraStream):
    configs = {"refined": STRICT, "fe-fusion": method_config("fe-fusion")}
    return lambda key: SampleRequest(key, stream, "refined", configs)


def test_the_most_frequent_reason_is_named_with_its_slider_and_the_method_that_finds_one(request_of) -> None:
    answer = answer_sample(request_of(1))
    assert answer.sample.found == 0 and answer.sample.windows > 200
    html = nothing_found_html(answer)
    first = answer.sample.reasons[0]
    assert first.text.split(" ")[0] in html
    assert "href='#setting-refined-" in html if first.setting else "(fixed)" in html
    assert answer.other is not None and "<b>fe-fusion</b> finds one in" in html


def test_nothing_is_said_where_a_ball_is_found_anywhere(stream: CameraStream) -> None:
    config = method_config("refined")
    answer = answer_sample(SampleRequest(1, stream, "refined", {"refined": config}))
    assert answer.sample == sample_method(stream, "refined", config)
    assert answer.sample.found > 10 and answer.other is None
    assert nothing_found_html(answer) == ""


def test_a_config_is_sampled_once_when_it_has_rested(request_of, monkeypatch) -> None:
    class Here:
        """A pool that does its work at once."""

        def submit(self, work) -> Future:
            asked.append(1)
            work()
            return Future()

    asked, shown, failed = [], [], []
    mine = NothingFound(Here(), lambda act: act(), failed.append, shown.append)  # type: ignore[arg-type]
    mine.want(request_of(1), 0.0)
    mine.tick(1.0)
    mine.want(request_of(2), 1.0)  # the slider moves on
    mine.tick(2.0)
    assert not asked
    for wall_s in (2.6, 3.0, 9.0):
        mine.want(request_of(2), wall_s)
        mine.tick(wall_s)
    assert len(asked) == 1 and not failed and "refined finds no ball" in shown[-1]
    mine.want(None, 10.0)
    assert shown[-1] == "", "a window with a ball"
    mine.want(request_of(2), 11.0)
    assert "refined finds no ball" in shown[-1] and len(asked) == 1, "it is known"
