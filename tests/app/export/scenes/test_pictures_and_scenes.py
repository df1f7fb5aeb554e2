"""Films, pictures and 3D scenes, read by other readers than those that wrote them."""

import base64
import json
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
import zstandard
from PIL import Image

from app.cli import main
from app.export.formats import ExportRequest, export
from app.export.scenes.drawn_scene import TABLE_RGB, SceneDrawing
from app.export.selection import Span
from app.export.unfinished import ExportCancelledError
from app.scene.ball import BALL_RGB, CORE_RGB
from app.scene.painted import RING_TO
from app.views.viewpoint import FOV_RAD, Viewpoint
from core.events import SensorSize
from core.history.rally_picture import RallyPicture
from core.recordings import RecordingWriter, open_recording

PART = ["--start-us", "100000", "--end-us", "200000"]


def share_like(image: np.ndarray, rgb: tuple[int, int, int], tolerance: int = 30) -> float:
    return float((np.abs(image.astype(int) - rgb).max(axis=-1) < tolerance).mean())


def scene_content(data: bytes) -> dict[str, Any]:
    """What viser's player reads of a scene: `messages` with their times, `durationSeconds`."""
    unpacked = zstandard.ZstdDecompressor().decompressobj().decompress(data[8:])
    size = int.from_bytes(unpacked[:8], "little")
    return msgspec.msgpack.decode(unpacked[8 : 8 + size])


def clocks(content: dict[str, Any]) -> list[str]:
    """Each text of the clock in the scene."""
    updates = [
        message.get("updates", {}) for _, message in content["messages"] if message.get("name") == "/world/clock"
    ]
    return [update["text"] for update in updates if "text" in update]


def test_the_film_has_a_frame_every_ten_milliseconds(serve_recording: Path, tmp_path, capsys) -> None:
    assert main(["export", str(serve_recording), "--mp4", str(tmp_path / "a.mp4"), *PART, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["format"] == "mp4"
    film = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    frames = []
    while (read := film.read())[0]:
        frames.append(read[1][:, :, ::-1])
    assert len(frames) == 10 and film.get(cv2.CAP_PROP_FPS) == 25
    assert frames[0].shape == (720, 1280, 3)
    assert share_like(frames[0], TABLE_RGB) > 0.05
    assert not np.array_equal(frames[0], frames[-1]), "something moved"


def test_the_picture_shows_table_ball_and_both_cameras(serve_recording: Path, tmp_path) -> None:
    assert main(["export", str(serve_recording), "--png", str(tmp_path / "a.png"), *PART]) == 0
    image = np.asarray(Image.open(tmp_path / "a.png"))
    assert image.shape == (720, 1280, 3) and share_like(image, TABLE_RGB) > 0.05
    assert share_like(image, BALL_RGB) > 0
    for inset in (image[13:190, 13:330], image[13:190, -330:-13]):
        assert share_like(inset, (20, 21, 25), 3) > 0.8, "the background of an event picture"


def test_the_scene_plays_four_times_slower_and_moves_the_ball(serve_recording: Path, tmp_path) -> None:
    assert main(["export", str(serve_recording), "--viser", str(tmp_path / "a.viser"), *PART]) == 0
    content = scene_content((tmp_path / "a.viser").read_bytes())
    assert content["durationSeconds"] == pytest.approx(0.4)
    assert clocks(content)[-1] == "0.200 s (x 1/4)", "its player counts stretched seconds"
    names = {str(message.get("name")) for _, message in content["messages"]}
    assert {"/world/ball", "/world/trail", "/world/table/top", "/world/rig/0", "/world/racket"} <= names
    times = [t for t, message in content["messages"] if message.get("name") == "/world/ball" and t > 0]
    assert len(set(times)) >= 8, "the ball has a place at nearly every moment"


def test_the_web_page_needs_nothing_else(serve_recording: Path, tmp_path) -> None:
    assert main(["export", str(serve_recording), "--html", str(tmp_path / "serve & spin.html"), *PART]) == 0
    page = (tmp_path / "serve & spin.html").read_text()
    assert "<title>serve &amp; spin</title>" in page and "<title>Viser</title>" not in page
    assert "__VISER_EMBED_DATA__" in page and len(page) > 500_000
    assert 'src="http' not in page and 'href="http' not in page


def test_the_web_page_has_the_times_of_the_recording_only(serve_recording: Path, tmp_path) -> None:
    assert main(["export", str(serve_recording), "--html", str(tmp_path / "a.html"), *PART]) == 0
    page = (tmp_path / "a.html").read_text()
    content = scene_content(base64.b64decode(page.split('__VISER_EMBED_DATA__="')[1].split('"')[0]))
    assert content["durationSeconds"] == pytest.approx(0.1)
    assert clocks(content)[-1] == "0.200 s"


@pytest.mark.parametrize("kind", ["mp4", "png", "viser", "html"])
def test_a_recording_without_depth_is_refused_and_leaves_no_file(kind, serve_recording, tmp_path, capsys) -> None:
    with open_recording(serve_recording) as recording:
        left = recording.cameras["left"]
        with RecordingWriter(tmp_path / "one.h5", {"eye": left.sensor}) as writer:
            writer.append("eye", left.slice(0, 50_000))
    assert main(["export", str(tmp_path / "one.h5"), f"--{kind}", str(tmp_path / f"a.{kind}")]) == 2
    assert "3D needs two cameras" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["one.h5"]


@pytest.mark.parametrize("kind", ["mp4", "png", "viser"])
def test_a_cancelled_export_leaves_no_file(kind, serve_recording, tmp_path) -> None:
    asked = iter([False] * 20 + [True] * 1000)
    order = ExportRequest(format=kind, destination=tmp_path / f"a.{kind}")
    with open_recording(serve_recording) as recording, pytest.raises(ExportCancelledError):
        export(order, recording=recording, cancelled=lambda: next(asked))
    assert list(tmp_path.iterdir()) == []


def test_a_ball_is_drawn_where_the_pinhole_says_and_the_net_hides_it() -> None:
    size = SensorSize(800, 600)
    drawing = SceneDrawing(size, Viewpoint((3.0, 0.0, 0.05), (0.0, 0.0, 0.05)), plane_x_m=-1.42)
    ball = RallyPicture(ball=np.array([1.0, 0.0, 0.05]))
    image = drawing.draw(ball)
    radius = 300 / np.tan(FOV_RAD / 2) * 0.02 / 2.0
    core, ring = (np.nonzero(np.abs(image.astype(int) - rgb).max(axis=-1) < 6) for rgb in (CORE_RGB, BALL_RGB))
    for rows, columns in (core, ring):
        assert abs(columns.mean() - 399.5) < 0.6 and abs(rows.mean() - 299.5) < 0.6
    assert len(core[0]) == pytest.approx(np.pi * radius**2, rel=0.3)
    assert len(ring[0]) == pytest.approx(np.pi * radius**2 * (RING_TO**2 - 1), rel=0.5), "less its soft edges"
    behind = drawing.draw(RallyPicture(ball=np.array([-0.3, 0.0, 0.05])))
    assert share_like(behind, BALL_RGB, 10) < share_like(drawing.draw(RallyPicture(ball=np.array([0.3, 0.0, 0.05]))),
                                                         BALL_RGB, 10)  # fmt: skip
    assert not np.array_equal(drawing.draw(RallyPicture()), image), "the drawing keeps nothing of the last moment"
    assert share_like(drawing.draw(RallyPicture()), BALL_RGB, 10) == 0


def test_spans_have_a_length() -> None:
    assert Span(5, 12).length_us == 7
