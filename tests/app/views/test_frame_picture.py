"""Pictures of ordinary cameras beside events: which one, what part of it, and what a click on it means."""

import io
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app.pictures.canvas import Region
from app.state.client_state import RenderSettings, TuneView
from app.state.swept_cells import TableClicks
from app.views.answer_cache import AnswerCache
from app.views.frame_picture import titled_frames, whole_frame
from app.views.mosaic import MosaicTile
from app.views.requests import TuneRequest, WatchRequest, render_tune, render_watch
from core.detection import DetectorConfig
from core.detection.saved import SavedDetector
from core.events import Events, SensorSize
from core.recordings import PixelTruth, RecordingWriter, open_recording
from core.recordings.reader import FileRecording

SIZE = SensorSize(320, 240)
BALL_PX = (100.0, 60.0)
GREY, WHITE = 120, 250


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FileRecording]:
    """`left` has events and pictures through its lens, `rgb` wide pictures only, of which the second is white."""
    path = tmp_path_factory.mktemp("frames") / "frames.h5"
    at_us, exposure_us = np.array([5_000, 25_000, 45_000]), np.full(3, 4_000)
    wide = np.full((3, 90, 2_000, 3), GREY, np.uint8)
    wide[1] = WHITE
    with RecordingWriter(path, {"left": SIZE, "rgb": SensorSize(2_000, 90)}) as writer:
        writer.append("left", Events.from_columns([1000], [3], [2], [True], SIZE))
        writer.write_frames("left", at_us, exposure_us, np.full((3, 240, 320), GREY, np.uint8))
        writer.write_frames("rgb", at_us, exposure_us, wide)
        u, v, r, visible = (np.array([value] * 2) for value in (*BALL_PX, 8.0, True))
        writer.write_truth("left", PixelTruth(np.array([0, 60_000]), u, v, r, visible))
        writer.extend_duration(60_000)
    with open_recording(path) as opened:
        assert isinstance(opened, FileRecording)
        yield opened


def request(recording: FileRecording, frames: str, t_us: int, **view) -> TuneRequest:
    looked = TuneView(method="auto", frames=frames, **view)
    configs = (("A", DetectorConfig()),)
    of_frames = titled_frames(recording)[frames]
    return TuneRequest(
        recording.cameras["left"], t_us, RenderSettings(), looked, configs, AnswerCache(), frames=of_frames
    )


def pixels_of(tile: MosaicTile) -> np.ndarray:
    """(height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(tile.png)).convert("RGB"))


def test_pictures_are_called_as_their_camera_and_otherwise_where_that_is_an_event_camera(recording) -> None:
    assert list(titled_frames(recording)) == ["left frames", "rgb"]


@pytest.mark.parametrize(
    ("t_us", "number", "colour"), [(0, 0, GREY), (16_000, 1, WHITE), (30_000, 1, WHITE), (60_000, 2, GREY)]
)
def test_the_picture_nearest_to_the_cursor_stands_beside_the_events(recording, t_us, number, colour) -> None:
    sheet, found = render_tune(request(recording, "rgb", t_us, zoom=8.0))
    events, beside = sheet.pictures
    assert len(found) == 1 and beside.x >= events.x + events.width
    pixels = pixels_of(beside)
    assert pixels.shape == (45, 1_000, 3) and (pixels == colour).all(), "all of it, not wider than the events"
    mid_ms = (5.0, 25.0, 45.0)[number]
    assert [text.text for text in sheet.texts if text.is_title][
        1
    ] == f"rgb: picture {number}, mid exposure {mid_ms:.3f} ms"
    assert sheet.sensor_point(beside.x + 9, 9) is None, "a click on another camera's picture is on no event"
    assert sheet.sensor_point(9, 9) is not None


def test_one_through_the_lens_of_the_events_shows_the_same_part_and_the_ball_at_its_own_time(recording) -> None:
    wanted = request(recording, "left frames", 30_000, zoom=8.0, centre_px=BALL_PX)
    sheet, _ = render_tune(wanted)
    events, beside = sheet.pictures
    assert beside.region == events.region == Region.around(*BALL_PX, SIZE, 8.0)
    drawn = np.argwhere((pixels_of(beside) != GREY).any(axis=2))
    centre = np.array(beside.sensor_point(*(drawn.mean(axis=0)[::-1] + 0.5 + (beside.x, 0))))
    assert np.abs(centre - BALL_PX).max() < 0.2
    without = replace(wanted, view=replace(wanted.view, show_truth=False))
    assert (pixels_of(render_tune(without)[0].pictures[1]) == GREY).all()


def test_beyond_the_picture_nothing_of_it_is_shown(recording) -> None:
    sheet, _ = render_tune(request(recording, "left frames", 30_000, zoom=8.0, centre_px=(0.0, 0.0), show_truth=False))
    pixels = pixels_of(sheet.pictures[1])
    height, width = pixels.shape[:2]
    assert (pixels[height // 2 + 40 :, width // 2 + 40 :] == GREY).all()
    assert not (pixels[: height // 2 - 40] == GREY).any() and not (pixels[:, : width // 2 - 40] == GREY).any()


def test_both_configs_and_the_picture_share_the_window(recording) -> None:
    one = request(recording, "rgb", 30_000, compare=True, zoom=8.0)
    both = replace(one, configs=(("A", DetectorConfig()), ("B", DetectorConfig())), aspect=3.0)
    sheet, found = render_tune(both)
    assert len(found) == 2 and len(sheet.pictures) == 3
    region = sheet.pictures[0].region
    assert abs(region.width / region.height - 3.0 / 3) < 0.1, "a third of the width that is free"


@pytest.mark.parametrize(("width", "shown"), [(160, 1_280), (1_280, 1_280), (2_000, 1_000)])
def test_a_whole_picture_is_about_as_wide_as_any_other(width: int, shown: int) -> None:
    canvas = whole_frame(np.full((90, width), GREY, np.uint8))
    assert canvas.image.shape[1] == shown and canvas.under is not None and (canvas.under == GREY).all()


def test_all_pictures_of_watch_stand_behind_the_events_once_their_exposure_is_over(recording) -> None:
    look = RenderSettings()
    wanted = WatchRequest(recording, 26_999, look, SavedDetector("auto", DetectorConfig()), False, with_frames=True)
    shown = [replace(wanted, t_us=t_us) for t_us in (3_000, 26_999, 27_000)]
    sheets = [render_watch(one) for one in shown]
    titles = [[text.text for text in sheet.texts if text.is_title][1:] for sheet in sheets]
    assert titles[0] == ["left frames: no picture yet", "rgb: no picture yet"]
    assert titles[1] == ["left frames: picture 0, mid exposure 5.000 ms", "rgb: picture 0, mid exposure 5.000 ms"]
    assert titles[2][1] == "rgb: picture 1, mid exposure 25.000 ms"
    (_, _, before), (_, _, after) = sheets[0].pictures, sheets[2].pictures
    assert (pixels_of(after) == WHITE).all() and len(np.unique(pixels_of(before).reshape(-1, 3), axis=0)) == 1
    assert not (pixels_of(before) == GREY).any(), "nothing of the first picture"


@pytest.mark.parametrize(
    "narrowed", [{"with_frames": False}, {"large": "left"}, {"table": TableClicks(active=True)}]
)  # fmt: skip
def test_they_make_room_where_event_cameras_are_looked_at_alone(recording, narrowed: dict) -> None:
    detector = SavedDetector("auto", DetectorConfig())
    wanted = WatchRequest(recording, 30_000, RenderSettings(), detector, show_truth=False, with_frames=True)
    assert len(render_watch(replace(wanted, **narrowed)).pictures) == 1
