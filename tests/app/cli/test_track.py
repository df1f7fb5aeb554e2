import csv
import dataclasses
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.cli.track import odd_fall, odd_rays
from core.cameras import Camera, stereo_preset
from core.cameras.presets import camera_preset
from core.chain.follow import Track
from core.config import replace_setting, save_config
from core.detection import auto_config
from core.events import Events
from core.recordings import RecordingWriter

pytestmark = pytest.mark.numeric


def test_the_table_has_a_row_per_point_in_space(serve_recording: Path, tmp_path, capsys) -> None:
    out = tmp_path / "track.csv"
    assert main(["track", str(serve_recording), "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert out.read_text().splitlines()[0] == "t_us,x_m,y_m,z_m,cameras"
    with out.open(newline="") as file:
        rows = np.array([[float(row[name]) for name in ("t_us", "x_m", "y_m", "z_m")] for row in csv.DictReader(file)])
    assert len(rows) == summary["points"] > 300 and summary["windows"] >= 599
    assert (np.diff(rows[:, 0]) > 0).all() and len(set(rows[:, 0] % 1000)) == 1
    assert rows[0, 1] > rows[-1, 1], "it flies towards the robot"
    assert (
        summary["error_mm"]["median"] <= 1.0
        and summary["error_mm"]["p95"] <= 3.0
        and summary["residual_px"]["median"] < 0.2
    )
    assert summary["method"] == "refined" and summary["window_us"] == 1000
    assert summary["seen_by_all_cameras"] >= summary["points"]


def test_several_recordings_make_a_folder_of_the_same_tables(serve_recording: Path, tmp_path, capsys) -> None:
    second, tables = tmp_path / "second.h5", tmp_path / "tables"
    shutil.copy(serve_recording, second)
    arguments = ["track", str(serve_recording), str(second), "--out", str(tables), "--jobs", "2"]
    assert main(arguments) == 0
    assert capsys.readouterr().out.count("points in") == 2
    first, other = ((tables / f"{path.stem}.csv").read_bytes() for path in (serve_recording, second))
    assert first == other and first.count(b"\n") > 100


def test_the_paper_s_stages_are_asked_half_as_often(serve_recording: Path, tmp_path, capsys) -> None:
    arguments = ["track", str(serve_recording), "--method", "auto", "--out", str(tmp_path / "track.csv"), "--json"]
    assert main(arguments) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["window_us"] == 2000 and summary["points"] > 100 and summary["windows"] >= 299
    assert summary["error_mm"]["median"] < 8 and summary["residual_px"]["median"] < 2


@pytest.mark.parametrize("method", ["ebpp", "fe-fusion"])
def test_the_answers_of_a_rival_meet_in_space(serve_recording, tmp_path, capsys, method: str) -> None:
    arguments = ["track", str(serve_recording), "--method", method, "--out", str(tmp_path / "track.csv"), "--json"]
    assert main(arguments) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["method"] == method and summary["points"] > 30
    assert summary["error_mm"]["median"] < 20


def test_without_json_a_person_reads_the_same_figures(serve_recording: Path, tmp_path, capsys) -> None:
    assert main(["track", str(serve_recording), "--method", "paper", "--out", str(tmp_path / "track.csv")]) == 0
    text = capsys.readouterr().out
    assert "points in" in text and "residual px" in text and "3D error mm" in text


def test_the_config_and_the_window_count(serve_recording: Path, tmp_path, capsys) -> None:
    blind = replace_setting(replace_setting(auto_config(), ("cluster", "size_max"), 40), ("window", "window_us"), 4000)
    save_config(blind, tmp_path / "blind.toml")
    arguments = ["track", str(serve_recording), "--config", str(tmp_path / "blind.toml"), "--json"]
    assert main([*arguments, "--out", str(tmp_path / "a.csv")]) == 0
    assert main([*arguments, "--out", str(tmp_path / "b.csv"), "--window-us", "5000"]) == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert (first["window_us"], first["points"], first["error_mm"], first["residual_px"]) == (4000, 0, None, None)
    assert second["window_us"] == 5000
    assert (tmp_path / "a.csv").read_text() == "t_us,x_m,y_m,z_m,cameras\n", "no row when there is no point"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--method", "yolo"], "rallyscope detect --method yolo"),
        (["--method", "magic"], "auto | paper"),
        (["--config", "no-such.toml"], "no-such.toml"),
        (["--window-us", "0"], "window-us"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(serve_recording, tmp_path, capsys, arguments: list[str], says: str) -> None:
    assert main(["track", str(serve_recording), "--out", str(tmp_path / "track.csv"), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error
    assert not (tmp_path / "track.csv").exists()


def test_cameras_that_cannot_see_depth_are_refused(tmp_path, capsys) -> None:
    cameras = stereo_preset()
    sensors = {name: camera.sensor for name, camera in cameras.items()}
    with RecordingWriter(tmp_path / "bare.h5", sensors) as writer:
        writer.extend_duration(10_000)
    assert main(["track", str(tmp_path / "bare.h5"), "--out", str(tmp_path / "track.csv")]) == 2
    assert "--calibration" in capsys.readouterr().err
    left = {"left": cameras["left"]}
    with RecordingWriter(tmp_path / "one.h5", {"left": sensors["left"]}, calibration=left) as writer:
        writer.extend_duration(10_000)
    assert main(["track", str(tmp_path / "one.h5"), "--out", str(tmp_path / "track.csv")]) == 2
    assert "two cameras" in capsys.readouterr().err


def test_a_folder_that_is_not_there_is_noticed_before_the_work(serve_recording, tmp_path, capsys) -> None:
    assert main(["track", str(serve_recording), "--out", str(tmp_path / "nowhere" / "track.csv")]) == 2
    assert "nowhere" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("points", "residual_px", "seen", "says"),
    [
        (240, 0.5, 245, None),
        (5, 0.1, 19, None),
        (42, 0.3, 240, "meet in 42 only.*--names.*--offset-us"),
        (225, 1.8, 245, "miss each other by 1.8 px"),
        (0, 0.0, 30, "in 30 windows, but their rays meet in 0"),
        (0, 0.0, 0, "no window has a ball in every camera"),
        (240, 0.3, 0, None),
    ],
)
def test_rays_that_do_not_meet_are_said_with_the_causes(points, residual_px, seen, says: str | None) -> None:
    times = np.arange(points)
    track = Track(times, np.zeros((points, 3)), np.full(points, residual_px), 250, seen, np.zeros(250))
    notes = odd_rays(track)
    assert len(notes) == (says is not None)
    assert says is None or re.search(says, notes[0])


def test_a_ball_that_falls_upwards_is_said_where_the_world_is_the_table_s() -> None:
    """Pictures counted from the bottom, as calibration and events, gave a track below the table without a word."""
    t_s = np.arange(0, 0.4, 0.002)
    error = np.random.default_rng(0).normal(0, 0.001, (len(t_s), 3))
    fall = np.stack([1.2 - 5 * t_s, 0 * t_s, 0.3 + t_s - 4.905 * t_s**2], axis=1) + error

    def track_of(ps_m: np.ndarray) -> Track:
        count = len(t_s)
        return Track((1e6 * t_s).astype(np.int64), ps_m, np.zeros(count), count, count, np.zeros(count))

    table = stereo_preset()
    lens: Camera = dataclasses.replace(table["left"], T_world_camera=np.eye(4))
    assert odd_fall(track_of(fall), table) == []
    (note,) = odd_fall(track_of(fall * (1, 1, -1)), table)
    assert "the ball falls upwards, with 9." in note and "from the bottom of the picture" in note
    assert odd_fall(track_of(fall * (1, 1, -1)), {"left": lens, "right": table["right"]}) == []
    assert odd_fall(track_of(fall * (1, 1, 0)), table) == []


def test_calibrated_frame_cameras_are_used_too_unless_that_is_not_wanted(tmp_path, capsys) -> None:
    rig = {name: camera for name, camera in camera_preset("corners").items() if name != "far_right"}
    sizes = {name: camera.sensor for name, camera in rig.items()}
    with RecordingWriter(tmp_path / "rig.h5", sizes, calibration=rig) as writer:
        for name in ("near_left", "near_right"):
            writer.append(name, Events.from_columns([1000], [3], [2], [True], sizes[name]))
        writer.write_frames("far_left", np.array([5_000]), np.array([4_000]), np.zeros((1, 72, 128, 3), np.uint8))
        writer.extend_duration(20_000)
    words = ["track", str(tmp_path / "rig.h5"), "--out", str(tmp_path / "track.csv")]
    summaries = []
    for more in ([], ["--events-only"]):
        assert main([*words, *more, "--json"]) == 0
        summaries.append(json.loads(capsys.readouterr().out))
    assert [one["frame_cameras"] for one in summaries] == [["far_left"], []]
    assert summaries[0]["single_pixels_of_camera"] == {"near_left": 0, "near_right": 0, "far_left": 0}
    assert summaries[1]["points_of_camera"] == {"near_left": 0, "near_right": 0}
    assert main(words) == 0
    assert "pictures that moved the flight: 0 of far_left" in capsys.readouterr().out
