"""What earlier versions wrote is read: the same events, truths, labels, settings and policies, to the last value.

The files are in `fixtures/written-by-<version>`, made once by `fixtures/make_written_by.py` with the code of that
version. Here they are opened through public names only. A test that fails here is a promise broken to somebody who has
such files; neither the files nor what is expected of them may be changed to make it pass. That what is computed from
them stays what it was is guarded in `test_reference_outputs.py`.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import itertools
import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.shared.workspace import Workspace
from core.cameras import load_calibration
from core.config import config_to_mapping, load_config
from core.data_sets import read_manifest
from core.detection import DetectorConfig
from core.events import SensorSize
from core.learning import Control, RunConfig, load_policy, read_run, read_status
from core.learning.runs.run_files import read_control
from core.recordings import open_recording
from labels.model import LabelState, PositionSource
from labels.store import LabelStore, Layer, find_layers

pytestmark = pytest.mark.numeric
FOLDERS = sorted((Path(__file__).parent / "fixtures").glob("written-by-*"))
MADE_AT_US = 1_760_000_000_000_000

ANNA = [
    (10_000, "visible", 100.5, 50.25, 5.25, "by_hand"),
    (12_000, "visible", 102.5, 51.0, 5.5, "snapped"),
    (14_000, "visible", 104.5, 52.0, 5.75, "accepted"),
    (16_000, "visible", 106.5, 53.0, 6.0, "corrected"),
    (18_000, "partly_occluded", 108.5, 54.0, 5.0, "epipolar"),
    (20_000, "occluded", 110.0, 55.0, None, "by_hand"),
    (22_000, "occluded", None, None, None, "by_hand"),
    (24_000, "out_of_frame", -12.5, 260.0, None, "by_hand"),
    (26_000, "out_of_frame", None, None, None, "by_hand"),
    (30_000, "visible", 120.0, 60.0, None, "interpolated"),
    (32_000, "visible", 128.0, 64.0, None, "interpolated"),
    (34_000, "visible", 136.0, 68.0, None, "interpolated"),
    (36_000, "visible", 36.5, 37.5, None, "imported"),
]
"""Anna's labels of the left camera, after all edits, undos and redos."""


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name)
def written(request: pytest.FixtureRequest) -> Path:
    """The folder of one version. Do not write to it."""
    return request.param


@pytest.fixture
def expected(written: Path) -> dict:
    """What the folder holds."""
    return json.loads((written / "expected.json").read_text(encoding="utf-8"))


def run_verb(*words: object) -> str:
    """What `rallyscope` prints, once it has ended well."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = main([str(word) for word in words])
    assert code == 0
    return printed.getvalue()


def digest(column: np.ndarray) -> str:
    """Of type, shape and values; the type of a flag is uint8."""
    plain = np.ascontiguousarray(column.astype(np.uint8) if column.dtype == np.bool_ else column)
    what = f"{plain.dtype.str} {plain.shape} ".encode()
    return hashlib.blake2b(what + plain.tobytes(), digest_size=8).hexdigest()


def test_there_is_a_folder_of_the_first_version() -> None:
    assert "written-by-0.1" in [folder.name for folder in FOLDERS]


# Recordings


def check_recording(path: Path, told: dict) -> None:
    """Every column of every group is what was written."""
    with contextlib.closing(open_recording(path)) as recording:
        assert (recording.uuid, recording.seed) == (told["uuid"], told["seed"])
        assert recording.duration_us == told["duration_us"]
        assert sorted(recording.cameras) == sorted(told["cameras"])
        for name, camera in recording.cameras.items():
            check_camera(camera, told["cameras"][name], recording.duration_us)
            check_truth(camera.truth, told["groups"][f"/ground_truth/{name}"])
        check_truth(recording.ball, told["groups"]["/ground_truth/ball"])
        assert set(told["groups"]) <= set(recording.groups)
        for group, columns in told["groups"].items():
            rows = recording.read_rows(group)
            assert rows is not None
            assert {name: digest(column) for name, column in rows.items()} == columns, group
        with_frames = {name: camera["frames"] for name, camera in told["cameras"].items() if camera["frames"]}
        assert set(recording.frames) == set(with_frames)
        for name, columns in with_frames.items():
            frames = recording.frames[name]
            assert digest(frames.t_us) == columns["t_us"]
            assert digest(frames.exposure_us) == columns["exposure_us"]
            assert digest(np.stack([frames.image(k) for k in range(len(frames))])) == columns["image"]


def check_camera(camera, told: dict, duration_us: int) -> None:
    """Its events, from the file as a whole and from its parts, and its calibration."""
    assert camera.sensor == SensorSize(*told["size"])
    assert camera.event_count == told["events"]
    events = camera.slice(0, duration_us)
    columns = {"t": events.t_us, "x": events.x_px, "y": events.y_px, "p": events.on}
    assert {name: digest(column) for name, column in columns.items()} == {name: told[name] for name in columns}
    edges_us = np.linspace(0, duration_us, 8).astype(int)
    parts = [camera.slice(start, end).t_us for start, end in itertools.pairwise(edges_us)]
    assert digest(np.concatenate(parts)) == told["t"]
    assert int(camera.counts_per_ms().sum()) == told["events"]
    for name in ("K", "distortion", "T_world_camera"):
        np.testing.assert_array_equal(getattr(camera.calibration, name), told[name])


def check_truth(truth, columns: dict[str, str]) -> None:
    """The truth as the recording offers it."""
    assert {name: digest(getattr(truth, name)) for name in columns} == columns


@pytest.mark.parametrize("name", ["robot.h5", "live.h5"])
def test_a_recording_holds_what_was_written(name: str, written: Path, expected: dict) -> None:
    told = expected["recordings"][name]
    assert {"/racket", "/racket_targets", "/episodes"} <= set(told["groups"])
    assert ("/predictions" in told["groups"]) == (name == "live.h5")
    check_recording(written / "recordings" / name, told)


def test_the_recordings_of_a_data_set_hold_events_truth_and_frames(written: Path, expected: dict) -> None:
    for name, told in expected["data_set_recordings"].items():
        check_recording(written / "data-set" / name, told)


def test_a_recording_whose_writer_was_killed_is_finished(written: Path, expected: dict, tmp_path: Path) -> None:
    told = expected["killed"]
    shutil.copyfile(written / "recordings" / "killed.h5", tmp_path / "killed.h5")
    with contextlib.closing(open_recording(tmp_path / "killed.h5")) as recording:
        only = recording.cameras["only"]
        events = only.slice(0, 50_000)
        columns = {"t": events.t_us, "x": events.x_px, "y": events.y_px, "p": events.on}
        assert only.event_count == told["events"] == 2000
        assert {name: digest(column) for name, column in columns.items()} == {name: told[name] for name in columns}
        assert only.triggers.t_us.tolist() == [-5, 10_000, 20_000]
        assert only.triggers.rising.tolist() == [True, False, True]
        assert only.truth is not None and recording.ball is not None
        assert only.truth.t_us.tolist() == [0, 25_000, 50_000] and only.truth.r_px[0] == 5.0
        assert recording.ball.p_world_m[1].tolist() == [1.0, 2.0, 3.0]
        assert recording.ball.visible.tolist() == [True, True, False]
        assert (recording.seed, recording.config) == (8, {"made": "by hand"})
        assert "the writer was killed" in recording.notes


# Data sets


def test_a_data_set_says_what_it_holds(written: Path, expected: dict) -> None:
    manifest = read_manifest(written / "data-set")
    assert manifest["total"] == expected["data_set"]
    assert [entry["file"] for entry in manifest["recordings"]] == list(expected["data_set_recordings"])
    assert (manifest["planned"], manifest["seed"], manifest["scenes"]) == (1, 3, ["ball"])
    assert manifest["speeds_mps"] == [6.0] and manifest["placements"] == ["side"]


def test_a_data_set_that_is_complete_is_not_made_again(written: Path, expected: dict, tmp_path: Path) -> None:
    shutil.copytree(written / "data-set", tmp_path / "data-set")
    words = ("--speeds", "6", "--serves", 1, "--sensor", "96x72", "--frames-hz", 5, "--jobs", 1, "--seed", 3, "--json")
    done = json.loads(run_verb("simulate", "--out", tmp_path / "data-set", *words))
    assert (done["made"], done["kept"]) == ([], ["ball-6mps-side-1"])
    assert done["total"] == expected["data_set"]
    assert "| recordings | 1 |" in (tmp_path / "data-set" / "CARD.md").read_text(encoding="utf-8")


# Labels


def rows_of(store: LabelStore) -> list[tuple]:
    """Labels as plain rows."""
    return [
        (label.t_us, label.state.value, label.x_px, label.y_px, label.r_px, label.provenance.source.value)
        for label in store.all()
    ]


@pytest.fixture
def uuid(expected: dict) -> str:
    """Of the recording that was labelled."""
    return expected["recordings"]["robot.h5"]["uuid"]


def test_every_layer_of_labels_is_found(written: Path, uuid: str) -> None:
    wanted = {
        Layer(uuid, "left", "anna"),
        Layer(uuid, "left", "anna", blind=True),
        Layer(uuid, "left", "Jörg Ö./2"),
        Layer(uuid, "right", "anna"),
    }
    assert set(find_layers(written / "labels")) == set(find_layers(written / "labels", uuid)) == wanted


def test_labels_are_what_all_edits_led_to(written: Path, uuid: str) -> None:
    store = LabelStore.read(written / "labels", Layer(uuid, "left", "anna"))
    assert rows_of(store) == ANNA
    assert store.notes == ()
    assert store.labels().t_us.tolist() == [row[0] for row in ANNA]
    assert store.progress([10_000, 20_000, 28_000]).by_state == {LabelState.VISIBLE: 1, LabelState.OCCLUDED: 1}


def test_labels_remember_where_they_come_from(written: Path, uuid: str) -> None:
    by_time = LabelStore.read(written / "labels", Layer(uuid, "left", "anna")).by_time()
    snapped, made = by_time[12_000], by_time[12_000].provenance
    assert snapped.covariance_px2 == (0.04, 0.01, 0.09)
    assert (made.source, made.window_us, made.rendering) == (PositionSource.SNAPPED, (10_000, 12_000), "polarity")
    assert (made.annotator, made.made_at_us, made.time_spent_ms) == ("anna", MADE_AT_US + 12_000, 850)
    detectors = {t_us: label.provenance.detector for t_us, label in by_time.items() if label.provenance.detector}
    assert detectors == {
        14_000: "auto:0123abcd",
        16_000: "paper:0123abcd",
        **dict.fromkeys((30_000, 32_000, 34_000), "curve"),
        36_000: "import csv",
    }
    assert by_time[10_000].provenance.tool.startswith("rallyscope ")
    assert by_time[36_000].provenance.tool.endswith("second session")


def test_edits_of_earlier_sessions_are_taken_back(written: Path, uuid: str, tmp_path: Path) -> None:
    shutil.copytree(written / "labels", tmp_path / "labels")
    with LabelStore.open(tmp_path / "labels", uuid, "left", "anna") as store:
        assert store.undo() == (28_000,)
        no_ball = store.at(28_000)
        assert no_ball is not None and no_ball.state is LabelState.NO_BALL
        assert store.undo() == (36_000,)
        assert sorted(store.undo()) == [16_000, 30_000, 32_000, 34_000]
        assert [row[0] for row in rows_of(store)] == [10_000, 12_000, 14_000, *range(18_000, 30_000, 2_000)]
        assert sorted(store.redo()) == [16_000, 30_000, 32_000, 34_000]
        assert len(store.undo()) == 4
        assert store.undo() == (12_000, 14_000)
        assert len(store.undo()) == 7 and not store.can_undo and store.all() == ()
    with LabelStore.open(tmp_path / "labels", uuid, "left", "anna") as store:
        while store.can_redo:
            store.redo()
        assert rows_of(store) == ANNA


def test_other_annotators_blind_repeats_and_torn_lines_are_read(written: Path, uuid: str, tmp_path: Path) -> None:
    folder = written / "labels"
    other = LabelStore.read(folder, Layer(uuid, "left", "Jörg Ö./2"))
    assert rows_of(other) == [
        (10_000, "visible", 101.25, 50.75, 5.0, "by_hand"),
        (12_000, "no_ball", None, None, None, "by_hand"),
    ]
    blind = LabelStore.read(folder, Layer(uuid, "left", "anna", blind=True))
    assert rows_of(blind) == [
        (10_000, "visible", 100.0, 51.5, 5.5, "by_hand"),
        (20_000, "no_ball", None, None, None, "by_hand"),
    ]
    saved = [(40_000, "visible", 11.0, 12.0, None, "by_hand")]
    assert rows_of(LabelStore.read(folder, Layer(uuid, "right", "anna"))) == saved
    shutil.copytree(folder, tmp_path / "labels")
    with LabelStore.open(tmp_path / "labels", uuid, "right", "anna") as store:
        assert rows_of(store) == saved
        store.delete(40_000)
        assert store.all() == ()


def test_labels_in_a_file_of_columns_are_imported(written: Path, uuid: str, tmp_path: Path) -> None:
    words = ("--camera", "left", "--annotator", "bea", "--format", "hdf5", "--data", tmp_path, "--json")
    told = json.loads(run_verb("labels", "import", written / "labels.h5", written / "recordings" / "robot.h5", *words))
    assert (told["imported"], told["rejected"]) == (len(ANNA), [])
    store = LabelStore.read(tmp_path / "labels", Layer(uuid, "left", "bea"))
    assert [row[:5] for row in rows_of(store)] == [row[:5] for row in ANNA]


# Configs and calibrations


def test_a_tuned_detector_is_what_was_tuned(written: Path) -> None:
    tuned = load_config(DetectorConfig, written / "configs" / "tuned.toml")
    assert tuned.window.window_us == 1500
    assert (tuned.hot_pixels.enabled, tuned.hot_pixels.tick_ms, tuned.hot_pixels.persistence_ms) == (True, 2.5, 60.0)
    assert (tuned.flicker.enabled, tuned.flicker.cycles_min, tuned.flicker.frequency_min_hz) == (True, 4, 80.0)
    assert (tuned.roi.roi_expand_px, tuned.roi.misses_to_reset) == (42.0, 5)
    assert tuned.denoise.kernel_px == 1
    cluster = tuned.cluster
    assert (cluster.eps_px, cluster.min_samples, cluster.size_min, cluster.size_max) == (2.5, 4, 12, 6000)
    assert cluster.time_scale_px_per_ms == 0.0
    polarity = tuned.polarity
    assert (polarity.leading_polarity, polarity.pair_radius_px, polarity.outlier_radius_px) == ("off", 33.0, 28.0)
    assert (polarity.memory_ms, polarity.memory_limit) == (40.0, 30.0)
    assert (tuned.geometry.circularity_min, tuned.geometry.solidity_min) == (0.55, 0.3)
    assert (tuned.localise.radius_min_px, tuned.localise.radius_max_px) == (2.5, 30.0)


def test_saved_defaults_stay_what_they_were(written: Path) -> None:
    """Whoever saved them meant these values, whatever the defaults are now."""
    saved = load_config(DetectorConfig, written / "configs" / "default.toml")
    assert (saved.window.window_us, saved.roi.roi_expand_px, saved.cluster.size_min) == (2000, 50.0, 40)
    assert (saved.geometry.circularity_min, saved.polarity.leading_polarity) == (0.65, "auto")
    assert not saved.hot_pixels.enabled and not saved.flicker.enabled


def test_the_workspace_of_an_earlier_version_is_listed(written: Path) -> None:
    workspace = Workspace(written)
    assert workspace.config_names() == ("default", "training", "tuned")
    assert sorted(workspace.run_names()) == ["ddpg", "landing-model", "ppo"]


def test_a_training_that_was_planned_is_the_same_training(written: Path) -> None:
    planned = load_config(RunConfig, written / "configs" / "training.toml")
    assert (planned.agent, planned.reward.kind, planned.environment.state_source) == ("sac", "case", "truth")
    assert (planned.curriculum.speeds_mps, planned.curriculum.episodes) == ((5.0,), (1700,))
    assert (planned.evaluation_balls, planned.checkpoint_every, planned.seeds) == (500, 50, 1)


def test_calibrations_are_read(written: Path) -> None:
    side = load_calibration(written / "calibrations" / "side.toml")
    lens = load_calibration(written / "calibrations" / "lens.yaml")
    assert list(side) == ["left", "right"] and list(lens) == ["camera"]
    for camera in (*side.values(), *lens.values()):
        assert camera.sensor == SensorSize(320, 200)
        assert camera.K.tolist() == [[520.0, 0.0, 159.5], [0.0, 520.0, 99.5], [0.0, 0.0, 1.0]]
        np.testing.assert_array_equal(camera.distortion, [-0.06, 0.01, 0.0003, -0.0002, 0.0])
    np.testing.assert_allclose(side["left"].position_world_m, (-1.15, 1.75, 1.15), atol=1e-15)
    np.testing.assert_allclose(side["right"].project([(-0.6, 0.0, 0.15)]), [(159.5, 99.5)], atol=1e-9)
    wide = load_calibration(written / "calibrations" / "wide.toml")["right"]
    assert wide.sensor == SensorSize(320, 180) and wide.K[0, 0] == 250.0


# Training runs


@pytest.mark.parametrize(("name", "seed"), [("ddpg", 0), ("ddpg", 1), ("ppo", 0), ("landing-model", 0)])
def test_a_policy_answers_a_ball_as_it_did(name: str, seed: int, written: Path, expected: dict) -> None:
    state, goal = (-1.42, 0.1, 0.3, -4.0, 0.2, -0.5), (0.8, 0.1)
    run = written / "runs" / name
    for which in ("last", "best"):
        action = load_policy(run, seed, which).act(state, goal)
        np.testing.assert_allclose(action, expected["runs"][name]["actions"][f"{seed} {which}"], atol=1e-5)


def test_runs_say_how_they_were_made_and_how_they_ended(written: Path) -> None:
    ddpg, ppo, model = (read_run(written / "runs" / name) for name in ("ddpg", "ppo", "landing-model"))
    assert (ddpg.agent, ddpg.seeds, ddpg.ddpg.hidden, ddpg.ddpg.first_update) == ("ddpg", 2, 16, 8)
    assert (ddpg.curriculum.speeds_mps, ddpg.curriculum.episodes) == ((3.0, 5.0), (30, 30))
    assert (ddpg.environment.state_source, ddpg.reward.kind) == ("predicted", "cdta")
    assert (ppo.agent, ppo.rival.on_policy_steps, ppo.rival.hidden, ppo.reward.kind) == ("ppo", 20, 16, "case")
    assert (model.agent, model.landing_model.updates_per_episode, model.exploration.random_episodes) == (
        "landing-model", 4, 10,
    )  # fmt: skip
    ended = [read_status(written / "runs" / name) for name in ("ddpg", "ppo", "landing-model")]
    assert [one and (one.state, one.episodes) for one in ended] == [("finished", 60), ("finished", 60), ("stopped", 60)]
    assert read_control(written / "runs" / "ddpg") == Control("pause", 12.5)


def test_a_setting_of_a_run_keeps_its_value(written: Path) -> None:
    """Everything in the file is in the config, under the same name."""
    for run in (written / "runs").iterdir():
        saved = tomllib.loads((run / "config.toml").read_text(encoding="utf-8"))
        known = json.loads(json.dumps(config_to_mapping(read_run(run))))
        assert_holds(known, saved)


def assert_holds(known: dict, saved: dict) -> None:
    """Everything saved is known; what came later may be known besides."""
    for name, value in saved.items():
        if isinstance(value, dict):
            assert_holds(known[name], value)
        else:
            assert known[name] == value, name


def test_a_run_that_was_stopped_goes_on_to_where_it_would_have_come(
    written: Path, expected: dict, tmp_path: Path
) -> None:
    """Gradients that are rounded otherwise, by a millionth, move the mean error by 1e-5 mm of 275 mm."""
    run = tmp_path / "landing-model"
    shutil.copytree(written / "runs" / "landing-model", run)
    told = json.loads(run_verb("train", "--out", run, "--resume", "--json"))
    assert told["state"] == "finished"
    lines = (run / "seed-0" / "metrics.jsonl").read_text().splitlines()
    assert len(lines) == 60
    (now,), (before,) = json.loads(run_verb("evaluate", run, "--json")), expected["runs"]["landing-model"]["resumed"]
    for name in ("speed_mps", "balls", "seeds", "episodes"):
        assert now[name] == before[name]
    assert now["returned"] == pytest.approx(before["returned"], abs=1.01 / before["balls"])
    for name in ("mean", "median", "p95"):
        assert now["error_mm"][name] == pytest.approx(before["error_mm"][name], rel=0.01)
