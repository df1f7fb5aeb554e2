from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from core.chain import ChainConfig, ChainState, RallyChain
from core.detection.window import windows_between
from core.errors import CalibrationError, RecordingError
from core.events import Window
from core.recordings import Recording, open_recording

pytestmark = pytest.mark.numeric
WINDOW_US = 2000


@pytest.fixture(scope="module")
def recording(serve_recording: Path) -> Iterator[Recording]:
    opened = open_recording(serve_recording)
    yield opened
    opened.close()


def chain_for(recording: Recording, config: ChainConfig | None = None) -> RallyChain:
    cameras = {}
    for name, stream in recording.cameras.items():
        assert stream.calibration is not None
        cameras[name] = stream.calibration
    return RallyChain(cameras, config)


def windows_of(recording: Recording, start_us: int = 0, end_us: int = 600_000) -> list[dict[str, Window]]:
    streams = recording.cameras
    columns = [list(windows_between(stream, start_us, end_us, WINDOW_US)) for stream in streams.values()]
    return [dict(zip(streams, row, strict=True)) for row in zip(*columns, strict=True)]


@pytest.fixture(scope="module")
def states(recording: Recording) -> list[ChainState]:
    chain = chain_for(recording)
    return [chain.step(windows) for windows in windows_of(recording)]


def truth_at(recording: Recording, t_us: list[int]) -> np.ndarray:
    ball = recording.ball
    assert ball is not None
    present = np.isfinite(ball.p_world_m[:, 0])
    columns = [np.interp(t_us, ball.t_us[present], ball.p_world_m[present, axis]) for axis in range(3)]
    return np.column_stack(columns)


def test_the_ball_is_found_in_space_to_millimetres(recording, states) -> None:
    points = [state.point for state in states if state.point is not None]
    assert len(points) > 100
    t_us = [point.t_us for point in points]
    errors_m = np.linalg.norm(np.array([point.p_world_m for point in points]) - truth_at(recording, t_us), axis=1)
    assert np.median(errors_m) < 0.008 and np.percentile(errors_m, 95) < 0.03
    assert all(np.linalg.eigvalsh(point.covariance_m2).min() > 0 for point in points)
    assert all(point.uvs_px.keys() == {"left", "right"} for point in points)


def test_one_bounce_is_seen_and_the_prediction_before_and_after_it_comes_true(recording, states) -> None:
    ball = recording.ball
    assert ball is not None
    kink = int(np.argmax(np.diff(ball.v_world_mps[np.isfinite(ball.v_world_mps[:, 2]), 2])))
    bounce_us = int(ball.t_us[np.isfinite(ball.v_world_mps[:, 2])][kink + 1])
    assert len(states[-1].bounces_us) == 1
    assert abs(states[-1].bounces_us[0] - bounce_us) < 8000
    made = [state.prediction for state in states if state.is_new and state.prediction is not None]
    post = [prediction for prediction in made if prediction.stage == "post"]
    pre = [prediction for prediction in made if prediction.stage == "pre"]
    assert pre and post and max(one.t_us for one in pre) < min(one.t_us for one in post)
    crossing_us = int(
        np.interp(
            1.42, -ball.p_world_m[np.isfinite(ball.p_world_m[:, 0]), 0], ball.t_us[np.isfinite(ball.p_world_m[:, 0])]
        )
    )
    true_hit = truth_at(recording, [crossing_us])[0]
    for prediction, within_m in ((pre[-1], 0.15), (post[0], 0.05)):
        assert prediction.hit_plane is not None
        assert np.linalg.norm(prediction.hit_plane.p_world_m - true_hit) < within_m
        assert prediction.t_us < crossing_us


def test_a_state_says_what_its_step_did(states) -> None:
    assert [state.t_us for state in states] == [WINDOW_US * (number + 1) for number in range(len(states))]
    quiet = states[0]
    assert quiet.point is None and quiet.verdict is None and quiet.prediction is None and not quiet.is_new
    assert quiet.detections == {"left": None, "right": None}
    assert next(state.verdict for state in states if state.verdict) == "new flight"
    for state in states:
        assert state.seconds.total >= state.seconds.detect > 0
        if state.is_new:
            assert state.prediction is not None and state.point is not None
            assert state.prediction.t_us == state.point.t_us, "a prediction ends with the newest point"


def test_a_reset_chain_does_everything_again(recording, states) -> None:
    chain = chain_for(recording)
    for windows in windows_of(recording)[:150]:
        chain.step(windows)
    chain.reset()
    again = [chain.step(windows) for windows in windows_of(recording)[:150]]
    for one, other in zip(again, states, strict=False):
        assert one.detections == other.detections and one.bounces_us == other.bounces_us
        assert (one.point is None) == (other.point is None)
        if one.point is not None and other.point is not None:
            np.testing.assert_array_equal(one.point.p_world_m, other.point.p_world_m)


def shifted(window: Window, by_us: int) -> Window:
    from dataclasses import replace

    events = replace(window.events, t_us=window.events.t_us + by_us)
    return Window(events, window.start_us + by_us, window.end_us + by_us)


def test_a_gap_between_two_serves_begins_a_new_flight(recording, states) -> None:
    chain = chain_for(recording)
    first = [chain.step(windows) for windows in windows_of(recording)]
    later_us = 900_000
    second = []
    for windows in windows_of(recording):
        second.append(chain.step({name: shifted(window, later_us) for name, window in windows.items()}))
    assert first[-1].bounces_us, "the first flight has bounced"
    begins = next(state for state in second if state.point is not None)
    assert begins.verdict == "new flight" and begins.bounces_us == () and begins.prediction is None
    assert [state.prediction.t_us - later_us for state in second if state.is_new and state.prediction][-5:] == [
        state.prediction.t_us for state in states if state.is_new and state.prediction
    ][-5:]


def test_cameras_with_windows_of_their_own_phase_are_read_at_one_time(recording) -> None:
    chain = chain_for(recording)
    left = list(windows_between(recording.cameras["left"], 0, 600_000, WINDOW_US))
    right = list(windows_between(recording.cameras["right"], 1000, 600_000, WINDOW_US))
    points = []
    for one, other in zip(left, right, strict=False):
        for windows in ({"left": one}, {"right": other}):
            state = chain.step(windows)
            if state.point is not None:
                points.append(state.point)
    assert len(points) > 100
    errors_m = np.linalg.norm(
        np.array([point.p_world_m for point in points]) - truth_at(recording, [point.t_us for point in points]), axis=1
    )
    assert np.median(errors_m) < 0.008, "1 ms apart and unnoticed would be 5 mm more"


def test_what_cannot_be_a_chain_is_refused(recording) -> None:
    cameras = {name: stream.calibration for name, stream in recording.cameras.items()}
    with pytest.raises(CalibrationError, match="two cameras"):
        RallyChain({"left": cameras["left"]})
    window = windows_of(recording, 0, 2000)[0]["left"]
    with pytest.raises(RecordingError, match="left, right"):
        chain_for(recording).step({"middle": window})
    with pytest.raises(RecordingError, match="none"):
        chain_for(recording).step({})
