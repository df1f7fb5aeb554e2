"""What a zoomed view of Tune shows, and what it says of a ball that a setting rejects."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.modes.tune.candidates import candidate_at, candidates_html
from app.pictures.canvas import Canvas, Region
from app.pictures.palette import PaletteIndex
from app.state.client_state import Overlay, RenderSettings, TuneView
from app.views.answer_cache import AnswerCache
from app.views.requests import TuneRequest, WatchRequest, render_tune, render_watch, window_before
from app.views.stage_picture import draw_stage
from core.config import replace_setting
from core.detection import DetectorConfig
from core.detection.method_trace import MethodTrace
from core.detection.methods import VIEWS, Method, method_config
from core.detection.saved import SavedDetector
from core.metrics.run import explain_window
from core.recordings import CameraStream, open_recording

BALL_US = 300_000
ZOOMED = TuneView(zoom=8.0, method="auto")
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


def test_pictures_fill_the_room_that_is_named_and_stand_beside_each_other_where_none_is(serve_recording: Path) -> None:
    with open_recording(serve_recording) as recording:
        wanted = WatchRequest(recording, BALL_US, RenderSettings(), SavedDetector("auto", SEEN), show_truth=False)
        usual = render_watch(wanted)
        filling = render_watch(replace(wanted, aspect=1.3))
        chosen = render_watch(replace(wanted, aspect=1.3, look=RenderSettings(arrangement="side by side")))
    assert len({picture.y for picture in usual.pictures}) == 1
    assert len({picture.x for picture in filling.pictures}) == 1
    assert len({picture.y for picture in chosen.pictures}) == 1, "what a person chose counts more"


@pytest.mark.parametrize(("method", "config", "t_us"), [("auto", TOO_LARGE, BALL_US), ("refined", None, 2_000)])
def test_a_picture_of_watch_says_why_it_has_no_ball_in_the_words_of_tune(
    serve_recording: Path, method: Method, config: DetectorConfig | None, t_us: int
) -> None:
    detector = SavedDetector(method, config or method_config(method))
    with open_recording(serve_recording) as recording:
        wanted = WatchRequest(recording, t_us, RenderSettings(), detector, show_truth=False, why_not=True)
        silent = [text.text for text in render_watch(replace(wanted, why_not=False)).texts]
        said = [text.text for text in render_watch(wanted).texts if text.text not in silent]
        explained = [explain_window(stream, *detector, t_us) for stream in recording.cameras.values()]
    assert len(explained) == 2 and all(one.detection is None for one in explained)
    assert said == [text for one in explained for text in (f"{method}: no ball", *(why.text for why in one.reasons))]


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


@pytest.mark.parametrize("method", ["auto", "refined"])
def test_the_caption_says_for_when_the_ball_is(stream: CameraStream, method: Method) -> None:
    wanted = replace(request(stream, method_config(method)), view=replace(ZOOMED, method=method))
    sheet, (answer,) = render_tune(wanted)
    assert answer.detection is not None
    captions = [text.text for text in sheet.texts if f"{method}, config A" in text.text]
    assert [f"ball at {answer.valid_us / 1e3:.3f} ms" in caption for caption in captions] == [True]


def test_a_zoomed_view_without_a_ball_says_how_many_events_it_does_not_show(stream: CameraStream) -> None:
    corner = (0.0, 0.0)  # a quarter of the view is on the sensor
    sheet, (answer,) = render_tune(request(stream, TOO_LARGE, corner))
    assert answer.detection is None
    (caption,) = (text.text for text in sheet.texts if "config A" in text.text)
    events, shown = (int(count.replace(",", "")) for count in re.findall(r"([\d,]+) (?:events|in view)", caption))
    assert shown < events == len(answer.window.events) and caption.endswith("Zoom 1 shows all")
    whole, _ = render_tune(replace(request(stream, TOO_LARGE), view=replace(ZOOMED, zoom=1.0)))
    assert not any("in view" in text.text for text in whole.texts)


def test_the_view_of_a_method_without_stages_stays_too(stream: CameraStream) -> None:
    wanted = replace(request(stream, SEEN, (1000.0, 200.0)), view=replace(ZOOMED, method="refined"), t_us=1000)
    sheet, (answer,) = render_tune(wanted)
    assert answer.detection is None  # after one millisecond nothing has been seen yet
    assert np.hypot(*np.subtract(middle(sheet.pictures[0].region), (1000, 200))) < 2


@pytest.fixture(scope="module")
def lost(stream: CameraStream) -> MethodTrace:
    trace = render_tune(request(stream, TOO_LARGE))[1][0].trace
    assert trace is not None
    return trace


@pytest.mark.parametrize(
    ("overlay", "red"), [("raw", False), ("clusters", False), ("geometry", True), ("result", True)]
)
def test_a_rejected_ball_is_outlined_in_red_with_the_number_that_failed(
    stream: CameraStream, lost: MethodTrace, overlay: Overlay, red: bool
) -> None:
    (ball,) = (one for one in lost.candidates if one.reasons and "radius" in one.reasons[0].text and one.order > 100)
    around = Region.around(float(ball.x_px.mean()), float(ball.y_px.mean()), stream.sensor, 16.0)
    canvas = Canvas(around)
    draw_stage(canvas, window_before(stream, BALL_US, SEEN.window.window_us), lost, overlay, "polarity")
    named = f"{ball.label}: {ball.reasons[0].text}"
    assert (named in [shape.text for shape in lost.view(overlay).shapes if shape.role == "rejected"]) == red
    assert (np.count_nonzero(canvas.image == PaletteIndex.HULL_REJECTED) > 200) == red


def test_the_result_shows_nothing_rejected_beside_a_ball(stream: CameraStream) -> None:
    trace = render_tune(request(stream, SEEN))[1][0].trace
    assert trace is not None and trace.detection is not None and any(one.reasons for one in trace.candidates)
    assert not any(shape.role == "rejected" for shape in trace.view("result").shapes)
    assert any(shape.role == "rejected" for shape in trace.view("geometry").shapes)


def test_a_click_on_a_cluster_brings_its_row_to_the_top(lost: MethodTrace) -> None:
    smallest = min(lost.candidates, key=lambda one: one.order)
    at_px = (float(smallest.x_px[0]) + 1.0, float(smallest.y_px[0]) - 1.0)
    assert candidate_at(lost, at_px) == smallest.label
    assert candidate_at(lost, (-100.0, -100.0)) is None and candidate_at(lost, None) is None
    table = candidates_html(lost, smallest.label)
    first = table.split("<tr")[2]
    cells = [cell.split(">")[1].split("<")[0] for cell in first.split("<td")]
    assert cells[2] == str(smallest.label) and cells[4] == f"{smallest.order:.0f}" and "background" in first
    assert table.count("background") == 1


def test_a_verdict_links_to_the_slider_of_its_limit(lost: MethodTrace) -> None:
    assert "href='#setting-localise-radius-max-px'" in candidates_html(lost)


@pytest.mark.parametrize("method", ["refined", "ebpp", "fe-fusion"])
def test_every_method_draws_each_of_its_stages(stream: CameraStream, method: str) -> None:
    pictures = set()
    for view in VIEWS[method]:
        look = replace(ZOOMED, method=method, overlay=view)
        wanted = replace(request(stream, method_config(method)), view=look)
        sheet, (answer,) = render_tune(wanted)
        assert answer.trace is not None and answer.trace.view(view).name == view
        pictures.add(sheet.pictures[0].png)
    assert len(pictures) >= len(VIEWS[method]) - 1, "a search that is not made shows what the one before does"


def test_a_fit_of_the_default_method_has_a_link_for_each_failed_limit_and_its_residuals(stream: CameraStream) -> None:
    config = replace_setting(method_config("refined"), ("refined", "points_min"), 200)
    wanted = replace(request(stream, config), view=replace(ZOOMED, method="refined", overlay="fit"))
    _, (answer,) = render_tune(wanted)
    assert answer.detection is None and answer.trace is not None and answer.trace.reasons
    table = candidates_html(answer.trace)
    assert "href='#setting-refined-points-min'" in table and "edge points" in table
    assert "<svg" in table and table.count("<circle") > 20
