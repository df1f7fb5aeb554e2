"""Pictures as windows, and what becomes of a detector that looks at them."""

from pathlib import Path

import numpy as np
import pytest

from core.detection import Detection
from core.errors import EventsError
from core.events import CameraFrame, Events, SensorSize, Window
from core.metrics.run import run_on_frames
from core.recordings import RecordingWriter, open_recording
from core.recordings.frames import frame_windows, frames_in_memory, window_of

SENSOR = SensorSize(6, 4)


class BrightestPixel:
    """The brightest pixel of a picture, unless it is all dark."""

    extra_circles = 0

    def reset(self) -> None:
        pass

    def step(self, window: Window) -> Detection | None:
        assert window.frame is not None and not len(window.events)
        v, u = np.unravel_index(window.frame.image.argmax(), window.frame.image.shape)
        return Detection(window.frame.t_us, float(u), float(v), 1.0) if window.frame.image.any() else None


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    images = np.zeros((3, 4, 6), np.uint8)
    images[0, 1, 5], images[2, 3, 2] = 200, 90
    with RecordingWriter(tmp_path / "a.h5", {"rgb": SENSOR}) as writer:
        writer.append("rgb", Events.from_columns([1000], [3], [2], [True], SENSOR))
        writer.write_frames("rgb", np.array([1000, 21_000, 41_000]), np.array([501, 501, 0]), images)
        writer.extend_duration(50_000)
    return tmp_path / "a.h5"


def test_a_window_is_the_exposure_of_a_picture_and_has_none_of_the_events(recording) -> None:
    with open_recording(recording) as file:
        windows = list(frame_windows(file.frames["rgb"]))
    assert [(one.start_us, one.end_us) for one in windows] == [(750, 1251), (20_750, 21_251), (41_000, 41_001)]
    assert all(one.frame is not None and one.frame.t_us in (1000, 21_000, 41_000) for one in windows)
    assert all(len(one.events) == 0 and one.events.sensor == SENSOR for one in windows)


def test_a_detector_answers_every_picture_at_its_own_time(recording) -> None:
    shares: list[float] = []
    with open_recording(recording) as file:
        answers = run_on_frames(file.frames["rgb"], BrightestPixel(), progress=shares.append)
    assert answers.detected.tolist() == [True, False, True] and len(answers.detections) == 2
    assert answers.t_us.tolist() == [1000, 21_000, 41_000], "without an answer the middle of the exposure"
    assert (answers.u_px[0], answers.v_px[0], answers.u_px[2], answers.v_px[2]) == (5, 1, 2, 3)
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_it_can_be_cancelled(recording) -> None:
    with open_recording(recording) as file:
        answers = run_on_frames(file.frames["rgb"], BrightestPixel(), cancelled=lambda: True)
    assert len(answers.end_us) == 1


def test_a_picture_that_is_not_of_the_window_is_refused() -> None:
    frame = CameraFrame(5000, 100, np.zeros((4, 6), np.uint8))
    assert window_of(frame).start_us == 4950
    with pytest.raises(EventsError, match="a picture outside its window"):
        Window(Events.empty(SENSOR), 0, 5000, frame)


def test_a_span_has_the_pictures_of_its_mid_exposures_and_a_part_all_that_it_was_given(recording) -> None:
    with open_recording(recording) as file:
        frames = file.frames["rgb"]
        part = frames_in_memory([frames.frame(number) for number in frames.ending_within(1000, 21_251)])
        assert [*frames.of_span(1001, 41_000)] == [1] and [*frames.of_span(1000, 41_001)] == [0, 1, 2]
    assert part.t_us.tolist() == [1000, 21_000] and [*part.of_span(1001, 21_251)] == [0, 1]
