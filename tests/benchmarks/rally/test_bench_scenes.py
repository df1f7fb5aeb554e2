"""The bench of the scenes: figures, a report and a picture of each."""

import cv2
import pytest

from benchmarks.rally import bench_scenes
from benchmarks.simulation.scene_picture import WIDTH_PX, picture_of_scene
from core.simulation.scenes.scene import SCENES


def test_a_scene_is_measured_written_up_and_drawn(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(bench_scenes, "SPEEDS_MPS", (5.0,))
    monkeypatch.setattr(bench_scenes, "PLACEMENTS", ("side",))
    report, shares = tmp_path / "scenes.md", []
    found = bench_scenes.run(shares.append, report=report, pictures=tmp_path, scenes=("ball",), balls=1)
    rows = found["rows"]
    assert isinstance(rows, list) and [row["method"] for row in rows] == ["auto", "paper"]
    assert rows[0]["precision"] > 0.9 and rows[0]["recall"] > 0.8 and rows[0]["median_error_px"] < 4
    text = report.read_text()
    assert "| ball | side |" in text and "images/scene-ball.jpg" in text and found["returned"] == {"ball": 1}
    assert shares[-1] == 1.0
    assert cv2.imread(str(tmp_path / "scene-ball.jpg")).shape[1] == WIDTH_PX


def test_every_scene_is_explained() -> None:
    assert set(bench_scenes.WORDS) == set(SCENES)


@pytest.mark.parametrize("scene", ["two-persons", "rally"])
def test_a_picture_of_people_is_brighter_and_has_more_events_than_one_without(tmp_path, scene) -> None:
    for name in ("ball", scene):
        picture_of_scene(name, tmp_path / f"{name}.jpg", seed=31)
    empty, peopled = (cv2.imread(str(tmp_path / f"{name}.jpg")).astype(int) for name in ("ball", scene))
    half = WIDTH_PX // 2
    assert (abs(peopled - empty)[:, :half] > 20).sum() > 2000, "somebody is there"
    saturated = [(image[:, half:].max(axis=2) - image[:, half:].min(axis=2) > 60).sum() for image in (empty, peopled)]
    assert saturated[1] > 1.5 * saturated[0], "and moves"
