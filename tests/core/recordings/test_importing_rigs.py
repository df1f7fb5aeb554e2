"""Recordings of more than two cameras from event files: names, clocks, sizes, folders, pictures."""

import cv2
import numpy as np
import pytest

from app.cli.main import main
from core.cameras import Camera
from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import ImportOrder, import_recording, open_recording
from core.recordings.frame_import import FrameInput
from core.recordings.sources.folders import camera_names

SIZES = {"top": SensorSize(1280, 720), "left": SensorSize(346, 260), "right": SensorSize(640, 480)}
KINDS = {"top": "evt3", "left": "dat", "right": "evt3"}


@pytest.fixture
def rig(tmp_path, make_events, write_foreign):
    """Files of three cameras of different makes, with what they saw; they begin 100 us after each other."""
    folder = tmp_path / "rig"
    folder.mkdir()
    found = {}
    for number, (name, size) in enumerate(SIZES.items()):
        events = make_events(5_000, seed=number, duration_us=50_000, sensor=size, start_us=9_000_000 + 100 * number)
        suffix = ".dat" if KINDS[name] == "dat" else ".raw"
        found[name] = write_foreign(KINDS[name], folder / f"pair.{name}{suffix}", events), events
    return found


def test_cameras_of_any_make_and_size_become_one_recording_with_a_clock_each(tmp_path, rig):
    paths = [path for path, _ in rig.values()]
    offsets_us = (0, 120, -40)
    summary = import_recording(ImportOrder(paths, offset_us=offsets_us), tmp_path / "a.h5")
    assert summary is not None and list(summary.events) == list(SIZES)
    zero = min(int(events.t_us[0]) + add for (_, events), add in zip(rig.values(), offsets_us, strict=True))
    with open_recording(tmp_path / "a.h5") as recording:
        for (name, (_, events)), add in zip(rig.items(), offsets_us, strict=True):
            camera = recording.cameras[name]
            assert camera.sensor == SIZES[name]
            found = camera.slice(0, 10**6)
            np.testing.assert_array_equal(found.t_us, events.t_us + add - zero)
            np.testing.assert_array_equal(found.x_px, events.x_px)


def test_a_folder_is_the_recording_of_its_files(tmp_path, rig):
    folder = next(iter(rig.values()))[0].parent
    (folder / "pair.clock.csv").write_text("stamp_us,shift_us\n")
    (folder / "rig.yaml").write_text("a: 1\n")
    assert import_recording(ImportOrder([folder], offset_us=(5, 6, 7)), folder / "all.h5") is not None
    again = import_recording(ImportOrder([folder]), tmp_path / "again.h5")
    assert again is not None and list(again.events) == ["left", "right", "top"]  # by name
    with open_recording(folder / "all.h5") as recording:
        assert recording.cameras["left"].sensor == SIZES["left"]
        clocks = {name: camera.t_offset_us for name, camera in recording.cameras.items()}
    assert (clocks["left"] - clocks["top"], clocks["right"] - clocks["top"]) == (2, 1)


def test_a_folder_of_folders_names_its_cameras_by_them(tmp_path, rig):
    parent = tmp_path / "nested"
    for name, (path, _) in rig.items():
        (parent / name).mkdir(parents=True)
        path.rename(parent / name / f"events{path.suffix}")
    summary = import_recording(ImportOrder([parent]), tmp_path / "a.h5")
    assert summary is not None and set(summary.events) == set(SIZES)


def test_event_and_frame_cameras_stand_in_one_recording(tmp_path, rig):
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for number in range(3):
        cv2.imwrite(str(pictures / f"{number}.png"), np.full((20, 30, 3), 50 * number, np.uint8))
    times = tmp_path / "times.csv"
    times.write_text("".join(f"{9_000_000 + 10_000 * number}\n" for number in range(3)))
    paths = [path for path, _ in rig.values()]
    frames = FrameInput(pictures, times, 1000)
    import_recording(ImportOrder(paths, frames=frames), tmp_path / "a.h5")
    with open_recording(tmp_path / "a.h5") as recording:
        assert list(recording.cameras) == list(SIZES)
        assert list(recording.frames) == ["rgb"] and len(recording.frames["rgb"]) == 3
        assert recording.frames["rgb"].calibration is None
    known = {name: camera_at(size, number) for number, (name, size) in enumerate(SIZES.items())}
    known["rgb"] = camera_at(SensorSize(30, 20), 3)
    import_recording(ImportOrder(paths, frames=frames, calibration=known), tmp_path / "known.h5")
    with open_recording(tmp_path / "known.h5") as recording:
        assert not any("calibration" in note for note in recording.notes), "nothing of it is left out"
        found = recording.frames["rgb"].calibration
        assert found is not None and np.array_equal(found.T_world_camera, known["rgb"].T_world_camera)
        assert all(camera.calibration is not None for camera in recording.cameras.values())


def camera_at(size: SensorSize, number: int) -> Camera:
    """One of some cameras in a row, 1 m apart."""
    K = np.array([[400.0, 0, size.width_px / 2], [0, 400, size.height_px / 2], [0, 0, 1]])
    T_world_camera = np.eye(4)
    T_world_camera[0, 3] = number
    return Camera(size, K, np.zeros(5), T_world_camera)


def test_wrong_numbers_are_told_in_one_line(tmp_path, rig):
    paths, target = [path for path, _ in rig.values()], tmp_path / "a.h5"
    with pytest.raises(RecordingError, match=r"offsets do not fit.*3: one for each source.*got 2"):
        import_recording(ImportOrder(paths, offset_us=(1, 2)), target)
    with pytest.raises(RecordingError, match=r"names do not fit.*3 different"):
        import_recording(ImportOrder(paths, names=["a", "b"]), target)
    with pytest.raises(RecordingError, match="not a sensor size for each source"):
        import_recording(ImportOrder(paths, sensor=[SIZES["top"]] * 2), target)
    assert not target.exists()


def test_the_verb_takes_any_number_of_sources(tmp_path, rig, capsys):
    words = [str(path) for path, _ in rig.values()]
    target = tmp_path / "a.h5"
    assert main(["import", *words, str(target), "--names", "a,b,c", "--offset-us", "0,120,-40"]) == 0
    assert "c: 5,000 events" in capsys.readouterr().out
    sizes = ["--width", "1280,346,640", "--height", "720,260,480"]
    assert main(["import", *words, str(target), "--force", *sizes]) == 0
    assert main(["import", *words, str(target), "--force", "--width", "1280,346", "--height", "720"]) == 2
    assert "as many widths as heights" in capsys.readouterr().err


def test_offsets_of_a_pair_are_the_same_recording_as_one_number(tmp_path, rig):
    paths = [path for path, _ in rig.values()][:2]
    uuids = []
    for number, offset_us in enumerate((120, (0, 120), (0, 121))):
        import_recording(ImportOrder(paths, offset_us=offset_us), tmp_path / f"{number}.h5")
        with open_recording(tmp_path / f"{number}.h5") as recording:
            uuids.append(recording.uuid)
    assert uuids[0] == uuids[1] != uuids[2]


def test_cameras_are_called_by_what_their_files_do_not_share(tmp_path):
    assert camera_names([tmp_path / "take.left.raw", tmp_path / "take.right.raw"]) == ["left", "right"]
    assert camera_names([tmp_path / "evs1.raw", tmp_path / "evs 2.raw"]) == ["evs1", "evs-2"]
    assert camera_names([tmp_path / "a" / "events.h5", tmp_path / "b" / "events.h5"]) == ["a", "b"]
