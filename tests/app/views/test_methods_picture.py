"""Several methods beside each other on the same window."""

import numpy as np
import pytest

from app.modes.tune.compare_run import method_css
from app.pictures.canvas import Region
from app.pictures.palette import METHOD_RGB, RAMP_COLOURS, PaletteIndex, method_colour_index, palette
from app.state.client_state import RenderSettings, TuneView
from app.views.answer_cache import KEPT, AnswerCache
from app.views.methods_picture import MethodsRequest, answer_methods, columns_of, verdict
from core.detection import Detection, FastDetector, register_detector
from core.detection.methods import METHODS, SECTIONS, method_config
from core.events import Events, SensorSize, Window
from core.metrics.compare import PixelReference, truth_reference
from core.metrics.run import WindowAnswer
from core.recordings import PixelTruth, open_recording
from core.registry import forgotten_afterwards, use_plugins

BALL_US = 300_000
EMPTY = Window(Events.empty(SensorSize(64, 64)), 0, 10_000)


def test_every_method_has_a_colour_that_nothing_else_has() -> None:
    inks = [method_colour_index(method) for method in METHODS]
    others = {int(ink) for ink in PaletteIndex} - {PaletteIndex.METHOD}
    assert (
        len(set(inks)) == len(METHODS)
        and not others & set(inks)
        and min(inks) >= PaletteIndex.RAMP + RAMP_COLOURS
        and max(inks) < 256
    )
    assert len(set(METHOD_RGB.values())) == len(METHODS)
    assert [tuple(palette("red / green")[ink]) for ink in inks] == [METHOD_RGB[method] for method in METHODS]


@pytest.fixture(scope="module")
def stream(serve_recording):
    with open_recording(serve_recording) as recording:
        yield recording.cameras["left"]


def request_for(stream, methods, view: TuneView = TuneView(), t_us: int = BALL_US) -> MethodsRequest:  # noqa: B008
    configs = tuple((method, method_config(method)) for method in methods)
    reference = truth_reference(stream.truth, stream.sensor)
    return MethodsRequest(stream, t_us, RenderSettings(), view, configs, AnswerCache(), lambda: reference)


def test_all_tiles_show_the_same_part_of_the_sensor_round_the_ball(stream) -> None:
    answer = answer_methods(request_for(stream, tuple(METHODS)))
    there = stream.truth.at(BALL_US)
    tiles = answer.sheet.pictures
    assert [one.method for one in answer.found] == list(METHODS)
    (region,) = {tile.region for tile in tiles}
    assert region == Region.around(float(there.u_px[0]), float(there.v_px[0]), stream.sensor, 8.0)
    assert len({tile.x for tile in tiles}) == 3 and len({tile.y for tile in tiles}) == 2


def test_tiles_stand_in_as_many_rows_as_columns() -> None:
    assert [columns_of(tiles) for tiles in (0, 1, 2, 3, 4, 5, 6, 9, 10)] == [1, 1, 2, 2, 2, 3, 3, 3, 4]


def test_seven_methods_have_a_tile_and_a_colour_each(stream, plugins) -> None:
    with forgotten_afterwards():
        use_plugins([plugins / "median_detector.py"])
        register_detector("third", FastDetector, None, "as auto", (12, 200, 90), stages=SECTIONS["auto"][1:])
        assert len(METHODS) == 7
        answer = answer_methods(request_for(stream, tuple(METHODS)))
        tiles = answer.sheet.pictures
        assert [one.method for one in answer.found] == list(METHODS) and all(one.detection for one in answer.found)
        assert len({tile.x for tile in tiles}) == 3 and len({tile.y for tile in tiles}) == 3
        assert tuple(palette("red / green")[method_colour_index("median")]) == (70, 160, 255)
        assert method_css("median") == "rgb(70,160,255)" and METHOD_RGB["third"] == (12, 200, 90)


def test_a_zoomed_view_stays_where_it_was_put(stream) -> None:
    view = TuneView(zoom=4.0, centre_px=(200.0, 300.0))
    (tile,) = answer_methods(request_for(stream, ("refined",), view)).sheet.pictures
    assert tile.region == Region.around(200.0, 300.0, stream.sensor, 4.0)


def test_without_a_method_there_is_no_picture(stream) -> None:
    assert answer_methods(request_for(stream, ())).sheet.pictures == ()


def test_the_title_says_how_far_off_a_ball_is_at_its_own_time_or_what_is_wrong() -> None:
    seen = np.array([True, True, False, False])
    u = np.where(seen, [10.0, 30.0, 0.0, 0.0], np.nan)
    places = PixelTruth(np.array([0, 10_000, 10_001, 20_000]), u, u * 0 + 5.0, u * 0 + 3.0, seen)
    reference = PixelReference("truth", "the truth", places, np.array([5000]))

    def said(t_us: int | None, known: PixelReference | None = reference, window: Window = EMPTY) -> str:
        ball = None if t_us is None else Detection(t_us, 23.0, 9.0, 3.0)
        return verdict(WindowAnswer("ebpp", window, ball, 0), known)

    assert said(5000) == "5.00 px"
    assert said(15_000) == "false ball"
    assert said(25_000) == "ball" == said(5000, None)
    assert said(None) == "no ball, missed"
    assert said(None, None) == said(None, window=Window(EMPTY.events, 14_000, 15_000)) == "no ball"


def test_an_answer_is_computed_once_and_the_oldest_are_forgotten(stream) -> None:
    cache, config = AnswerCache(), method_config("fe-fusion")
    first = cache.find(stream, "fe-fusion", config, 50_000)
    assert cache.find(stream, "fe-fusion", config, 50_000) is first
    assert cache.find(stream, "fe-fusion", config, 50_001) is not first
    for t_us in range(60_000, 60_000 + KEPT):
        cache.find(stream, "fe-fusion", config, t_us)
    again = cache.find(stream, "fe-fusion", config, 50_000)
    assert again is not first and again.detection == first.detection
    cache.clear()
    assert cache.find(stream, "fe-fusion", config, 50_000) is not again
