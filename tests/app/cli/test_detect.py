import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from benchmarks.detection.bench_detection import simulate_flights
from core.config import replace_setting, save_config
from core.detection import auto_config
from core.detection.methods import method_config
from core.detection.saved import RIMLESS
from core.recordings import RecordingWriter
from tests.drawn_glow import SENSOR, draw_glow

pytestmark = pytest.mark.numeric


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """Two simulated cameras, 0.4 s, with the truth."""
    path = tmp_path_factory.mktemp("detect") / "flight.h5"
    streams = simulate_flights("ball", 0.1, (6.0,), seed=4)
    with RecordingWriter(path, {stream.name: stream.sensor for stream in streams}) as writer:
        for stream in streams:
            writer.append(stream.name, stream.slice(0, 400_000))
            writer.write_truth(stream.name, stream.truth)
        writer.extend_duration(400_000)
    return path


def detect(recording: Path, out: Path, *more: str) -> int:
    return main(["detect", str(recording), "--out", str(out), *more])


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_has_a_row_per_detection_with_the_columns_of_the_contract(recording, tmp_path, capsys) -> None:
    out = tmp_path / "det.csv"
    assert detect(recording, out, "--camera", "left", "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    rows = rows_of(out)
    assert out.read_text().splitlines()[0] == "t_us,u_px,v_px,r_px"
    assert len(rows) == summary["detections"] > 100 and summary["windows"] >= 390
    times = np.array([int(row["t_us"]) for row in rows])
    assert (np.diff(times) > 0).all() and len(set(times % 1000)) == 1, "as long after the end of each window"
    assert all(0 <= float(row["u_px"]) < 1280 and 0 <= float(row["v_px"]) < 720 for row in rows)
    assert summary["score"]["precision"] > 0.9 and summary["score"]["recall"] > 0.9
    fair = summary["score_without_delay"]
    assert set(fair) == {"delay_us", *summary["score"]} and abs(fair["delay_us"]) < 150
    assert fair["median_error_px"] <= summary["score"]["median_error_px"] + 0.02
    assert summary["method"] == "refined" and summary["camera"] == "left" and summary["window_us"] == 1000


def test_the_score_in_time_is_worse_the_later_answers_come_and_only_where_it_is_asked_for(
    recording, tmp_path, capsys
) -> None:
    out = tmp_path / "det.csv"
    assert detect(recording, out, "--camera", "left", "--json") == 0
    assert "streaming" not in json.loads(capsys.readouterr().out)
    assert detect(recording, out, "--camera", "left", "--json", "--streaming", "--delay-us", "3000") == 0
    summary = json.loads(capsys.readouterr().out)
    score, in_time = summary["score"], summary["streaming"]
    assert in_time["added_us"] == 3000 <= in_time["delay_us"]["median_us"] <= in_time["age_median_us"] < 20_000
    assert in_time["held"]["windows"] == score["windows"] and in_time["compute_us"]["median"] > 0
    assert score["median_error_px"] < in_time["moved_median_px"] < in_time["held_median_px"]
    curve = in_time["by_added_delay"]
    assert [row["added_us"] for row in curve] == [3000 + more for more in range(0, 20_001, 1000)]
    assert curve[0]["fresh"] == in_time["fresh"] and curve[-1]["fresh"] == 0
    assert curve[0]["age_median_us"] < curve[10]["age_median_us"] < curve[20]["age_median_us"]
    assert detect(recording, out, "--camera", "left", "--streaming") == 0
    assert "us old and" in capsys.readouterr().out
    assert detect(recording, out, "--camera", "left", "--delay-us", "10") == 2
    assert "add --streaming" in capsys.readouterr().err


def test_windows_end_after_events_or_motion_where_it_is_asked_for(recording, tmp_path, capsys) -> None:
    out = tmp_path / "det.csv"
    ask = ("--camera", "left", "--json")
    assert detect(recording, out, *ask) == 0
    whole = json.loads(capsys.readouterr().out)
    assert "window_length_us" not in whole
    assert detect(recording, out, *ask, "--window-px", "1") == 0
    by_motion = json.loads(capsys.readouterr().out)
    assert by_motion["windows"] > whole["windows"] and by_motion["window_px"] == 1
    assert by_motion["window_us"] == 1000 and by_motion["window_length_us"]["p5"] < 700
    assert by_motion["score"]["precision"] > 0.9 and by_motion["score"]["recall"] > 0.9
    assert detect(recording, out, *ask, "--window-events", "300", "--streaming") == 0
    by_events = json.loads(capsys.readouterr().out)
    assert by_events["windows"] > whole["windows"] and by_events["window_events"] == 300
    assert by_events["streaming"]["held"]["windows"] == by_events["score"]["windows"]
    for wrong in (("--explain", "25000"), ("--out", str(out), "--method", "yolo")):
        assert main(["detect", str(recording), "--camera", "left", "--window-px", "2", *wrong]) == 2
        assert "--window-px" in capsys.readouterr().err


@pytest.mark.gate
def test_several_recordings_make_a_folder_of_the_same_tables_in_their_order(recording, tmp_path, capsys) -> None:
    second = tmp_path / "second.h5"
    shutil.copy(recording, second)
    one, several = tmp_path / "one.csv", tmp_path / "tables"
    assert detect(recording, one, "--camera", "left", "--json") == 0
    alone = json.loads(capsys.readouterr().out)
    arguments = ["detect", str(second), str(recording), "--camera", "left", "--jobs", "2", "--out", str(several)]
    assert main([*arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["recordings"]
    assert [summary["recording"] for summary in found] == [str(second), str(recording)]
    assert [summary["out"] for summary in found] == [str(several / "second.csv"), str(several / "flight.csv")]
    assert (several / "second.csv").read_bytes() == (several / "flight.csv").read_bytes() == one.read_bytes()
    assert found[1] == alone | {"out": str(several / "flight.csv")}
    assert main(["detect", str(recording), str(second), "--out", str(one), "--camera", "left"]) == 2
    assert "several recordings need a folder" in capsys.readouterr().err
    assert main(["detect", str(recording), str(recording), "--out", str(several)]) == 2
    assert "two recordings of one name would have one table; got flight.csv" in capsys.readouterr().err
    assert main(["detect", str(recording), str(tmp_path / "none.h5"), "--out", str(several)]) == 2
    assert "none.h5: no such file" in capsys.readouterr().err


def test_refined_says_more_as_json_and_the_same_in_the_table(recording, tmp_path, capsys) -> None:
    out = tmp_path / "det.csv"
    assert detect(recording, out, "--camera", "left", "--method", "refined", "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    rows = rows_of(out)
    motion = summary["motion"]
    assert out.read_text().splitlines()[0] == "t_us,u_px,v_px,r_px"
    assert motion["t_us"] == [int(row["t_us"]) for row in rows]
    u, t_ms = np.array([float(row["u_px"]) for row in rows]), 1e-3 * np.array(motion["t_us"])
    together = np.diff(t_ms) == 1.0
    speeds = np.array(motion["vu_px_per_ms"])
    assert np.median(np.abs(np.diff(u)[together] - 0.5 * (speeds[1:] + speeds[:-1])[together])) < 0.1
    assert np.array(motion["covariance"]).shape == (len(rows), 5, 5)
    assert np.linalg.eigvalsh(motion["covariance"]).min() > 0
    assert abs(summary["sensor_delay"]["delay_us"] - 250) < 3 * summary["sensor_delay"]["sigma_us"]
    assert detect(recording, out, "--camera", "left", "--method", "auto", "--json") == 0
    assert "motion" not in json.loads(capsys.readouterr().out), "auto knows none"


@pytest.mark.parametrize("method", ["ebpp", "fe-fusion"])
def test_a_rival_finds_the_ball_with_the_settings_that_ship(recording, tmp_path, capsys, method: str) -> None:
    out = tmp_path / "det.csv"
    assert detect(recording, out, "--camera", "left", "--method", method, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["method"] == method and summary["window_us"] == method_config(method).window.window_us
    assert summary["score"]["precision"] > 0.8 and summary["score"]["recall"] > 0.8
    assert len(rows_of(out)) == summary["detections"] > 50


def test_without_json_a_person_reads_the_same_figures(recording, tmp_path, capsys) -> None:
    assert detect(recording, tmp_path / "det.csv", "--camera", "right", "--method", "paper") == 0
    text = capsys.readouterr().out
    assert "detections in" in text and "precision" in text


def test_the_config_and_the_window_of_the_command_line_count(recording, tmp_path, capsys) -> None:
    blind = replace_setting(replace_setting(auto_config(), ("cluster", "size_max"), 40), ("window", "window_us"), 4000)
    save_config(blind, tmp_path / "blind.toml")
    arguments = ["--camera", "left", "--config", str(tmp_path / "blind.toml"), "--json"]
    assert detect(recording, tmp_path / "a.csv", *arguments) == 0
    assert detect(recording, tmp_path / "b.csv", *arguments, "--window-us", "5000") == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert (first["window_us"], first["detections"], first["score"]["precision"]) == (4000, 0, None)
    assert second["window_us"] == 5000
    assert (tmp_path / "a.csv").read_text() == "t_us,u_px,v_px,r_px\n", "no row when there is no ball"


def test_the_method_is_the_one_that_is_given_else_the_files_else_refined(recording, tmp_path, capsys) -> None:
    """A file without a method was written when `auto` was the default; one that has only sections of another is its."""
    files = {
        "named": 'method = "ebpp"\n',
        "stages": "[cluster]\neps_px = 2.5\n",
        "window": "[window]\nwindow_us = 4000\n",
        "section": "[window]\nwindow_us = 1500\n[refined]\nmotion_px = 3.0\n",
    }
    for name, text in files.items():
        (tmp_path / f"{name}.toml").write_text(text)
    save_config(auto_config(), tmp_path / "whole.toml")
    asked = [
        ((), "refined", 1000),
        (("--config", "named"), "ebpp", 2000),
        (("--config", "stages"), "auto", 2000),
        (("--config", "window"), "auto", 4000),
        (("--config", "section"), "refined", 1500),
        (("--config", "whole"), "auto", 2000),
        (("--method", "paper"), "paper", 2000),
        (("--method", "refined", "--config", "whole"), "refined", 2000),
    ]
    for flags, method, window_us in asked:
        words = [str(tmp_path / f"{word}.toml") if word in (*files, "whole") else word for word in flags]
        assert detect(recording, tmp_path / "ball.csv", "--camera", "left", "--json", *words) == 0
        summary = json.loads(capsys.readouterr().out)
        assert (summary["method"], summary["window_us"]) == (method, window_us), flags
    (tmp_path / "odd.toml").write_text('method = "magic"\n')
    assert detect(recording, tmp_path / "ball.csv", "--camera", "left", "--config", str(tmp_path / "odd.toml")) == 2
    assert "odd.toml: method: no such method; expected auto" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "left, right"),
        (["--camera", "middle"], "middle"),
        (["--camera", "left", "--method", "yolo"], "no pictures"),
        (["--camera", "left", "--method", "magic"], "auto | paper"),
        (["--camera", "left", "--config", "no-such.toml"], "no-such.toml"),
        (["--camera", "left", "--window-us", "0"], "window-us"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(recording, tmp_path, capsys, arguments: list[str], says: str) -> None:
    assert detect(recording, tmp_path / "det.csv", *arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error
    assert not (tmp_path / "det.csv").exists()


def test_a_folder_that_is_not_there_is_noticed_before_the_work(recording, tmp_path, capsys) -> None:
    assert detect(recording, tmp_path / "nowhere" / "det.csv", "--camera", "left") == 2
    assert "nowhere" in capsys.readouterr().err


def test_why_there_is_no_ball_is_counted_by_reason_with_setting_value_and_limit(recording, tmp_path, capsys) -> None:
    config = replace_setting(method_config("refined"), ("refined", "points_min"), 200)
    save_config(config, tmp_path / "strict.toml")
    arguments = ("--camera", "left", "--method", "refined", "--config", str(tmp_path / "strict.toml"))
    assert detect(recording, tmp_path / "det.csv", *arguments, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    missed = summary["windows"] - summary["detections"]
    assert missed > 300
    assert all(set(one) == {"reason", "setting", "windows", "value", "limit"} for one in summary["why_not"])
    windows = [one["windows"] for one in summary["why_not"]]
    assert windows == sorted(windows, reverse=True) and max(windows) <= missed
    (points,) = (one for one in summary["why_not"] if one["setting"] == "refined.points_min")
    assert points["windows"] > 100 and 20 < points["value"] < points["limit"] == 200
    assert detect(recording, tmp_path / "det.csv", *arguments) == 0
    said = capsys.readouterr().out
    assert f"no ball in {missed} windows" in said and "refined.points_min" in said


def test_a_ball_without_a_rim_is_found_with_the_config_that_is_named(tmp_path, capsys) -> None:
    path, out = tmp_path / "glow.h5", tmp_path / "det.csv"
    with RecordingWriter(path, {"camera": SENSOR}) as writer:
        writer.append("camera", draw_glow(bright=True))
    assert detect(path, out) == 0
    assert f"of a sample with --config {RIMLESS}" in capsys.readouterr().out
    assert detect(path, out, "--json") == 0
    assert json.loads(capsys.readouterr().out)["rimless"] > 0.5
    assert detect(path, out, "--config", str(RIMLESS), "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["method"] == "refined" and found["detections"] > 0.5 * found["windows"] and "rimless" not in found


@pytest.mark.parametrize("method", ["refined", "auto", "ebpp", "fe-fusion"])
def test_one_window_is_explained_with_its_stages_candidates_and_answer(recording, capsys, method) -> None:
    arguments = ["detect", str(recording), "--camera", "left", "--method", method, "--explain", "300000"]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert f"left, {method}: window" in said and "to 300000 us" in said
    assert "verdict" in said and "ball at (" in said
    assert main([*arguments, "--json"]) == 0
    explained = json.loads(capsys.readouterr().out)
    assert explained["why_not"] == [] and explained["candidates"][0]["verdict"]
    assert f"ball at ({explained['detection']['u_px']:.2f}" in said


def test_a_window_that_there_is_not_and_a_missing_table_are_said_in_one_line(recording, tmp_path, capsys) -> None:
    here = ["detect", str(recording), "--camera", "left"]
    assert main(here) == 2
    assert "one of the arguments --out --explain is required" in capsys.readouterr().err
    assert main([*here, "--explain", "99000000"]) == 2
    assert "no window ends there; expected 1 to 400000, got 99000000" in capsys.readouterr().err
    assert main([*here, "--explain", "5000", "--out", str(tmp_path / "a.csv")]) == 2
    assert "not allowed with argument" in capsys.readouterr().err
    assert main([*here, "--explain", "soon"]) == 2
    assert "--explain: not a time; expected whole us, got 'soon'" in capsys.readouterr().err
