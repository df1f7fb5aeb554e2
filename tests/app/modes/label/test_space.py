"""Label's events in space and time, without a browser: which labels are drawn, and what a repeat annotation hides."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.modes.label.plan import LabelScene, centre_at
from app.modes.label.space import LabelSpaceRequest, answer_space, space_request
from app.pictures.palette import CLUSTER_COLOURS, PaletteIndex, palette
from app.state.client_state import ClientState, Configs, History, Playhead, SpaceColour, TuneView
from app.views.space_time import RING, STAVES, TIME_LENGTH, SpaceTime, event_at
from core.detection import DetectorConfig
from labels.assist import Proposals
from labels.model import Label, LabelState
from tests.app.modes.label.test_editor import BALL_US, Bench

RGB = palette("orange / blue")
CYLINDER = 2 * RING + STAVES
CONFIGS = History(Configs(DetectorConfig(), DetectorConfig()))
STATE = ClientState(
    "serve", ("left", "right"), "left", Playhead(1_000_000), CONFIGS, tune=TuneView("clusters", method="auto")
)


@pytest.fixture
def bench(tmp_path: Path, serve_recording: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "labels", serve_recording)
    bench.editor.change_view({"in_space": True, "zoom": 10.0})
    yield bench
    bench.close()


def asked(bench: Bench) -> LabelSpaceRequest:
    scene = LabelScene(bench.work)
    request = space_request(scene, centre_at(scene, bench.work.t_us, None), STATE)
    assert request is not None
    return request


def drawn(bench: Bench) -> SpaceTime:
    return answer_space(asked(bench))


def ball(t_us: int, x_px: float, y_px: float, r_px: float | None = 8.0) -> Label:
    return Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x_px, y_px=y_px, r_px=r_px)


def put(bench: Bench, *labels: Label) -> None:
    bench.editor.write(lambda store: (store.edit(put=labels), ())[1])
    bench.wait()


def test_the_labels_round_the_cursor_are_a_tube_and_the_one_at_the_cursor_goes_through_its_window(bench: Bench) -> None:
    bench.look(BALL_US)
    x, y = bench.truth(BALL_US)
    near = [ball(BALL_US + step * 2_000, x + step, y) for step in range(-2, 3)]
    put(bench, *near, ball(BALL_US + 100_000, x, y))
    space = drawn(bench)
    assert len(space.tube) == 5 * RING + 4 * STAVES, "five labels in a row, and not the one 0.1 s later"
    assert len(space.mark) == CYLINDER and space.mark_rgb == tuple(RGB[PaletteIndex.LABEL])
    assert np.ptp(space.mark[..., 0]) == pytest.approx(np.ptp(space.slab[..., 0])) == pytest.approx(TIME_LENGTH / 17)
    assert space.mark[..., 0].mean() == pytest.approx(0.0, abs=1e-6), "the window is round the cursor"
    assert len(space.points) and "17 windows, 34 ms" in space.note


def test_what_is_proposed_is_drawn_in_its_own_colour_until_it_is_labelled(bench: Bench) -> None:
    bench.look(BALL_US)
    x, y = bench.truth(BALL_US)
    columns = (np.array([value]) for value in (BALL_US, x, y, 8.0, [0.1, 0.0, 0.1]))
    works = dict(bench.work.works)
    works["left"] = replace(works["left"], proposals=Proposals(*columns, 2_000, "made up"))  # type: ignore[misc]
    bench.editor.labelling = replace(bench.work, works=works)
    space = drawn(bench)
    assert len(space.mark) == CYLINDER and space.mark_rgb == tuple(RGB[PaletteIndex.DRAFT]) and not len(space.tube)
    put(bench, ball(BALL_US, x, y))
    assert drawn(bench).mark_rgb == tuple(RGB[PaletteIndex.LABEL])


def test_a_repeat_annotation_shows_the_events_and_no_label(bench: Bench) -> None:
    x, y = bench.truth(BALL_US)
    put(bench, ball(BALL_US, x, y), ball(BALL_US + 2_000, x, y))
    bench.editor.begin_repeat(BALL_US)
    space = drawn(bench)
    assert not len(space.tube) and not len(space.mark) and len(space.points)


@pytest.mark.parametrize(("colour", "inks"), [
    ("stage", range(PaletteIndex.CLUSTER, PaletteIndex.CLUSTER + CLUSTER_COLOURS)),
    ("cluster", range(PaletteIndex.CLUSTER, PaletteIndex.CLUSTER + CLUSTER_COLOURS)),
    ("verdict", [PaletteIndex.HULL]),
])  # fmt: skip
def test_events_show_what_tunes_detector_makes_of_them_where_that_is_asked_for(
    bench: Bench, colour: SpaceColour, inks: Sequence[int]
) -> None:
    bench.look(BALL_US)
    by_polarity = drawn(bench).colours
    bench.editor.change_view({"space_colour": colour})
    space = drawn(bench)
    coloured = (space.colours[:, None] == RGB[list(inks)][None]).all(axis=2).any(axis=1)
    inside = np.abs(space.points[:, 0]) <= np.ptp(space.slab[..., 0]) / 2 + 1e-6
    assert coloured.sum() > 20 and inside[coloured].all(), "the window round the cursor is also the detector's"
    assert np.array_equal(space.colours[~inside], by_polarity[~inside])
    middle_px = float(np.median(space.x_px[coloured])), float(np.median(space.y_px[coloured]))
    assert math.dist(bench.truth(BALL_US), middle_px) < 10.0, "it is the ball"
    bench.editor.begin_repeat(BALL_US)
    hidden = drawn(bench).colours
    bench.editor.change_view({"space_colour": "polarity"})
    assert np.array_equal(hidden, drawn(bench).colours), "a second look is not told what the detector says"


def test_a_label_without_a_radius_is_no_tube(bench: Bench) -> None:
    x, y = bench.truth(BALL_US)
    put(bench, ball(BALL_US, x, y, None), ball(BALL_US + 2_000, x, y))
    bench.look(BALL_US)
    assert len(drawn(bench).tube) == RING


def test_a_click_into_space_means_an_event_of_the_labelled_camera(bench: Bench) -> None:
    bench.look(BALL_US)
    space = drawn(bench)
    eye, event = np.array([-1.0, -2.0, 1.0]), len(space.points) // 2
    found = event_at(space, eye, space.points[event] - eye)
    assert found is not None and asked(bench).region.holds(*found)


def test_the_start_of_a_recording_has_no_windows_before_it(bench: Bench) -> None:
    bench.look(0)
    assert asked(bench).window == (0, 1_000) and "9 windows" in drawn(bench).note
