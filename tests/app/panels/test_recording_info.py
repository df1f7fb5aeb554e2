"""What the tab Health says of a recording: only what is wrong is red."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app import theme
from app.panels.recording_info import RecordingInfo, gather_info, harmless_hot_pixels, health_html
from app.shared.library import Library
from app.shared.workspace import Workspace
from core.events import Health
from core.recordings import ImportOrder, import_recording
from tests.frames_beside_events import write_frames_beside_events


def test_where_a_recording_came_from_is_no_fault(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    source = tmp_path / "clip.csv"
    rows = "\n".join(f"{10 * k},{k % 30},{k % 20},{k % 2}" for k in range(5000))
    source.write_text(f"t,x,y,p\n{rows}\n")
    import_recording(ImportOrder([source]), workspace.recording_path("clip"))
    library = Library(workspace)
    said = health_html(gather_info(library, "clip"))
    library.close()
    line = next(part for part in said.split("<div") if "Imported from" in part)
    assert theme.BAD not in line and theme.MUTED in line


def test_a_camera_without_events_is_a_problem() -> None:
    silent = Health(0, 1_000_000, 0.0, 0.0, np.nan, np.zeros((0, 2), np.int64), ())
    said = health_html(RecordingInfo("demo", {}, {"left": silent}, {"left": HD}, ()))
    assert "left: no events in the whole recording" in said and "no problems found" not in said


HD = 1280 * 720


@pytest.mark.parametrize(("hot", "red"), [(9, False), (92, False), (93, True)])
def test_hot_pixels_are_red_only_where_they_are_many(hot: int, red: bool) -> None:
    places = np.arange(2 * hot, dtype=np.int64).reshape(-1, 2)
    health = Health(1000, 1_000_000, 1e3, 2e3, 0.5, places, ())
    said = health_html(RecordingInfo("demo", {}, {"left": health}, {"left": HD}, ()))
    assert (theme.BAD in said) == red and ("no problems found" in said) != red
    assert f"left: {hot} hot pixels" in said and str(harmless_hot_pixels(HD)) in said and "(0, 1)" in said


def test_ordinary_cameras_have_a_line_of_their_pictures(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    write_frames_beside_events(workspace.recording_path("frames"))
    library = Library(workspace)
    info = gather_info(library, "frames")
    library.close()
    assert "far_left: 3 pictures, 50.0 per second, at most 20.0 ms apart" in health_html(info)
    assert "far_left: 1 picture<" in health_html(replace(info, frames={"far_left": np.array([7])}))
