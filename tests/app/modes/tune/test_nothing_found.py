"""What Tune says when a method finds no ball in a whole recording."""

from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.modes.tune.nothing_found import NothingFound, SampleRequest, answer_sample, nothing_found_html
from core.cameras import stereo_preset
from core.config import replace_setting
from core.detection.methods import method_config
from core.detection.saved import RIMLESS, load_detector
from core.events import Events, SensorSize
from core.live.link import messages as m
from core.live.ring_recording import LiveConfig, RingRecording
from core.metrics.run import sample_method
from core.recordings import CameraStream, open_recording
from core.recordings.recording import FrozenCamera, Triggers
from tests.drawn_glow import DURATION_US, draw_glow

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


def camera_of(events: Events) -> FrozenCamera:
    counts = np.bincount(events.t_us // 1000, minlength=DURATION_US // 1000)
    none = Triggers(np.zeros(0, np.int64), np.zeros(0, bool), np.zeros(0, np.int16))
    return FrozenCamera("camera", events.sensor, None, None, none, events, counts)


def test_where_only_the_settings_for_a_ball_without_a_rim_find_one_they_are_offered(monkeypatch) -> None:
    glow, sampled = camera_of(draw_glow(bright=True)), []
    monkeypatch.setattr("core.metrics.run.sample_method", lambda *args: sampled.append(args[2]) or sample_method(*args))
    answer = answer_sample(SampleRequest(1, glow, "refined", {"refined": method_config("refined")}))
    assert answer.sample.found == 0 and answer.rimless is not None and answer.rimless.share > 0.5
    assert "<b>refined</b> with the settings for a ball without a rim: " in nothing_found_html(answer)
    assert sampled == [load_detector(RIMLESS).config], "the defaults have just been sampled"
    again = answer_sample(SampleRequest(2, glow, "refined", {"refined": load_detector(RIMLESS).config}))
    assert again.sample.share == answer.rimless.share and nothing_found_html(again) == "", "when they are used"


def test_no_other_settings_are_offered_where_the_defaults_find_a_ball(request_of) -> None:
    answer = answer_sample(request_of(3))
    assert answer.sample.found == 0 and answer.rimless is None
    assert "without a rim" not in nothing_found_html(answer)


@pytest.fixture(scope="module")
def live() -> RingRecording:
    """Six seconds of a live source that sees noise; five are kept and a bit."""
    rng, sensor = np.random.default_rng(3), SensorSize(64, 48)
    camera = m.CameraInfo.of("left", stereo_preset("side", sensor)["left"])
    ring = RingRecording(LiveConfig(seconds=5.5))
    ring.on_session(m.Reply(id=1, ok=True, session="one", t_us=0, block_us=10_000, seed=0, cameras=(camera,)))
    for start_us in range(0, 6_000_000, 10_000):
        batch = m.EventBatch(
            session="one", seq=1, wall_ns=0, camera="left", start_us=start_us, end_us=start_us + 10_000, width_px=64,
            height_px=48, since_us=np.sort(rng.integers(0, 10_000, 40)).astype(np.uint32),
            x_px=rng.integers(0, 64, 40).astype(np.uint16), y_px=rng.integers(0, 48, 40).astype(np.uint16),
            on=np.ones(40, np.uint8), truth_t_us=np.zeros(0, np.int64), circle=np.zeros((0, 3)),
        )  # fmt: skip
        ring.on_events(batch)
        ring.on_state(m.WorldState(
            session="one", seq=1, wall_ns=0, start_us=start_us, t_us=start_us + 10_000, phase="serve", paused=False,
            speed_factor=1.0, noise_hz=0.1, auto_serve_mps=0.0, real_time_factor=1.0, served=0, returned=0,
            ball_t_us=np.array([start_us]), ball=np.full((1, 9), 0.5), ball_visible=np.zeros(1, np.uint8),
            racket_t_us=np.array([start_us]), racket=np.ones((1, 10)),
        ))  # fmt: skip
    return ring


def test_of_a_live_source_the_last_seconds_are_sampled(live: RingRecording) -> None:
    config = method_config("refined")
    request = SampleRequest(1, live.cameras["left"], "refined", {"refined": config}, live=True)
    answer = answer_sample(request)
    assert answer.sample.windows == 300 and answer.sample.found == 0
    assert {one.reason for one in answer.sample.reasons}.isdisjoint({"events in the history"}), "what is forgotten"
    html = nothing_found_html(answer)
    assert "refined finds no ball in a sample of 300 windows of the last 5 s" in html
    assert "href='#setting-refined-" in html


class Here:
    """A pool that does its work at once, and counts it."""

    def __init__(self) -> None:
        self.asked = 0

    def submit(self, work) -> Future:
        self.asked += 1
        work()
        return Future()


def test_a_live_source_is_sampled_again_while_there_is_no_ball(request_of) -> None:
    pool, shown = Here(), []
    mine = NothingFound(pool, lambda act: act(), pytest.fail, lambda text, _: shown.append(text))  # type: ignore[arg-type]
    request = replace(request_of(1), live=True)
    for wall_s, times in ((0.0, 0), (2.0, 1), (5.0, 1), (13.0, 2), (14.0, 2)):
        mine.want(request, wall_s)
        mine.tick(wall_s)
        assert pool.asked == times
    assert "of the last 5 s" in shown[-1]


def test_a_config_is_sampled_once_when_it_has_rested(request_of) -> None:
    pool, shown, failed = Here(), [], []
    mine = NothingFound(pool, lambda act: act(), failed.append, lambda text, _: shown.append(text))  # type: ignore[arg-type]
    mine.want(request_of(1), 0.0)
    mine.tick(1.0)
    mine.want(request_of(2), 1.0)  # the slider moves on
    mine.tick(2.0)
    assert not pool.asked, "it has not rested"
    for wall_s in (2.6, 3.0, 9.0):
        mine.want(request_of(2), wall_s)
        mine.tick(wall_s)
    assert pool.asked == 1 and not failed and "refined finds no ball" in shown[-1]
    mine.want(None, 10.0)
    assert shown[-1] == "", "a window with a ball"
    mine.want(request_of(2), 11.0)
    assert "refined finds no ball" in shown[-1] and pool.asked == 1, "it is known"
