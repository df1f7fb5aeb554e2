"""What a method says of one window."""

import numpy as np
import pytest

from core.detection import RefinedDetection, ebpp_config, fe_fusion_config, refined_config
from core.detection.methods import METHODS, make_detector, method_config
from core.metrics import run_detector
from core.metrics.run import answer_window, explain_window
from core.recordings import open_recording

pytestmark = pytest.mark.numeric
CONFIGS = {"refined": refined_config(), "ebpp": ebpp_config(), "fe-fusion": fe_fusion_config()}
BALL_US = 300_000


@pytest.fixture(scope="module")
def stream(serve_recording):
    with open_recording(serve_recording) as recording:
        yield recording.cameras["left"]


@pytest.mark.parametrize("method", CONFIGS)
def test_after_a_lead_in_it_is_where_a_run_over_the_whole_recording_has_it(stream, method: str) -> None:
    config = CONFIGS[method]
    answer = answer_window(stream, method, config, BALL_US)
    whole = run_detector(stream, make_detector(method, stream.sensor, config), config.window.window_us)
    (row,) = np.flatnonzero(whole.end_us == BALL_US)
    ball = answer.detection
    assert ball is not None and ball.t_us == whole.t_us[row] == answer.valid_us
    assert np.hypot(ball.u_px - whole.u_px[row], ball.v_px - whole.v_px[row]) < 0.5
    assert answer.lead_in_windows == 60_000 // config.window.window_us


def test_rows_keep_the_detections_of_their_balls(stream) -> None:
    config = refined_config()
    whole = run_detector(stream, make_detector("refined", stream.sensor, config), 1000)
    late = whole.rows(whole.end_us > BALL_US)
    assert 0 < late.detected.sum() == len(late.detections) < len(whole.detections)
    assert [one.t_us for one in late.detections] == late.t_us[late.detected].tolist()
    picked = whole.rows(np.flatnonzero(~whole.detected)[:3])
    assert picked.detections == () and len(picked.t_us) == 3


def test_without_a_lead_in_refined_knows_no_ball_yet(stream) -> None:
    answer = answer_window(stream, "refined", refined_config(), BALL_US, lead_in_us=0)
    assert answer.detection is None and answer.valid_us == BALL_US and answer.lead_in_windows == 0
    assert isinstance(answer_window(stream, "refined", refined_config(), BALL_US).detection, RefinedDetection)


@pytest.mark.parametrize("method", METHODS)
def test_at_the_very_start_it_is_the_first_whole_window(stream, method: str) -> None:
    window_us = method_config(method).window.window_us
    answer = answer_window(stream, method, method_config(method), 7)
    assert (answer.window.start_us, answer.window.end_us, answer.lead_in_windows) == (0, window_us, 0)
    second = answer_window(stream, method, method_config(method), 2 * window_us)
    assert (second.window.start_us, second.lead_in_windows) == (window_us, 1)


def test_a_window_that_is_explained_shows_all_that_the_default_method_searches(stream) -> None:
    """Between two searches of the long time spans a slow thing would not be listed, and there would be no reason."""
    answer = explain_window(stream, "refined", method_config("refined"), BALL_US)
    assert answer.lead_in_windows % 4 == 3 and answer.lead_in_windows >= 60
