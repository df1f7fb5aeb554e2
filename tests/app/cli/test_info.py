"""`rallyscope info` says what is in a recording."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.cameras import Camera
from core.data_sets import EventWindows, read_manifest
from core.events import Events, SensorSize
from core.learning.config import default_run
from core.learning.task.environment import draw_serve_batch
from core.physics.ball_states import read_ball_states
from core.recordings import PixelTruth, RecordingWriter, Triggers
from tests.core.recordings.conftest import encode_evt21, random_events

SENSOR = SensorSize(320, 240)


@pytest.fixture
def recording(tmp_path):
    """2,000 events in 100 ms, all of them in the first 20 ms; truth, triggers and calibration of one camera."""
    camera = Camera(SENSOR, np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]]), np.zeros(5), np.eye(4))
    rows = np.arange(2000)
    t = np.arange(5) * 1000
    with RecordingWriter(
        tmp_path / "a.h5", {"left": SENSOR, "right": SENSOR}, calibration={"left": camera}, seed=12
    ) as writer:
        writer.append("left", Events.from_columns(rows * 10, rows % 320, rows % 240, rows % 2, SENSOR))
        writer.write_truth("left", PixelTruth(t, t * 1.0, t * 1.0, t * 0 + 5.0, t >= 0))
        writer.write_triggers("left", Triggers(t, t > 0, np.zeros(5, np.int16)))
        writer.append_rows("/racket", {"t_us": t})
        writer.note("made by a test")
        writer.extend_duration(100_000)
    return tmp_path / "a.h5"


def test_json_holds_the_facts(recording, capsys):
    assert main(["info", str(recording), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["duration_us"] == 100_000
    assert facts["seed"] == 12
    assert facts["notes"] == ["made by a test"]
    assert facts["groups"] == ["/ground_truth/left", "/racket"]
    assert facts["cameras"]["left"] == {
        "width_px": 320, "height_px": 240, "events": 2000, "mean_rate_hz": 20_000, "peak_rate_hz": 100_000,
        "triggers": 5, "calibrated": True, "truth_samples": 5,
    }  # fmt: skip
    assert facts["cameras"]["right"]["events"] == 0


def test_text_says_the_same_to_people(recording, capsys):
    assert main(["info", str(recording)]) == 0
    out = capsys.readouterr().out
    for line in ("duration     0.100000 s", "camera left: 320x240", "events       2,000", "note: made by a test"):
        assert line in out


def test_the_mean_rate_is_over_the_duration_and_not_over_begun_milliseconds(tmp_path, capsys):
    rows = np.arange(500)
    with RecordingWriter(tmp_path / "a.h5", {"left": SENSOR}) as writer:
        writer.append("left", Events.from_columns(rows * 3, rows % 320, rows % 240, rows % 2, SENSOR))
        writer.extend_duration(2_001)
    assert main(["info", str(tmp_path / "a.h5"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["cameras"]["left"]["mean_rate_hz"] == pytest.approx(500 / facts["duration_us"] * 1e6)
    assert facts["duration_us"] == 2_001


def test_an_event_file_of_another_format_is_described_without_importing_it(tmp_path, capsys):
    events = random_events(5_000, seed=3, duration_us=40_000, sensor=SENSOR, start_us=7_000_000)
    path = tmp_path / "camera.raw"
    encode_evt21(path, events)
    assert main(["info", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["cameras"]["camera"]["events"] == 5_000
    assert facts["cameras"]["camera"]["triggers"] == 1
    assert facts["duration_us"] == 40_000
    assert [one.name for one in tmp_path.iterdir()] == ["camera.raw"]


def test_a_real_event_file_is_described(shared_data, capsys):
    path = shared_data / "events" / "walker_evt3_640x480.raw"
    assert main(["info", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["cameras"]["camera"]["events"] == 343_474
    assert facts["cameras"]["camera"]["triggers"] == 4157
    assert facts["duration_us"] == 9_218_023 - 7_139_845 + 1


def test_a_file_that_is_no_recording_is_one_line_and_exit_code_2(tmp_path, capsys):
    (tmp_path / "a.h5").write_bytes(b"")
    assert main(["info", str(tmp_path / "a.h5")]) == 2
    assert capsys.readouterr().err == f"rallyscope: {tmp_path / 'a.h5'}: the file is empty\n"


def test_the_balls_of_a_recording_are_listed_selected_and_written(serve_recording, tmp_path, capsys):
    out = tmp_path / "balls.csv"
    assert main(["info", str(serve_recording), "--balls", "--json", "--out", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [ball["kind"] for ball in found["balls"]] == ["flight", "bounce"]
    first, *rows = out.read_text().splitlines()
    assert first.startswith("source,name,kind,number,t_us,end_us,speed_mps") and len(rows) == 2
    assert main(["info", str(serve_recording), "--balls", "--where", "kind=bounce speed_mps=5..6"]) == 0
    assert "1 of 2 balls" in capsys.readouterr().out


def test_selected_flights_become_a_file_that_a_training_draws_from(tmp_path, capsys):
    run, file = Path(__file__).parents[2] / "fixtures" / "written-by-0.1" / "runs" / "ddpg", tmp_path / "balls.json"
    assert main(["info", str(run), "--balls", "--where", "kind=flight number=1..12", "--to", str(file)]) == 0
    serves = read_ball_states(file)
    assert f"{len(serves)} launches" in capsys.readouterr().out
    config = dataclasses.replace(default_run("ddpg").environment, state_source="truth", recorded=str(file))
    drawn = draw_serve_batch(5.0, 20, config, np.random.default_rng(0))
    assert {row.tobytes() for row in drawn.serves.states()} <= {row.tobytes() for row in serves.states()}


def test_selected_flights_become_a_data_set(serve_recording, tmp_path, capsys):
    words = ["info", str(serve_recording), "--balls", "--where", "kind=bounce", "--data", str(tmp_path)]
    assert main([*words, "--data-set", str(tmp_path / "bounces")]) == 0
    assert "1 flight (1 training, 0 validation, 0 test)" in capsys.readouterr().out
    assert read_manifest(tmp_path / "bounces")["selection"]["selected_by"] == "conditions kind=bounce"
    windows = EventWindows(tmp_path / "bounces")
    assert len(windows) and {windows[0]["recording"]} == {"flight-0001.h5"}
    assert main([*words, "--data-set", str(tmp_path / "bounces")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main([*words, "--data-set", str(tmp_path / "again"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["data_set"]
    assert said["path"] == str(tmp_path / "again") and said["selection"]["split_by"] == "flight"
    words[4] = "kind=net"
    assert main([*words, "--data-set", str(tmp_path / "none")]) == 2
    assert "no flight to write" in capsys.readouterr().err and not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--where", "kind=bounce"], "add --balls"),
        (["--data-set", "set"], "add --balls"),
        (["--balls", "--data-set", "/none/set"], "no such folder"),
        (["--track"], "add --balls"),
        (["--to", "balls.json"], "add --balls"),
        (["--balls", "--to", "/none/balls.json"], "no such folder"),
        (["--balls", "--where", "spedd=3"], "not a condition on balls"),
    ],
)
def test_flags_of_balls_that_do_not_fit_are_refused(recording, capsys, words, message):
    assert main(["info", str(recording), *words]) == 2
    assert message in capsys.readouterr().err


def test_a_folder_without_recordings_and_a_recording_that_knows_no_ball_say_so(recording, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert main(["info", str(tmp_path / "empty"), "--balls"]) == 2
    assert "no balls to list" in capsys.readouterr().err
    assert main(["info", str(recording), "--balls"]) == 0
    assert "--track finds them" in capsys.readouterr().out
