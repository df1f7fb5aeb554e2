"""A detection is drawn where it was and says when; it is red where the truth says that it is none."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.modes.tune.candidates import verdict_html
from app.pictures.canvas import Canvas, Region
from app.pictures.palette import PaletteIndex
from app.state.client_state import RenderSettings, TuneView
from app.views.answer_cache import AnswerCache
from app.views.requests import TuneRequest, answer_request
from app.views.stage_picture import LATE_US, draw_detection, miss_px
from core.detection import Detection
from core.detection.methods import method_config
from core.events import SensorSize
from core.metrics.run import explain_window
from core.recordings import PixelTruth, open_recording

SENSOR = SensorSize(100, 80)
END_US = 20_000
BALL_US = 300_000


def drawn(t_us: int) -> Canvas:
    canvas = Canvas(Region.of_sensor(SENSOR), width_px=400)
    draw_detection(canvas, Detection(t_us, 50.0, 40.0, 12.0), END_US)
    return canvas


def test_an_old_answer_has_a_broken_circle_and_says_how_old_it_is() -> None:
    new, old = drawn(END_US - LATE_US), drawn(END_US - 10_200)
    circles = [int((canvas.image == PaletteIndex.CIRCLE).sum()) for canvas in (new, old)]
    assert circles[1] < 0.8 * circles[0]
    assert (len(new.texts), [one.text for one in old.texts]) == (0, ["10.2 ms earlier"])


def test_the_distance_from_the_truth_is_taken_at_the_time_of_the_answer() -> None:
    t_us = np.array([0, 10_000, 20_000])
    truth = PixelTruth(t_us, np.array([0.0, 10.0, 20.0]), np.zeros(3), np.full(3, 5.0), np.array([True, True, False]))
    assert miss_px(Detection(10_000, 13.0, 4.0, 5.0), truth) == pytest.approx(5.0)
    assert miss_px(Detection(20_000, 20.0, 0.0, 5.0), truth) == float("inf")
    assert miss_px(Detection(30_000, 20.0, 0.0, 5.0), truth) is None is miss_px(None, truth)


def test_a_ball_that_no_score_would_count_is_red_in_picture_and_table(serve_recording: Path) -> None:
    with open_recording(serve_recording) as recording:
        stream = recording.cameras["left"]
        config = method_config("auto")
        right = explain_window(stream, "auto", config, BALL_US)
        assert right.detection is not None and right.trace is not None
        off = replace(right.detection, u_px=right.detection.u_px + 20.0)

        class Moved(AnswerCache):
            """Holds an answer that is 20 px off."""

            def find(self, stream, method, config, t_us):
                return replace(right, detection=off, trace=replace(right.trace, detection=off))

        view = TuneView(method="auto", overlay="result", zoom=8.0)
        for answers, wrong in ((AnswerCache(), False), (Moved(), True)):
            request = TuneRequest(stream, BALL_US, RenderSettings(), view, (("A", config),), answers)
            answer = answer_request(request)
            (distance_px,) = answer.misses_px
            assert distance_px is not None and (distance_px > 8) == wrong
            said = verdict_html("", answer.found[0], distance_px)
            assert ("not found" in said) == wrong and "off the true ball" in said
            assert (red_pixels(answer.sheet.pictures[0].png) > 40) == wrong
            hidden = answer_request(replace(request, view=replace(view, show_truth=False)))
            assert hidden.misses_px == () and red_pixels(hidden.sheet.pictures[0].png) == 0, "nobody knows"


def red_pixels(png: bytes) -> int:
    """Pixels in the colour of what is rejected."""
    return int((np.array(Image.open(io.BytesIO(png))) == PaletteIndex.HULL_REJECTED).sum())
