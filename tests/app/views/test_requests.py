"""What a zoomed view of Tune shows, and what it says of a ball that a setting rejects."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.modes.tune.results_panel import candidates_html, cluster_at
from app.pictures.canvas import Canvas, Region
from app.pictures.palette import PaletteIndex
from app.state.client_state import Overlay, RenderSettings, TuneView
from app.views.answer_cache import AnswerCache
from app.views.requests import TuneRequest, render_answers, render_tune, window_before
from app.views.stage_picture import draw_stages, rejected_up_to
from core.config import replace_setting
from core.detection import DetectorConfig, PipelineTrace
from core.recordings import CameraStream, open_recording

BALL_US = 300_000
ZOOMED = TuneView(zoom=8.0)
SEEN = DetectorConfig()
TOO_LARGE = replace_setting(
    replace_setting(SEEN, ("localise", "radius_min_px"), 1.0), ("localise", "radius_max_px"), 2.0
)


@pytest.fixture(scope="module")
def stream(serve_recording: Path) -> Iterator[CameraStream]:
    with open_recording(serve_recording) as recording:
        yield recording.cameras["left"]


def request(stream: CameraStream, config: DetectorConfig, last_px: tuple[float, float] | None = None) -> TuneRequest:
    return TuneRequest(stream, BALL_US, RenderSettings(), ZOOMED, (("A", config),), AnswerCache(), last_px)


def middle(region: Region) -> tuple[float, float]:
    return region.x + region.width / 2, region.y + region.height / 2


def test_the_view_stays_where_the_ball_was_when_a_threshold_rejects_it(stream: CameraStream) -> None:
    sheet, (trace,) = render_tune(request(stream, SEEN))
    ball = trace.detection
    assert ball is not None
    assert np.hypot(*np.subtract(middle(sheet.pictures[0].region), (ball.u_px, ball.v_px))) < 2
    lost, (rejecting,) = render_tune(request(stream, TOO_LARGE, (ball.u_px, ball.v_px)))
    assert rejecting.detection is None
    assert lost.pictures[0].region == sheet.pictures[0].region


def test_the_view_of_a_method_without_stages_stays_too(stream: CameraStream) -> None:
    wanted = replace(request(stream, SEEN, (1000.0, 200.0)), view=replace(ZOOMED, method="refined"), t_us=1000)
    sheet, (answer,) = render_answers(wanted)
    assert answer.detection is None  # after one millisecond nothing has been seen yet
    assert np.hypot(*np.subtract(middle(sheet.pictures[0].region), (1000, 200))) < 2


@pytest.fixture(scope="module")
def lost(stream: CameraStream) -> PipelineTrace:
    return render_tune(request(stream, TOO_LARGE))[1][0]


@pytest.mark.parametrize(
    ("overlay", "red"), [("raw", False), ("clusters", False), ("geometry", True), ("result", True)]
)
def test_a_rejected_ball_is_outlined_in_red_with_the_number_that_failed(
    stream: CameraStream, lost: PipelineTrace, overlay: Overlay, red: bool
) -> None:
    (ball,) = (one for one in lost.candidates if one.rejected and "radius" in one.rejected and one.size > 100)
    xs, ys = ball.events.x_px, ball.events.y_px
    around = Region.around(float(xs.mean()), float(ys.mean()), stream.sensor, 16.0)
    canvas = Canvas(around)
    draw_stages(canvas, window_before(stream, BALL_US, SEEN.window.window_us), lost, overlay, "polarity")
    assert (ball in rejected_up_to(lost, overlay)) == red
    assert (np.count_nonzero(canvas.image == PaletteIndex.HULL_REJECTED) > 200) == red


def test_the_result_shows_nothing_rejected_beside_a_ball(stream: CameraStream) -> None:
    (trace,) = render_tune(request(stream, SEEN))[1]
    assert trace.detection is not None and any(one.rejected for one in trace.candidates)
    assert rejected_up_to(trace, "result") == ()
    assert rejected_up_to(trace, "geometry")


def test_a_click_on_a_cluster_brings_its_row_to_the_top(lost: PipelineTrace) -> None:
    smallest = min(lost.candidates, key=lambda one: one.size)
    at_px = (float(smallest.events.x_px[0]) + 1.0, float(smallest.events.y_px[0]) - 1.0)
    assert cluster_at(lost, at_px) == smallest.label
    assert cluster_at(lost, (-100.0, -100.0)) is None and cluster_at(lost, None) is None
    table = candidates_html("", lost, smallest.label)
    first = table.split("<tr")[2]
    cells = [cell.split(">")[1].split("<")[0] for cell in first.split("<td")]
    assert cells[2:4] == [str(smallest.label), str(smallest.size)] and "background" in first
    assert table.count("background") == 1


def test_a_verdict_links_to_the_sliders_of_its_stage(lost: PipelineTrace) -> None:
    assert "href='#stage-localise'" in candidates_html("", lost)
