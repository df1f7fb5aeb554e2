"""Answers of a playback: what goes on from the picture before, and what begins anew."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from core.detection.methods import METHODS, Method, method_config
from core.detection.saved import SavedDetector
from core.errors import RecordingError
from core.metrics.playback import PlaybackAnswers
from core.metrics.run import WindowAnswer, answer_window
from core.recordings import CameraStream, Recording, open_recording

pytestmark = pytest.mark.numeric
BALL_US = 300_000
STEP_US = 12_500
REFINED = SavedDetector("refined", method_config("refined"))


@pytest.fixture(scope="module")
def recording(serve_recording: Path) -> Iterator[Recording]:
    with open_recording(serve_recording) as recording:
        yield recording


def is_exact(answer: WindowAnswer, stream: CameraStream, saved: SavedDetector, t_us: int) -> bool:
    exact = answer_window(stream, *saved, t_us)
    return (answer.detection, answer.lead_in_windows) == (exact.detection, exact.lead_in_windows)


def test_it_goes_on_from_the_answer_before_and_finds_the_ball_where_the_lead_in_finds_it(recording: Recording) -> None:
    playback, stream = PlaybackAnswers(), recording.cameras["left"]
    assert is_exact(playback.find(stream, REFINED, BALL_US), stream, REFINED, BALL_US)
    for t_us in range(BALL_US + STEP_US, BALL_US + 4 * STEP_US, STEP_US):
        answer, exact = playback.find(stream, REFINED, t_us), answer_window(stream, *REFINED, t_us)
        assert answer.lead_in_windows == 11, "of the 12 windows since then one is answered"
        assert (answer.window.start_us, answer.window.end_us) == (t_us - 1000, t_us)
        assert answer.detection is not None and exact.detection is not None
        assert answer.detection.t_us == exact.detection.t_us
        ball, known = answer.detection, exact.detection
        assert np.hypot(ball.u_px - known.u_px, ball.v_px - known.v_px) < 0.5


@pytest.mark.parametrize("away_us", [-STEP_US, 400, 60_001, 150_000])
def test_it_begins_anew_before_the_last_answer_too_near_to_it_and_long_after_it(
    recording: Recording, away_us: int
) -> None:
    playback, stream = PlaybackAnswers(), recording.cameras["left"]
    playback.find(stream, REFINED, BALL_US)
    assert is_exact(playback.find(stream, REFINED, BALL_US + away_us), stream, REFINED, BALL_US + away_us)


def test_each_camera_goes_on_for_itself_and_another_recording_or_setting_begins_anew(
    recording: Recording, serve_recording: Path
) -> None:
    playback, later_us = PlaybackAnswers(), BALL_US + STEP_US
    for stream in recording.cameras.values():
        playback.find(stream, REFINED, BALL_US)
    assert {playback.find(one, REFINED, later_us).lead_in_windows for one in recording.cameras.values()} == {11}
    stream, auto = recording.cameras["left"], SavedDetector("auto", method_config("auto"))
    assert is_exact(playback.find(stream, auto, later_us + STEP_US), stream, auto, later_us + STEP_US)
    with open_recording(serve_recording) as again:
        other = again.cameras["left"]
        assert is_exact(playback.find(other, auto, later_us + 2 * STEP_US), other, auto, later_us + 2 * STEP_US)


def test_after_a_part_that_cannot_be_read_it_begins_anew(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    playback, stream = PlaybackAnswers(), recording.cameras["left"]
    playback.find(stream, REFINED, BALL_US)

    def broken(start_us: int, end_us: int) -> None:
        raise RecordingError("damaged")

    with monkeypatch.context() as patch:
        patch.setattr(type(stream), "slice", lambda self, start_us, end_us: broken(start_us, end_us))
        with pytest.raises(RecordingError):
            playback.find(stream, REFINED, BALL_US + STEP_US)
    assert is_exact(playback.find(stream, REFINED, BALL_US + STEP_US), stream, REFINED, BALL_US + STEP_US)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_can_go_on(recording: Recording, method: Method) -> None:
    playback, stream = PlaybackAnswers(), recording.cameras["left"]
    saved = SavedDetector(method, method_config(method))
    first = playback.find(stream, saved, 7)
    assert first.window.start_us == 0 and first.lead_in_windows == 0, "the first whole window"
    window_us, t_us = first.window.end_us, 3 * first.window.end_us + 1
    answer = playback.find(stream, saved, t_us)
    assert (answer.window.end_us, answer.lead_in_windows) == (t_us, 1 if t_us - window_us <= 60_000 else 2)
