"""A window's events in space and time: where points lie, what colours them, what is left out."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.pictures.canvas import Region
from app.pictures.palette import PaletteIndex, palette
from app.state.client_state import RenderSettings, SpaceColour, TuneView
from app.views import space_time
from app.views.answer_cache import AnswerCache
from app.views.requests import TuneRequest, answer_request
from app.views.space_time import (
    TIME_LENGTH,
    SpaceTime,
    SpaceTimeBox,
    count_note,
    event_at,
    round_values,
    thinned,
    tube_of,
)
from core.detection.methods import Method, method_config
from core.metrics.run import WindowAnswers
from core.recordings import CameraStream, open_recording

BALL_US = 300_000
BOX = SpaceTimeBox(Region(100, 50, 81, 41), 1_000, 5_000)
RGB = palette("orange / blue")


@pytest.fixture(scope="module")
def stream(serve_recording: Path) -> Iterator[CameraStream]:
    with open_recording(serve_recording) as recording:
        yield recording.cameras["left"]


def request(stream: CameraStream, method: Method, **view) -> TuneRequest:
    looked = replace(TuneView(method=method, in_space=True, zoom=8.0), **view)
    configs = (("A", method_config(method)),)
    return TuneRequest(stream, BALL_US, RenderSettings(), looked, configs, AnswerCache())


def space_of(stream: CameraStream, method: Method = "auto", **view) -> SpaceTime:
    space = answer_request(request(stream, method, **view)).space
    assert space is not None
    return space


def answers(*circles: tuple[int, float, float, float]) -> WindowAnswers:
    t, u, v, r = np.array(circles, np.float64).reshape(-1, 4).T
    return WindowAnswers(t.astype(np.int64), t.astype(np.int64), u, v, r, np.ones(len(t), np.int32))


def test_the_middle_of_the_region_and_of_the_time_is_the_middle_of_the_box() -> None:
    assert BOX.places(140, 70, 3_000) == pytest.approx(np.zeros((1, 3)), abs=1e-6)


def test_later_is_forward_right_in_the_picture_is_right_and_down_is_down() -> None:
    middle, later, right, down = BOX.places([140, 140, 150, 140], [70, 70, 70, 80], [3_000, 4_000, 3_000, 3_000])
    assert later - middle == pytest.approx([TIME_LENGTH / 4, 0, 0])
    assert right - middle == pytest.approx([0, -10 / 81, 0])
    assert down - middle == pytest.approx([0, 0, -10 / 81]), "a pixel is as long either way: circles stay circles"


def test_the_box_has_twelve_edges_and_the_window_is_a_slab_in_it() -> None:
    frame, slab = BOX.edges(1_000, 5_000), BOX.edges(4_000, 5_000)
    assert frame.shape == slab.shape == (12, 2, 3)
    lengths = np.linalg.norm(frame[:, 1] - frame[:, 0], axis=1)
    assert sorted(lengths) == pytest.approx(sorted([TIME_LENGTH, 1.0, 41 / 81] * 4))
    assert np.ptp(slab[..., 0]) == pytest.approx(TIME_LENGTH / 4)


def test_a_tube_is_rings_round_the_balls_and_lines_between_neighbouring_ones() -> None:
    ball, none = (2_000, 140.0, 70.0, 8.1), (3_000, np.nan, np.nan, np.nan)
    (ring,) = [tube_of(BOX, answers(ball, none), 1_000)]
    away = np.linalg.norm(ring[:, 0, 1:], axis=1)
    assert away == pytest.approx(np.full(space_time.RING, 0.1), abs=1e-6)
    joined = tube_of(BOX, answers(ball, (3_000, 141.0, 70.0, 8.1)), 1_000)
    assert len(joined) == 2 * space_time.RING + space_time.STAVES
    apart = tube_of(BOX, answers(ball, (4_000, 141.0, 70.0, 8.1)), 1_000)
    assert len(apart) == 2 * space_time.RING, "nothing is known of the window between"


def test_a_ball_outside_of_the_region_has_no_tube() -> None:
    assert len(tube_of(BOX, answers((2_000, 300.0, 70.0, 8.0)), 1_000)) == 0


def test_thinning_is_even_and_is_said() -> None:
    kept = thinned(100_000, 30_000)
    assert len(kept) == 30_000 and kept[0] == 0 and kept[-1] == 99_999
    assert set(np.diff(kept)) == {3, 4}
    assert np.array_equal(thinned(5, 30_000), np.arange(5))
    assert count_note(30_000, 75_000) == "30,000 of 75,000 events drawn, 1 in 2.5,"
    assert count_note(5, 5) == "5 events"


def test_a_window_with_many_events_is_thinned(stream: CameraStream, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = space_of(stream)
    monkeypatch.setattr(space_time, "MOST_POINTS", 100)
    few = space_of(stream)
    assert len(few.points) == len(few.colours) == len(few.x_px) == 100 < len(whole.points)
    assert few.note.startswith(f"100 of {len(whole.points):,} events drawn")


def test_points_are_in_the_box_of_the_zoomed_region_and_go_through_time(stream: CameraStream) -> None:
    space = space_of(stream)
    assert space.points.dtype == np.float32 and space.colours.dtype == np.uint8
    assert (np.abs(space.points) <= (TIME_LENGTH / 2, 0.5, 0.5)).all()
    assert (np.diff(space.points[:, 0]) >= 0).all()
    assert "17 windows, 34 ms" in space.note
    assert len(space.tube) > space_time.RING and len(space.truth)


@pytest.mark.parametrize(("colour", "stage", "ink"), [
    ("stage", "clusters", None),
    ("cluster", "result", None),
    ("polarity", "clusters", PaletteIndex.ON),
    ("verdict", "result", PaletteIndex.HULL),
])  # fmt: skip
def test_the_events_of_the_window_are_coloured_and_the_neighbours_are_dim(
    stream: CameraStream, colour: SpaceColour, stage: str, ink: int | None
) -> None:
    space = space_of(stream, space_colour=colour, overlay=stage)
    slab = space.slab[..., 0]
    inside = (space.points[:, 0] >= slab.min()) & (space.points[:, 0] < slab.max() - 1e-4)
    bright = RGB[PaletteIndex.CLUSTER : PaletteIndex.CLUSTER + 12] if ink is None else RGB[[ink]]
    has_it = (space.colours[:, None] == bright[None]).all(axis=2).any(axis=1)
    assert has_it[inside].any()
    dim = RGB[[PaletteIndex.ON_DIM, PaletteIndex.OFF_DIM]]
    assert (space.colours[space.points[:, 0] < slab.min() - 1e-4][:, None] == dim).all(axis=2).any(axis=1).all()


def test_refined_shows_its_track_as_a_tube_with_a_ring_for_each_window(stream: CameraStream) -> None:
    space = space_of(stream, "refined")
    assert len(space.tube) > 10 * space_time.RING
    centres = space.tube[: space_time.RING, 0].mean(axis=0)
    assert np.linalg.norm(space.truth[:, 0] - centres, axis=1).min() < 0.1, "it goes along the true path"


def test_a_click_means_the_event_nearest_to_its_ray(stream: CameraStream) -> None:
    space = space_of(stream)
    eye, event = np.array([-1.0, -2.0, 1.0]), len(space.points) // 2
    found = event_at(space, eye, 3.0 * (space.points[event] - eye))
    assert found is not None
    assert found == pytest.approx((space.x_px[event], space.y_px[event]), abs=3)
    assert event_at(space, eye, (0.0, 0.0, 1.0)) is None
    assert event_at(space, eye, eye - space.points[event]) is None, "behind the eye"


def test_at_the_start_and_without_events_there_is_an_empty_box(stream: CameraStream) -> None:
    early = replace(request(stream, "auto"), t_us=0)
    space = answer_request(early).space
    assert space is not None and len(space.frame) == 12 and "in 9 windows" in space.note
    far = replace(request(stream, "auto", centre_px=(-5_000.0, -5_000.0)))
    nothing = answer_request(far).space
    assert nothing is not None and nothing.points.shape == (0, 3) and nothing.note.startswith("0 events")
    assert event_at(nothing, (0, 0, -3), (0, 0, 1)) is None


def test_ticks_are_round_values_with_units(stream: CameraStream) -> None:
    assert round_values(-16.0, 1.0) == [-15, -10, -5, 0]
    assert round_values(99.5, 260.5) == [100, 150, 200, 250]
    texts = [tick.text for tick in space_of(stream).ticks]
    assert "t = 0 ms" in texts and any(text.startswith("x ") and text.endswith(" px") for text in texts)
    assert any(text.startswith("y ") for text in texts)
