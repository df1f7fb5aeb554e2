import hashlib
import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from app.cli import main
from core.cameras import save_calibration, stereo_preset
from core.events import SensorSize
from core.recordings import open_recording

FAST = ("--serves", "1", "--sensor", "64x48")


def simulate(out: Path, *more: str) -> int:
    return main(["simulate", "--out", str(out), *FAST, *more])


def digest_of_events(path: Path) -> str:
    digest = hashlib.sha256()
    with open_recording(path) as recording:
        for name, camera in recording.cameras.items():
            events = camera.slice(0, recording.duration_us)
            digest.update(name.encode())
            for column in (events.t_us, events.x_px, events.y_px, events.on):
                digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("simulate") / "serve.h5"
    assert simulate(path, "--speed", "9", "--seed", "3") == 0
    return path


def test_a_recording_opens_with_what_was_asked_for(made: Path) -> None:
    with open_recording(made) as recording:
        assert list(recording.cameras) == ["left", "right"]
        assert recording.duration_us > 500_000 and recording.duration_us % 10_000 == 0
        for name, camera in recording.cameras.items():
            preset = stereo_preset("side", SensorSize(64, 48))[name]
            assert camera.sensor == preset.sensor and camera.event_count > 0
            assert camera.calibration is not None
            assert np.array_equal(camera.calibration.T_world_camera, preset.T_world_camera)
            truth = camera.truth
            assert truth is not None and len(truth.t_us) > 1000
        ball = recording.ball
        assert ball is not None
        speeds = np.linalg.norm(ball.v_world_mps[ball.visible], axis=1)
        assert speeds[0] == pytest.approx(9.0, rel=1e-5), "the launch, to the microsecond"
    with h5py.File(made) as file:
        config = json.loads(str(file.attrs["config"]))
        assert file.attrs["seed"] == 3 and config["sensor"]["noise_hz"] == 0.1
        assert [serve["speed_mps"] for serve in config["serves"]] == [9.0]


def test_json_says_what_was_made_and_a_person_reads_the_same(tmp_path: Path, capsys) -> None:
    out = tmp_path / "a.h5"
    arguments = ("--speed", "8", "--noise-hz", "0", "--scene", "dark", "--sensor", "320x240", "--cameras", "ceiling")
    assert simulate(out, *arguments, "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert made["path"] == str(out) and made["serves"] == 1 and made["finished"] is True
    with open_recording(out) as recording:
        assert made["duration_us"] == recording.duration_us
        assert made["events"] == {name: camera.event_count for name, camera in recording.cameras.items()}
        truths = [camera.truth for camera in recording.cameras.values()]
        assert made["truths"] == sum(int(truth.visible.sum()) for truth in truths if truth is not None) > 0
    assert simulate(out, *arguments, "--force") == 0
    text = capsys.readouterr().out
    assert str(out) in text and ": 1 serve, " in text
    assert all(f"{name} {count:,}" in text for name, count in made["events"].items())


def test_the_same_seed_makes_the_same_events_and_another_one_others(made: Path, tmp_path: Path) -> None:
    for seed in ("3", "4"):
        assert simulate(tmp_path / f"{seed}.h5", "--speed", "9", "--seed", seed) == 0
    assert digest_of_events(tmp_path / "3.h5") == digest_of_events(made)
    assert digest_of_events(tmp_path / "4.h5") != digest_of_events(made)


def test_a_calibration_file_gives_the_cameras_their_names_and_size(tmp_path: Path) -> None:
    preset = stereo_preset("behind", SensorSize(40, 32))
    rig = tmp_path / "rig.toml"
    save_calibration(rig, {"north": preset["left"], "south": preset["right"]})
    out = tmp_path / "a.h5"
    arguments = ["simulate", "--out", str(out), "--serves", "1", "--speed", "9", "--cameras", str(rig)]
    assert main(arguments) == 0
    with open_recording(out) as recording:
        assert {name: str(camera.sensor) for name, camera in recording.cameras.items()} == {
            "north": "40x32",
            "south": "40x32",
        }


def test_an_existing_file_is_replaced_only_with_force(tmp_path: Path, capsys) -> None:
    out = tmp_path / "a.h5"
    out.write_bytes(b"precious")
    assert simulate(out) == 2
    error = capsys.readouterr().err
    assert "--force" in error and error.count("\n") == 1 and out.read_bytes() == b"precious"
    assert simulate(out, "--force", "--speed", "99") == 2
    assert out.read_bytes() == b"precious", "a mistake is noticed before the old file is gone"
    assert simulate(out, "--force", "--speed", "9") == 0
    with open_recording(out) as recording:
        assert recording.duration_us > 0


def test_pictures_and_a_robot_are_there_when_they_are_asked_for_and_only_then(
    made: Path, tmp_path: Path, capsys
) -> None:
    with open_recording(made) as recording:
        assert not recording.frames and recording.read_rows("/racket") is None and "/episodes" not in recording.groups
    pictured, played = tmp_path / "pictured.h5", tmp_path / "played.h5"
    arguments = ("--speed", "9", "--seed", "3", "--frames-hz", "30", "--exposure-us", "2000")
    assert simulate(pictured, *arguments) == 0
    assert "frames" in capsys.readouterr().out
    assert digest_of_events(pictured) == digest_of_events(made), "a camera beside them changes no event"
    with open_recording(pictured) as recording:
        frames = recording.frames["right"]
        assert frames.t_us[:2].tolist() == [16_667, 50_000] and (frames.exposure_us == 2000).all()
        assert frames.image(0).shape == (48, 64, 3)
    assert simulate(played, "--speed", "9", "--seed", "3", "--robot") == 0
    with open_recording(played) as recording:
        rows = recording.read_rows("/episodes")
        assert rows is not None and rows["speed_mps"] == pytest.approx(9.0) and rows["case"].tolist() == [4]
        assert recording.read_rows("/racket") is not None and not recording.frames


def test_a_real_ball_is_slowed_by_the_air_and_bounces_as_recorded_ones_do(tmp_path: Path) -> None:
    out = tmp_path / "real.h5"
    assert simulate(out, "--physics", "real", "--speed", "6", "--seed", "1") == 0
    with open_recording(out) as recording:
        ball = recording.ball
    assert ball is not None
    v = ball.v_world_mps[ball.visible]
    bounce = int(np.argmax(np.diff(v[:, 2]) > 1.0))
    # The truth has a sample at the bounce itself, so the one before is up to 0.5 ms of fall away.
    assert v[bounce + 1, 2] == pytest.approx(-0.945 * v[bounce, 2], abs=0.01)
    assert np.linalg.norm(v[0]) == pytest.approx(6.0, abs=0.005) and np.hypot(*v[bounce, :2]) < 5.4
    with h5py.File(out) as file:
        assert json.loads(str(file.attrs["config"]))["physics"]["air"]["drag_coefficient"] == 0.554


MISTAKES = [
    (("--speed", "2"), "--speed: expected 3 to 9"),
    (("--speed", "nan"), "--speed: expected a finite number"),
    (("--speed", "fast"), "--speed"),
    (("--noise-hz", "-1"), "--noise-hz: expected 0 to 20"),
    (("--noise-hz", "inf"), "--noise-hz: expected a finite number"),
    (("--seed", "-1"), "--seed"),
    (("--seed", str(2**63)), "--seed"),
    (("--serves", "0"), "--serves"),
    (("--sensor", "64"), "WIDTHxHEIGHT"),
    (("--sensor", "8x8"), "16 to 4096"),
    (("--sensor", "²²x64"), "WIDTHxHEIGHT"),
    (("--cameras", "moon"), "side, ceiling, behind, corners or a calibration file"),
    (("--cameras", __file__), "--sensor goes with a placement"),
    (("--scene", "moon"), "ball, dark"),
    (("--physics", "moon"), "invalid choice"),
    (("--wall", "2"), "--wall: out of range; expected 0.01 to 1"),
    (("--flicker", "0.6"), "--flicker: expected 0 to 0.5"),
    (("--flicker-hz", "0"), "--flicker-hz: expected 1 to 1000"),
    (("--scene", "rally", "--physics", "real"), "physics paper"),
    (("--scene", "rally", "--speed", "3"), "no ball of a rally can be played at this speed"),
]


@pytest.mark.parametrize(("arguments", "says"), MISTAKES)
def test_a_mistake_is_one_line_exit_2_and_no_file(
    tmp_path: Path, capsys, arguments: tuple[str, ...], says: str
) -> None:
    out = tmp_path / "a.h5"
    assert simulate(out, *arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1 and says in captured.err and captured.out == ""
    assert list(tmp_path.iterdir()) == []


def test_places_where_no_recording_can_be_are_said_so(tmp_path: Path, capsys) -> None:
    for out in (tmp_path / "nowhere" / "a.h5", tmp_path):
        assert simulate(out, "--force") == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and str(out) in error


def test_a_file_that_is_no_calibration_is_named(tmp_path: Path, capsys) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("image_width: 640\n")
    assert main(["simulate", "--out", str(tmp_path / "a.h5"), "--cameras", str(rig)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "rig.yaml" in error and "image_height" in error


def test_walls_and_flicker_of_a_scene_can_be_chosen(tmp_path: Path) -> None:
    out = tmp_path / "a.h5"
    options = ("--sensor", "48x32", "--serves", "1", "--wall", "0.7", "--flicker", "0.3", "--flicker-hz", "120")
    assert simulate(out, *options) == 0
    with h5py.File(out) as file:
        scene = json.loads(str(file.attrs["config"]))["scene"]
        assert (scene["wall"], scene["flicker"], scene["flicker_hz"]) == (0.7, 0.3, 120.0)
        t_us = file["cameras/left/events/t"][:]
    spectrum = np.abs(np.fft.rfft(np.bincount(t_us // 500, minlength=2000)[:2000]))  # one second in bins of 500 us
    assert np.argmax(spectrum[20:]) + 20 in (120, 240), "events follow the lamp"
