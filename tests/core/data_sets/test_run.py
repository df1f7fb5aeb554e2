"""Making data sets: the same whatever the jobs, resumed, counted."""

import dataclasses
import fcntl
import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.data_sets import CARD, MANIFEST, DataSetPlan, plan_data_set, preset_plan, read_manifest, run_data_set
from core.data_sets.croissant import CROISSANT
from core.data_sets.facts import make_recording, partial_path, read_facts
from core.data_sets.index import INDEX
from core.data_sets.plan import Making
from core.data_sets.run import LOCK
from core.errors import RecordingError
from core.events import SensorSize
from core.history.recorded_rally import EPISODES
from core.jobs import JobBackend
from core.recordings import open_recording
from core.simulation import LaunchConfig, StereoConfig, simulate_recording
from core.simulation.frames import FrameConfig

SMALL = Making(sensor=SensorSize(96, 64), frames=FrameConfig(rate_hz=20.0))
PLAN = plan_data_set(speeds_mps=(8, 9), serves=1, seed=5, making=SMALL)
WITHOUT = plan_data_set(speeds_mps=(9,), serves=1, robot=False, making=Making(sensor=SensorSize(48, 32)))


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "set"
    shares: list[float] = []
    done = run_data_set(PLAN, folder, engine=JobBackend(jobs=1), progress=shares.append)
    assert done.made == ("ball-8mps-side-1", "ball-9mps-side-1") and done.kept == ()
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0)
    return folder


@pytest.mark.gate
def test_files_are_the_same_byte_for_byte_whatever_the_number_of_jobs(made: Path, tmp_path: Path) -> None:
    shares: list[float] = []
    done = run_data_set(PLAN, tmp_path, engine=JobBackend(jobs=2), progress=shares.append)
    assert len(done.made) == 2 and shares[-1] == 1.0
    assert digests(tmp_path) == digests(made)
    cards = {MANIFEST, CARD, CROISSANT, INDEX}
    assert set(digests(made)) == {"ball-8mps-side-1.h5", "ball-9mps-side-1.h5", *cards, LOCK}


def test_the_manifest_counts_what_is_in_the_files(made: Path) -> None:
    manifest = read_manifest(made)
    total, entries = manifest["total"], manifest["recordings"]
    assert isinstance(total, dict) and isinstance(entries, list) and len(entries) == total["recordings"] == 2
    events = centres = frames = with_ball = points = seconds = 0
    for entry in entries:
        with open_recording(made / entry["file"]) as recording:
            assert entry["uuid"] == recording.uuid and entry["duration_us"] == recording.duration_us
            assert entry["bytes"] == (made / entry["file"]).stat().st_size
            rows, ball = recording.read_rows(EPISODES), recording.ball
            assert rows is not None and entry["episodes"] == len(rows["case"]) == 1
            assert entry["returned"] == int((rows["case"] == 4).sum())
            assert ball is not None and entry["points_3d"] == int(np.isfinite(ball.p_world_m[ball.visible, 0]).sum())
            seconds, points = seconds + recording.duration_us * 1e-6, points + entry["points_3d"]
            for name, stream in recording.cameras.items():
                truth, pictures = stream.truth, recording.frames[name]
                assert truth is not None
                events, frames = events + stream.event_count, frames + len(pictures)
                centres += int(np.isfinite(truth.u_px).sum())
                with_ball += int(np.isfinite(truth.at(pictures.t_us).u_px).sum())
    assert (total["events"], total["centres_2d"], total["frames"]) == (events, centres, frames)
    assert (total["points_3d"], total["frames_with_ball"]) == (points, with_ball)
    assert total["seconds"] == pytest.approx(seconds) and centres > 0 and total["racket_poses"] > 1000
    card = (made / CARD).read_text()
    assert f"| RGB frames, all cameras | {frames:,} |" in card and f"| {events:,} |" in card
    assert card.count("ball-8mps-side-1.h5") == 1 and "2 of 2 recordings" in card


@pytest.mark.gate
def test_a_second_run_makes_what_is_missing_and_leaves_the_rest(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    name = "ball-9mps-side-1.h5"
    (folder / name).write_bytes((made / name).read_bytes())
    (folder / ".ball-8mps-side-1.partial.h5").write_bytes(b"what a killed run left")
    before = (folder / name).stat()
    done = run_data_set(PLAN, folder, engine=JobBackend(jobs=1))
    after = (folder / name).stat()
    assert done.made == ("ball-8mps-side-1",) and done.kept == ("ball-9mps-side-1",)
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)
    assert digests(folder) == digests(made)
    assert run_data_set(PLAN, folder).made == ()


def test_a_recording_made_otherwise_is_named_and_nothing_is_touched(made: Path, tmp_path: Path) -> None:
    before = digests(made)
    for plan, says in (
        (plan_data_set(speeds_mps=(8, 9), serves=1, seed=6, making=SMALL), "another seed; expected"),
        (plan_data_set(speeds_mps=(8, 9), serves=2, seed=5, making=SMALL), "another speeds_mps"),
        (plan_data_set(speeds_mps=(8, 9), serves=1, seed=5), "another sensor; expected 1280x720, got 96x64"),
    ):
        with pytest.raises(RecordingError, match=says):
            run_data_set(plan, made)
    assert digests(made) == before
    foreign = tmp_path / "ball-9mps-side-1.h5"
    foreign.write_bytes(b"precious")
    with pytest.raises(RecordingError, match=r"ball-9mps-side-1.h5: not a whole recording"):
        run_data_set(WITHOUT, tmp_path)
    cameras = stereo_preset(sensor=SensorSize(48, 32))
    simulate_recording(foreign, StereoConfig(), cameras, [LaunchConfig(speed_mps=9.0)], seed=1, overwrite=True)
    with pytest.raises(RecordingError, match="not made as part of a data set"):
        run_data_set(WITHOUT, tmp_path)
    assert run_data_set(WITHOUT, tmp_path, overwrite=True).made == ("ball-9mps-side-1",)


def test_without_a_robot_a_ball_flies_past_and_nothing_is_played(tmp_path: Path) -> None:
    manifest = run_data_set(WITHOUT, tmp_path).manifest
    total = manifest["total"]
    assert isinstance(total, dict) and total["episodes"] == total["racket_poses"] == total["frames"] == 0
    assert total["events"] > 0 and total["points_3d"] > 500


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_recording_that_fails_leaves_no_trace_and_the_others_stay(tmp_path: Path, jobs: int) -> None:
    good, bad = WITHOUT.recordings[0], dataclasses.replace(WITHOUT.recordings[0], name="ball/nowhere")
    plan = DataSetPlan("two", 0, (good, dataclasses.replace(good, name="second"), bad))
    with pytest.raises(RecordingError):
        run_data_set(plan, tmp_path, engine=JobBackend(jobs=jobs))
    names = {path.name for path in tmp_path.iterdir()}
    assert not [name for name in names if "partial" in name]
    manifest = json.loads((tmp_path / MANIFEST).read_text())
    whole = {f"{entry['name']}.h5" for entry in manifest["recordings"]}
    assert whole <= names and manifest["planned"] == 3
    if jobs == 1:
        assert whole == {"ball-9mps-side-1.h5", "second.h5"}


def test_an_unfinished_recording_has_no_final_name(tmp_path: Path) -> None:
    planned = WITHOUT.recordings[0]

    class StopError(Exception):
        pass

    def stop(share: float) -> None:
        assert [path.name for path in tmp_path.iterdir()] == [partial_path(tmp_path, planned).name]
        if share > 0.3:
            raise StopError

    with pytest.raises(StopError):
        make_recording(planned, tmp_path, stop)
    assert list(tmp_path.iterdir()) == []


def test_what_a_recording_does_not_hold_is_counted_as_none(tmp_path: Path) -> None:
    """No robot, and no pictures: no strokes, no episodes."""
    run_data_set(WITHOUT, tmp_path)
    facts = read_facts(tmp_path / f"{WITHOUT.recordings[0].name}.h5", WITHOUT.recordings[0])
    assert (facts.racket_poses, facts.episodes, facts.returned) == (0, 0, 0)
    assert facts.points_3d > 0 and {camera.frames for camera in facts.cameras.values()} == {0}
    assert {camera.frames_with_ball for camera in facts.cameras.values()} == {0}


def test_two_runs_do_not_work_in_one_folder(tmp_path: Path) -> None:
    descriptor = os.open(tmp_path / LOCK, os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        with pytest.raises(RecordingError, match="another run"):
            run_data_set(WITHOUT, tmp_path)
    finally:
        os.close(descriptor)
    assert run_data_set(WITHOUT, tmp_path).made


def test_the_papers_seven_can_be_made_small(tmp_path: Path) -> None:
    plan = preset_plan("paper7", 2, Making(sensor=SensorSize(64, 36), frames=FrameConfig(rate_hz=5.0)))
    short = tuple(dataclasses.replace(planned, speeds_mps=planned.speeds_mps[:1]) for planned in plan.recordings)
    manifest = run_data_set(dataclasses.replace(plan, recordings=short), tmp_path, engine=JobBackend(jobs=1)).manifest
    total = manifest["total"]
    assert isinstance(total, dict) and total["recordings"] == 7 and total["frames"] > 40 and total["events"] > 1000
    assert manifest["placements"] == ["side", "ceiling", "behind"]
    assert manifest["scenes"] == ["ball", "person", "two-persons", "rally"]


def test_four_cameras_are_a_placement_too_and_the_count_is_of_all_of_them(tmp_path: Path) -> None:
    making = Making(sensor=SensorSize(320, 180))
    plan = plan_data_set(speeds_mps=(9,), placements=("corners",), serves=1, robot=False, making=making)
    run_data_set(plan, tmp_path, engine=JobBackend(jobs=1))
    with open_recording(tmp_path / "ball-9mps-corners-1.h5") as recording:
        assert list(recording.cameras) == ["near_left", "near_right", "far_left", "far_right"]
        truths = [stream.truth for stream in recording.cameras.values()]
        seen = np.all([truth.visible for truth in truths if truth is not None], axis=0).sum()
    assert read_facts(tmp_path / "ball-9mps-corners-1.h5", plan.recordings[0]).points_3d_seen == seen > 0
