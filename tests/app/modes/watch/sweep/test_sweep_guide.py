"""The guide for a sweep counts cells with the ball in them, twice each, and says where most is missing."""

from dataclasses import replace

import numpy as np
import pytest

from app import theme
from app.modes.watch.sweep.commands import ForgetSweep, GuideSweep, NoteSweptBalls
from app.modes.watch.sweep.words import swept_html
from app.state.client_state import ClientState, Configs, RenderSettings
from app.state.playback import Playhead
from app.state.swept_cells import CELL_COUNT, SweptCells
from app.state.undo import History
from app.views.requests import WatchRequest, render_watch
from core.cameras.calibration.coverage import cell_box, cells_of, coverage
from core.detection import DetectorConfig
from core.detection.config import auto_config
from core.detection.saved import SavedDetector
from core.events import SensorSize
from core.recordings import open_recording

SENSOR = SensorSize(1280, 720)


@pytest.fixture
def state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs)


def test_cells_are_counted_row_by_row_and_their_boxes_hold_their_pixels() -> None:
    corners = [(0, 0), (1279, 0), (0, 719), (1279, 719), (640, 360), (-9, 5000)]
    assert cells_of(corners, SENSOR).tolist() == [0, 7, 40, 47, 28, 40]
    for cell in range(CELL_COUNT):
        left, top, right, bottom = cell_box(cell, SENSOR)
        assert (
            cells_of([((left + right) / 2, (top + bottom) / 2), (left + 0.1, top + 0.1)], SENSOR).tolist() == [cell] * 2
        )
    assert coverage(np.array(corners), SENSOR) == 5 / 48


def test_a_cell_counts_with_the_second_picture_and_only_while_the_guide_is_on(state) -> None:
    seen = NoteSweptBalls((("left", 3), ("other", 5), ("right", 999)))
    assert seen.apply(state, 0.0) is state
    state = GuideSweep(True).apply(state, 0.0)
    once = seen.apply(state, 0.0)
    assert 3 in once.watch.swept.missing("left")
    twice = seen.apply(once, 0.0)
    assert 3 not in twice.watch.swept.missing("left") and len(twice.watch.swept.missing("left")) == 47
    assert len(twice.watch.swept.missing("right")) == 48 and "other" not in twice.watch.swept.counts
    assert seen.apply(twice, 0.0) is twice
    assert ForgetSweep().apply(twice, 0.0).watch.swept == SweptCells(active=True)


def test_it_says_how_much_is_done_and_where_most_is_missing() -> None:
    all_but = {cell: 2 for cell in range(CELL_COUNT) if cell not in (46, 47, 39)}
    swept = SweptCells(True, {"left": tuple(all_but.get(cell, 0) for cell in range(CELL_COUNT))})
    said = swept_html(swept, ("left", "right"))
    assert "45 of 48 parts" in said and "at the lower right" in said and theme.GOOD in said
    assert "0 of 48 parts" in said and theme.WARN in said


def test_a_picture_tells_the_cell_of_the_ball_and_frames_what_is_missing(serve_recording) -> None:
    with open_recording(serve_recording) as recording:
        request = WatchRequest(
            recording, 300_000, RenderSettings(), SavedDetector("auto", auto_config()), show_truth=False
        )
        plain = render_watch(request)
        framed = render_watch(replace(request, swept=SweptCells(active=True)))
        assert [name for name, _ in plain.ball_cells] == ["left", "right"]
        for name, cell in plain.ball_cells:
            truth = recording.cameras[name].truth
            assert truth is not None
            row = int(np.argmin(np.abs(truth.t_us - 300_000)))
            assert cell in cells_of(truth_near(truth, row), SENSOR)
    assert framed.ball_cells == plain.ball_cells
    assert all(len(a.png) != len(b.png) for a, b in zip(plain.pictures, framed.pictures, strict=True))


def truth_near(truth, row: int) -> list[tuple[float, float]]:
    """The true pixel and some round it: the ball may be at the edge of a cell."""
    u, v = float(truth.u_px[row]), float(truth.v_px[row])
    return [(u + du, v + dv) for du in (-9, 0, 9) for dv in (-9, 0, 9)]
