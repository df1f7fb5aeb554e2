import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.cli import main
from core.cameras import Camera, load_calibration
from core.cameras.calibration import Board
from core.events import Events, SensorSize
from core.geometry import make_transform
from core.recordings import RecordingWriter
from tests.board_painter import BoardPainter

pytestmark = pytest.mark.numeric
BOARD = Board("dots", 5, 7, 0.03)
CAMERA = Camera(
    SensorSize(400, 300),
    np.array([[350.0, 0, 202.0], [0, 352.0, 148.0], [0, 0, 1]]),
    np.array([-0.12, 0.03, 0.0005, -0.0004, 0.0]),
    np.eye(4),
)
ARGUMENTS = ["--board", "dots", "--rows", "5", "--columns", "7", "--spacing-mm", "30"]


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    """The board in fourteen poses."""
    rng = np.random.default_rng(3)
    painter = BoardPainter(CAMERA)
    made = []
    for _ in range(14):
        R = Rotation.from_euler("xyz", rng.uniform((-35, -35, -20), (35, 35, 20)), degrees=True).as_matrix()
        depth = rng.uniform(0.42, 0.6)
        middle = np.array([rng.uniform(-0.25, 0.25) * depth, rng.uniform(-0.15, 0.15) * depth, depth])
        made.append(painter.draw(BOARD, make_transform(R, middle - R @ BOARD.points_m.mean(axis=0))))
    return made


@pytest.fixture
def folder(pictures: list[np.ndarray], tmp_path: Path) -> Path:
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"{number:02d}.png"), picture)
    cv2.imwrite(str(tmp_path / "99.png"), np.full((300, 400), 128, np.uint8))
    return tmp_path


def test_a_folder_of_pictures_gives_the_lens_and_a_report(folder: Path, capsys) -> None:
    out, report = folder / "lens.yaml", folder / "report.svg"
    arguments = ["calibrate", "intrinsics", str(folder), *ARGUMENTS, "--out", str(out), "--report", str(report)]
    assert main([*arguments, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["rms_px"] < 0.2 and figures["without_board"] == ["99.png"]
    assert [picture["used"] for picture in figures["pictures"]] == [True] * 14
    found = load_calibration(out)["camera"]
    assert abs(figures["parameters"]["fx"]["value"] - 350.0) < 1.0 and found.sensor == CAMERA.sensor
    np.testing.assert_allclose(found.K, CAMERA.K, atol=1.0)
    assert report.read_text().startswith("<svg") and "pictures with the board in each part" in report.read_text()
    cells = np.array(figures["cover"]["cells"])
    assert cells.shape == (6, 8) and np.count_nonzero(cells) == round(48 * figures["coverage"]) and cells.max() <= 14
    assert len(figures["cover"]["tilts_deg"]) == len(figures["cover"]["distances_m"]) == 14
    assert figures["cover"]["missing"][-1] == "more pictures: 15 or more, here are 14"
    assert 0.4 < min(figures["cover"]["distances_m"]) < max(figures["cover"]["distances_m"]) < 0.62
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "14 pictures, rms" in text and "no whole board in 1 picture: 99.png" in text and "fx 3" in text
    assert "the board was in " in text and "\nmissing: " in text


@pytest.mark.gate
def test_a_blinking_board_before_an_event_camera_gives_the_lens(pictures, tmp_path: Path, capsys) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "blink.h5"
    with RecordingWriter(path, {"left": CAMERA.sensor, "right": CAMERA.sensor}) as writer:
        for number, picture in enumerate(pictures):
            # As many events as the logarithm of the brightness rises above the dark screen's.
            expected = 3 * np.log1p(picture / 25.5)
            counts = np.floor(expected + rng.uniform(size=expected.shape)).astype(int)
            v, u = np.nonzero(counts)
            v, u = np.repeat(v, counts[v, u]), np.repeat(u, counts[v, u])
            t_us = np.sort(100_000 * number + 50_000 + rng.integers(0, 4000, len(u)))
            writer.append("left", Events.from_columns(t_us, u, v, np.ones(len(u), bool), CAMERA.sensor))
        writer.extend_duration(100_000 * len(pictures))
    out = tmp_path / "left.toml"
    arguments = [str(path), *ARGUMENTS, "--camera", "left", "--pictures", "14", "--out", str(out), "--json"]
    assert main(["calibrate", "intrinsics", *arguments]) == 0
    assert len(json.loads(capsys.readouterr().out)["pictures"]) >= 10
    found = load_calibration(out)["left"]
    np.testing.assert_allclose(found.K, CAMERA.K, atol=2.5)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (["--rows", "9"], "no dots of 9 x 7 in any of 15 pictures"),
        (["--rows", "2"], "3 to 100 rows"),
        (["--spacing-mm", "0"], "spacing"),
        (["--pictures", "3"], "expected 6 or more, got 3"),
        (["--out", "no/such/lens.yaml"], "no such folder"),
        (["--out", "lens.txt"], ".yaml or .yml or .toml"),
        (["--report", "report.bmp"], "FILE.svg"),
        (["--board", "stripes"], "stripes"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(folder: Path, capsys, change: list[str], says: str) -> None:
    arguments = ["calibrate", "intrinsics", str(folder), *ARGUMENTS, "--out", str(folder / "lens.yaml"), *change]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error
    assert not (folder / "lens.yaml").exists()


def test_without_a_sub_verb_the_choices_are_named(capsys) -> None:
    assert main(["calibrate"]) == 2
    assert "intrinsics" in capsys.readouterr().err
