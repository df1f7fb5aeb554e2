"""Clicks on corners: numbered, undone, and never those of a camera that is not there."""

import numpy as np
import pytest

from app.modes.watch.table import (
    ChooseTableCorner,
    ClickTableCorner,
    ForgetTableCorners,
    LetTableBeClicked,
    PosesRequest,
    UndoTableCorner,
    corner_option,
    find_poses,
    poses_html,
)
from app.pictures.canvas import Canvas, Region
from app.pictures.palette import PaletteIndex
from app.state.client_state import ClientState, Configs, History, Playhead
from app.state.swept_cells import CORNER_NAMES, TableClicks
from app.views.requests import draw_table_clicks
from core.cameras import stereo_preset
from core.cameras.calibration.table_corners import CORNERS
from core.detection import DetectorConfig

PAIR = stereo_preset("behind")


@pytest.fixture
def client_state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs)


def apply(state: ClientState, *commands) -> ClientState:
    for command in commands:
        state = command.apply(state, 0.0)
    return state


def begun(first_state) -> ClientState:
    return apply(first_state, LetTableBeClicked(True))


def clicks_in(camera: str, corners: tuple[str, ...] = CORNER_NAMES) -> TableClicks:
    clicks = TableClicks(active=True)
    for corner in corners:
        u, v = PAIR[camera].project(np.array([CORNERS[corner]]))[0].tolist()
        clicks = TableClicks(True, corner, clicks.marks).clicked(camera, u, v)
    return clicks


def test_clicks_go_from_corner_to_corner_and_back(client_state) -> None:
    state = apply(begun(client_state), ClickTableCorner("left", 10.0, 20.0), ClickTableCorner("left", 30.0, 40.0))
    table = state.watch.table
    assert [(mark.number, mark.corner) for mark in table.marks] == [(1, "robot-left"), (2, "robot-right")]
    assert table.corner == "opponent-left"
    undone = apply(state, UndoTableCorner()).watch.table
    assert undone.corner == "robot-right" and len(undone.marks) == 1
    moved = apply(state, ChooseTableCorner("robot-left"), ClickTableCorner("left", 11.0, 21.0)).watch.table
    assert moved.of("left") == {"robot-right": (30.0, 40.0), "robot-left": (11.0, 21.0)}
    assert moved.corner == "opponent-left"
    assert apply(state, ForgetTableCorners()).watch.table == TableClicks(active=True)


def test_clicks_are_only_taken_while_they_are_wanted_and_of_cameras_that_are_there(client_state) -> None:
    click = ClickTableCorner("left", 10.0, 20.0)
    assert not apply(client_state, click).watch.table.marks
    refused = (ClickTableCorner("other", 1.0, 2.0), ClickTableCorner("left", float("nan"), 2.0))
    assert not apply(begun(client_state), *refused, ChooseTableCorner("roof"), UndoTableCorner()).watch.table.marks


def test_it_says_how_well_the_corners_fit_or_what_is_missing() -> None:
    found = find_poses(PosesRequest({"left": PAIR["left"], "right": PAIR["right"], "top": None}, clicks_in("left")))
    said = poses_html(found)
    assert "0.0 px off" in said and "stands at -2.40, +0.90, +1.30 m" in said
    assert "0 of 4 corners or more" in said and "unknown lens" in said
    assert corner_option("robot-right") == "2 robot-right"


def test_marks_are_numbered_and_the_table_that_fits_them_is_drawn() -> None:
    canvas = Canvas(Region.of_sensor(PAIR["left"].sensor))
    draw_table_clicks(canvas, "left", PAIR["left"], clicks_in("left"))
    inside = [text.text for text in canvas.texts]
    assert inside and set(inside) <= {str(number) for number in range(1, 11)}
    assert (canvas.image == PaletteIndex.EPIPOLAR).sum() > 1000 and (canvas.image == PaletteIndex.LABEL).any()
    few = Canvas(Region.of_sensor(PAIR["left"].sensor))
    draw_table_clicks(few, "left", PAIR["left"], clicks_in("left", CORNER_NAMES[:3]))
    assert not (few.image == PaletteIndex.EPIPOLAR).any()
