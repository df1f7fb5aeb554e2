"""The small pictures of all cameras: what each found, and whether it is the ball of the others."""

import io
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image

from app.modes.watch.cameras_panel import sighting_of
from app.pictures.palette import PaletteIndex
from app.state.client_state import RenderSettings
from app.views.camera_pictures import CameraPicturesRequest, render_camera_pictures
from core.events import SensorSize
from core.recordings import RecordingWriter, open_recording

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


def test_what_is_not_the_ball_of_the_others_is_ringed_in_another_colour(request_of_four) -> None:
    pngs = render_camera_pictures(request_of_four)
    inks = {name: set(np.unique(np.asarray(Image.open(io.BytesIO(png)))).tolist()) for name, png in pngs.items()}
    assert all(PaletteIndex.CIRCLE in inks[name] for name in "ab") and PaletteIndex.CIRCLE not in inks["c"]
    assert PaletteIndex.HULL_REJECTED in inks["c"] and inks["d"] == {PaletteIndex.BACKGROUND}
    assert all(Image.open(io.BytesIO(png)).width == 320 for png in pngs.values()), "many are small"
