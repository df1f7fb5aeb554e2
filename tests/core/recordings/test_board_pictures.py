from pathlib import Path

import cv2
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from core.recordings.board_pictures import newest_blink, read_board_pictures, spread_evenly

SENSOR = SensorSize(64, 48)


def blinking(path: Path, names: tuple[str, ...] = ("left",)) -> Path:
    """A bright left half that goes on at 100 ms and off at 300 ms, with a few noise events all the time."""
    rng = np.random.default_rng(0)
    v, u = (axis.ravel() for axis in np.mgrid[:48, :32])
    parts = []
    for start_us, on in ((100_000, True), (300_000, False)):
        for _ in range(2):
            parts.append(np.column_stack([start_us + rng.integers(0, 4000, len(u)), u, v, np.full(len(u), on)]))
    noise = np.column_stack([rng.integers(0, 400_000, 200), rng.integers(0, 64, 200), rng.integers(0, 48, 200)])
    parts.append(np.column_stack([noise, np.arange(200) % 2]))
    rows = np.concatenate(parts)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    with RecordingWriter(path, dict.fromkeys(names, SENSOR)) as writer:
        for name in names:
            writer.append(name, Events.from_columns(*rows.T, SENSOR))
    return path


def test_a_folder_gives_its_pictures_by_name_evenly_spread(tmp_path: Path) -> None:
    for number in range(10):
        cv2.imwrite(str(tmp_path / f"{number:02d}.png"), np.full((48, 64, 3), 20 * number, np.uint8))
    (tmp_path / "notes.txt").write_text("not a picture")
    pictures = list(read_board_pictures(tmp_path, at_most=5))
    assert [picture.name for picture in pictures] == ["00.png", "02.png", "04.png", "06.png", "08.png"]
    assert [int(picture.grey[0, 0]) for picture in pictures] == [0, 40, 80, 120, 160]
    assert pictures[-1].share == 1.0 and pictures[0].grey.shape == (48, 64)


def test_events_of_a_blinking_board_become_pictures_of_its_bright_parts(tmp_path: Path) -> None:
    pictures = list(read_board_pictures(blinking(tmp_path / "blink.h5"), at_most=2))
    assert len(pictures) == 2
    for picture in pictures:
        assert picture.grey[:, :30].mean() > 200 and picture.grey[:, 34:].mean() < 20


def test_the_newest_blink_is_that_of_the_last_second_and_noise_is_none(tmp_path: Path) -> None:
    with open_recording(blinking(tmp_path / "blink.h5")) as recording:
        stream = recording.cameras["left"]
        for t_us, over_us in ((200_000, 1_000_000), (400_000, 200_000)):
            grey = newest_blink(stream, t_us, over_us=over_us)
            assert grey is not None and grey[:, :30].mean() > 200 and grey[:, 34:].mean() < 20
        assert newest_blink(stream, 90_000) is None and newest_blink(stream, 290_000, over_us=150_000) is None
        assert newest_blink(stream, 0) is None and newest_blink(stream, 3_000) is None


def test_frames_go_before_events_and_a_camera_can_be_chosen(tmp_path: Path) -> None:
    path = tmp_path / "both.h5"
    images = np.stack([np.full((48, 64, 3), 50 * k, np.uint8) for k in range(3)])
    with RecordingWriter(path, {"left": SENSOR, "rgb": SENSOR}) as writer:
        writer.append("left", Events.from_columns([5], [1], [2], [True], SENSOR))
        writer.write_frames("rgb", np.arange(3) * 1000, np.full(3, 500), images)
    assert [picture.name for picture in read_board_pictures(path)] == ["frame 0", "frame 1", "frame 2"]
    assert all(picture.name.startswith("events") for picture in read_board_pictures(path, camera="left"))
    with pytest.raises(RecordingError, match="no camera 'top'"):
        list(read_board_pictures(path, camera="top"))


def test_a_video_gives_its_pictures(tmp_path: Path) -> None:
    path = tmp_path / "board.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (64, 48))
    for number in range(12):
        video.write(np.full((48, 64, 3), 20 * number, np.uint8))
    video.release()
    pictures = list(read_board_pictures(path, at_most=4))
    assert [picture.name for picture in pictures] == ["picture 1", "picture 4", "picture 7", "picture 10"]
    np.testing.assert_allclose([picture.grey.mean() for picture in pictures], [20, 80, 140, 200], atol=4)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda folder: folder, "no pictures in the folder"),
        (lambda folder: folder / "no.mp4", "no such file"),
        (lambda folder: folder / "no.h5", "no such file"),
        (lambda folder: blinking(folder / "two.h5", ("left", "right")), "which camera"),
    ],
)
def test_a_source_without_pictures_is_one_clear_error(tmp_path: Path, make, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        list(read_board_pictures(make(tmp_path)))


def test_numbers_are_spread_evenly() -> None:
    assert spread_evenly(3, 5) == [0, 1, 2]
    assert spread_evenly(100, 4) == [12, 37, 62, 87]
    assert spread_evenly(0, 4) == []
