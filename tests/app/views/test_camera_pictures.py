"""The small pictures of all cameras: what each found, and whether it is the ball of the others."""

import io
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app.modes.watch.cameras_panel import SIGHTING_MARKS, sighting_of
from app.pictures.palette import PaletteIndex
from app.state.client_state import RenderSettings
from app.views.camera_pictures import (
    NO_PICTURE,
    CameraPicturesRequest,
    LargeFrameRequest,
    frame_sightings,
    render_camera_pictures,
    render_large_frame,
    with_frames,
)
from core.chain.chain import ChainState, StageSeconds
from core.chain.control.player import PlayerState
from core.detection import Detection
from core.events import SensorSize
from core.history.rally_history import RallyHistory
from core.recordings import RecordingWriter, open_recording
from core.recordings.reader import FileRecording
from tests.frames_beside_events import write_frames_beside_events

SIZE = SensorSize(1280, 720)
NAMES = ("a", "b", "c", "d")


@pytest.fixture
def request_of_four(tmp_path) -> Iterator[CameraPicturesRequest]:
    with RecordingWriter(tmp_path / "four.h5", dict.fromkeys(NAMES, SIZE)):
        pass
    circles = {"a": (600.0, 300.0, 8.0), "b": (200.0, 500.0, 8.0), "c": (900.0, 100.0, 8.0)}
    with open_recording(tmp_path / "four.h5") as recording:
        yield CameraPicturesRequest(recording, 5_000, RenderSettings(), circles, False, frozenset({"a", "b"}))


def test_each_camera_of_many_has_a_mark_of_what_it_found(request_of_four) -> None:
    assert [sighting_of(request_of_four, name) for name in NAMES] == ["used", "used", "elsewhere", "none"]


def test_where_the_chain_has_not_come_yet_nobody_is_said_to_see_no_ball(request_of_four) -> None:
    waiting = replace(request_of_four, circles={}, used=frozenset(), reached=False)
    assert {sighting_of(waiting, name) for name in NAMES} == {"unknown"} and SIGHTING_MARKS["unknown"] == ""
    assert waiting.key != replace(waiting, reached=True).key


def test_what_is_not_the_ball_of_the_others_is_ringed_in_another_colour(request_of_four) -> None:
    pngs = render_camera_pictures(request_of_four)
    inks = {name: set(np.unique(np.asarray(Image.open(io.BytesIO(png)))).tolist()) for name, png in pngs.items()}
    assert all(PaletteIndex.CIRCLE in inks[name] for name in "ab") and PaletteIndex.CIRCLE not in inks["c"]
    assert PaletteIndex.HULL_REJECTED in inks["c"] and inks["d"] == {PaletteIndex.BACKGROUND}
    assert all(Image.open(io.BytesIO(png)).width == 320 for png in pngs.values()), "many are small"


@pytest.fixture
def rig_with_frames(tmp_path) -> Iterator[FileRecording]:
    """Two event cameras, and three grey pictures of another, whose exposures end at 7, 27 and 47 ms."""
    write_frames_beside_events(tmp_path / "frames.h5")
    with open_recording(tmp_path / "frames.h5") as recording:
        assert isinstance(recording, FileRecording)
        yield recording


def history_of(circles_at: dict[int, tuple[float, float, float]], used_at: set[int]) -> RallyHistory:
    """Steps of 2 ms; in those at some times the frame camera found something, and it moved the flight."""
    history = RallyHistory()
    for t_us in range(2_000, 60_000, 2_000):
        found = circles_at.get(t_us)
        chain = ChainState(
            t_us=t_us,
            detections={} if found is None else {"far_left": Detection(t_us, *found)},
            point=None,
            verdict=None,
            prediction=None,
            is_new=False,
            bounces_us=(),
            seconds=StageSeconds(0.0, 0.0, 0.0),
            single={"far_left": (1.0, 1.0)} if t_us in used_at else {},
        )
        history.add_step(PlayerState(chain, None, False, 0.0))
    return history


def test_what_was_found_in_a_picture_belongs_to_it_until_the_next_one(rig_with_frames) -> None:
    circle, other = (600.0, 300.0, 8.0), (200.0, 100.0, 8.0)
    history, frames = history_of({8_000: circle, 28_000: other}, {8_000}), rig_with_frames.frames
    seen = {t_us: frame_sightings(history, frames, t_us) for t_us in (6_999, 7_500, 8_000, 26_999, 28_000, 50_000)}
    assert seen[6_999]["far_left"] == (NO_PICTURE, None, False), "the exposure of the first picture is not over"
    assert seen[7_500]["far_left"] == (0, None, False), "the chain has not looked at it"
    assert seen[8_000]["far_left"] == seen[26_999]["far_left"] == (0, circle, True)
    assert seen[28_000]["far_left"] == (1, other, False)
    assert seen[50_000]["far_left"] == (2, None, False)


def test_a_step_is_shown_with_what_the_newest_pictures_say(rig_with_frames) -> None:
    circle = (600.0, 300.0, 8.0)
    history = history_of({8_000: circle}, {8_000})
    step = history.at(20_000, {}).step
    assert step is not None and step.circles == {} and step.used == frozenset()
    shown = with_frames(step, frame_sightings(history, rig_with_frames.frames, 20_000))
    assert shown.circles == {"far_left": circle} and shown.used == {"far_left"}
    requests = [
        CameraPicturesRequest(rig_with_frames, 0, RenderSettings(), {}, False, one.used) for one in (shown, step)
    ]
    assert len({request.key for request in requests}) == 2, "pictures are kept by what they show"
    assert with_frames(step, {}).used == step.used and hash(with_frames(step, {}).used)


def test_a_picture_stands_behind_the_event_cameras_in_its_own_colours_with_its_circle(rig_with_frames) -> None:
    circles, used = {"far_left": (600.0, 300.0, 8.0)}, frozenset({"far_left"})
    request = CameraPicturesRequest(rig_with_frames, 20_000, RenderSettings(), circles, False, used, (("far_left", 1),))
    pngs = render_camera_pictures(request)
    assert list(pngs) == ["near_left", "near_right", "far_left"]
    pixels = np.asarray(Image.open(io.BytesIO(pngs["far_left"])).convert("RGB"))
    assert pixels.shape == (180, 320, 3) and (pixels[0, 0] == 120).all()
    coloured = np.argwhere((pixels != 120).any(axis=2))
    assert len(coloured) and np.abs(coloured.mean(axis=0) - (75, 150)).max() < 2, "a ring round the ball"
    assert request.key != replace(request, frames=(("far_left", 2),)).key
    assert sighting_of(request, "far_left") == "used"


def test_a_frame_camera_has_its_place_before_its_first_picture(rig_with_frames) -> None:
    frames = (("far_left", NO_PICTURE),)
    request = CameraPicturesRequest(rig_with_frames, 1_000, RenderSettings(), {}, False, frozenset(), frames)
    png = render_camera_pictures(request)["far_left"]
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).reshape(-1, 3)
    assert not (pixels == 120).all(axis=1).any(), "nothing of the first picture"
    assert len(np.unique(pixels, axis=0)) > 1, "it says so"
    assert sighting_of(request, "far_left") == "none"


def test_a_frame_full_size_has_its_own_colours_what_was_found_and_when_it_was_taken(rig_with_frames) -> None:
    circles, used = {"far_left": (600.0, 300.0, 8.0)}, frozenset({"far_left"})
    small = CameraPicturesRequest(rig_with_frames, 30_000, RenderSettings(), circles, False, used, (("far_left", 1),))
    request = LargeFrameRequest("far_left", small)
    sheet = render_large_frame(request)
    (tile,) = sheet.pictures
    pixels = np.asarray(Image.open(io.BytesIO(tile.png)).convert("RGB"))
    assert pixels.shape == (720, 1280, 3) and (pixels[0, 0] == 120).all()
    coloured = np.argwhere((pixels != 120).any(axis=2))
    assert np.abs(coloured.mean(axis=0) - (300, 600)).max() < 1 and np.ptp(coloured, axis=0).max() < 24
    assert [text.text for text in sheet.texts] == ["far_left: picture 1, mid exposure 25.000 ms"]
    assert tile.sensor_point(640.5, 360.5) == (640.0, 360.0)
    later = LargeFrameRequest("far_left", replace(small, t_us=40_000))
    assert later.key == request.key, "until the next picture nothing is drawn again"
    next_one = replace(small, frames=(("far_left", 2),))
    assert len({LargeFrameRequest("far_left", one).key for one in (small, next_one, replace(small, circles={}))}) == 3


def test_full_size_before_the_first_frame_says_that_there_is_none(rig_with_frames) -> None:
    frames = (("far_left", NO_PICTURE),)
    small = CameraPicturesRequest(rig_with_frames, 1_000, RenderSettings(), {}, False, frozenset(), frames)
    sheet = render_large_frame(LargeFrameRequest("far_left", small))
    assert [text.text for text in sheet.texts] == ["far_left: no picture yet"]
    pixels = np.asarray(Image.open(io.BytesIO(sheet.pictures[0].png)).convert("RGB")).reshape(-1, 3)
    assert len(np.unique(pixels, axis=0)) == 1 and (sheet.width, sheet.height) == (1280, 720)
