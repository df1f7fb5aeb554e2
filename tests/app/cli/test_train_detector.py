"""`train-detector yolo`: from recordings to weights that `detect` takes, with a network a sixteenth as wide."""

import csv
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from benchmarks.detector_training import run as training
from benchmarks.detector_training.crops import BallStreak, draw_streak
from benchmarks.detector_training.run import score_sharp
from core.config import save_config
from core.detection.yolo.config import DetectorTrainingConfig, YoloConfig
from core.detection.yolo.weights import load_weights
from core.events import Events, SensorSize
from core.recordings import PixelTruth, RecordingWriter
from tests.waiting import PATIENCE_S, eventually

SENSOR = SensorSize(128, 96)
TINY = DetectorTrainingConfig(
    yolo=YoloConfig(input_width_px=128, input_height_px=96, width=0.0625),
    steps=4, batch=2, crop_px=64, warm_up_steps=1, checkpoint_every=1,
)  # fmt: skip


def write_recording(path: Path, frames: int = 6) -> None:
    """Pictures of an orange disc that moves to the right, and its truth."""
    t_us = np.arange(frames) * 10_000 + 5000
    u = 20.0 + 12 * np.arange(frames)
    images = [
        draw_streak(np.full((96, 128, 3), 60, np.uint8), BallStreak(x_px=x + 0.5, y_px=40.5, r_px=7.0)) for x in u
    ]
    with RecordingWriter(path, {"left": SENSOR}) as writer:
        writer.append("left", Events.from_columns([5], [3], [4], [True], SENSOR))
        if frames:
            writer.write_frames("left", t_us, np.full(frames, 2000), np.stack(images))
        writer.write_truth("left", PixelTruth(t_us, u, np.full(frames, 40.0), np.full(frames, 7.0), u > 0))
        writer.extend_duration(100_000)


@pytest.fixture
def data(tmp_path) -> Path:
    folder = tmp_path / "data"
    folder.mkdir()
    write_recording(folder / "one.h5")
    return folder


@pytest.fixture
def settings(tmp_path) -> Path:
    save_config(TINY, tmp_path / "tiny.toml")
    return tmp_path / "tiny.toml"


@pytest.fixture(autouse=True)
def one_flight(monkeypatch) -> None:
    """The held-out pictures of one flight instead of seven: rendering them is what takes long."""

    def few(weights, device, progress, cancelled):
        return score_sharp(weights, device, progress, cancelled, scenes=(("ball", "side", 9.0),))

    monkeypatch.setattr(training, "score_sharp", few)


@pytest.mark.gate
def test_from_recordings_to_weights_that_detect_takes(data, settings, tmp_path, capsys) -> None:
    out = tmp_path / "weights.safetensors"
    arguments = ["train-detector", "yolo", "--data", str(data), "--config", str(settings), "--device", "cpu"]
    assert main([*arguments, "--out", str(out), "--seed", "3", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    weights = load_weights(out)
    assert said["state"] == "finished" and said["score"]["pictures"] > 4 and weights.score is not None
    assert said["score"]["recall"] == weights.score.recall and weights.training["seed"] == 3
    assert not training.training_folder(out).exists(), "nothing is left beside the weights"

    found = tmp_path / "found.csv"
    detect = ["detect", str(data / "one.h5"), "--method", "yolo", "--weights", str(out), "--out", str(found)]
    assert main([*detect, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["windows"], summary["window_us"], summary["method"]) == (6, 2000, "yolo")
    with found.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == summary["detections"] and {int(row["t_us"]) % 10_000 for row in rows} <= {5000}

    assert main([*arguments, "--out", str(out)]) == 2
    assert "--force" in capsys.readouterr().err


def test_killed_by_ctrl_c_it_goes_on_with_the_same_command(data, tmp_path, capsys) -> None:
    long = DetectorTrainingConfig(yolo=TINY.yolo, steps=100_000, batch=2, crop_px=64, checkpoint_every=1)
    save_config(long, tmp_path / "long.toml")
    out = tmp_path / "weights"
    arguments = ["train-detector", "yolo", "--data", str(data), "--config", str(tmp_path / "long.toml")]
    command = [sys.executable, "-m", "app.cli", *arguments, "--out", str(out)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    checkpoint = training.training_folder(out) / "checkpoint.safetensors"
    eventually(lambda: checkpoint.exists() or process.poll() is not None, "a checkpoint")
    process.send_signal(signal.SIGINT)
    text, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and "the same command continues" in text, error
    assert checkpoint.exists() and not out.exists()
    assert main([*arguments, "--out", str(out), "--seed", "9"]) == 2
    assert "other settings" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--input-size", "640by384"], "WIDTHxHEIGHT"),
        (["--input-size", "650x384"], "multiple of 32"),
        (["--steps", "0"], "steps"),
        (["--data", "no-such-folder"], "no-such-folder"),
        (["--device", "tpu"], "auto, cpu"),
        (["--config", "no-such.toml"], "no-such.toml"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(tmp_path, capsys, arguments: list[str], says: str) -> None:
    assert main(["train-detector", "yolo", "--out", str(tmp_path / "w"), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error
    assert not (tmp_path / "w").exists()


def test_only_yolo_is_trained_here(tmp_path, capsys) -> None:
    assert main(["train-detector", "ebpp", "--out", str(tmp_path / "w")]) == 2
    assert "yolo" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--method", "yolo"], "no pictures"),
        (["--method", "yolo", "--window-us", "2000"], "a picture is a window"),
        (["--method", "yolo", "--config", "x.toml"], "in its weights"),
        (["--method", "paper", "--weights", "w"], "--method yolo"),
    ],
)
def test_detect_says_in_one_line_what_does_not_go_together(tmp_path, capsys, arguments: list[str], says: str) -> None:
    write_recording(tmp_path / "events.h5", frames=0)
    assert main(["detect", str(tmp_path / "events.h5"), "--out", str(tmp_path / "det.csv"), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error
    assert not (tmp_path / "det.csv").exists()


def test_weights_that_are_none_are_one_line(data, tmp_path, capsys) -> None:
    (tmp_path / "w").write_bytes(b"no weights")
    command = ["detect", str(data / "one.h5"), "--method", "yolo", "--weights", str(tmp_path / "w")]
    assert main([*command, "--out", str(tmp_path / "det.csv")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "train-detector yolo" in error
