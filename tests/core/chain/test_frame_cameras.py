"""Frame cameras beside event cameras: a picture comes when it is exposed and moves the flight at its own time."""

from pathlib import Path
from typing import Final

import numpy as np
import pytest

from core.cameras.presets import camera_preset
from core.cameras.stereo import TriangulationConfig
from core.chain import ChainConfig, RallyChain, follow_recording
from core.chain.config import SizeCheckConfig
from core.chain.follow import calibrated_rig, frame_cameras, windows_with_frames
from core.detection import Detection
from core.events import CameraFrame, Events, Window
from core.recordings import BallTruth, RecordingWriter, open_recording
from core.recordings.frames import window_of
from core.trajectory.ball_kernel import fly_and_bounce

pytestmark = pytest.mark.numeric
RIG: Final = camera_preset("corners")
EVENT_CAMERAS: Final = ("near_left", "near_right")
FRAMES: Final = "far_left"
CAMERAS: Final = {name: RIG[name] for name in (*EVENT_CAMERAS, FRAMES)}
START: Final = np.array([0.9, 0.1, 0.3, -6.0, 0.3, 0.5, 0, 0, 0, 0.0, 0.9, 0.15, 0.0, 0.0])
BLANK: Final = np.zeros((9, 16), np.uint8)
EXPOSURE_US: Final = 12_000
"""Its middle is 6 ms before its end, and so the answer later than that of an event camera may be."""


def place(t_us: float) -> np.ndarray:
    x = START.copy()
    fly_and_bounce(x, 1e-6 * t_us, 0.0)
    return x[:3]


class TrueDetector:
    """Where the ball is in a camera's picture: of events at the end of the window, of a picture at mid exposure."""

    extra_circles = 0

    def __init__(self, name: str, blind_from_us: float = np.inf, off_px: float = 0.0) -> None:
        self._camera, self._blind_from_us, self._off_px = CAMERAS[name], blind_from_us, off_px

    def reset(self) -> None: ...

    def step(self, window: Window) -> Detection | None:
        t_us = window.end_us if window.frame is None else window.frame.t_us
        if window.end_us > self._blind_from_us:
            return None
        u, v = self._camera.project(place(t_us)[None])[0] + self._off_px
        return Detection(t_us, float(u), float(v), 8.0)


def follow(seconds: float = 0.2, *, blind_from_us: float = np.inf, off_px: float = 0.0, pictures: bool = True):
    """States of the chain: two event cameras every 2 ms, a picture every 16 ms whose exposure ends then."""
    detectors = {
        "near_left": TrueDetector("near_left", off_px=0.0),
        "near_right": TrueDetector("near_right", blind_from_us),
        FRAMES: TrueDetector(FRAMES, off_px=off_px),
    }
    config = ChainConfig(size=SizeCheckConfig(enabled=False), triangulation=TriangulationConfig(sigma_px=0.2))
    chain = RallyChain(CAMERAS, config, detectors)
    states = []
    for end_us in range(2000, round(1e6 * seconds), 2000):
        windows = {name: Window(Events.empty(RIG[name].sensor), end_us - 2000, end_us) for name in EVENT_CAMERAS}
        if pictures and end_us % 16_000 == 0:
            windows[FRAMES] = window_of(CameraFrame(end_us - EXPOSURE_US // 2, EXPOSURE_US, BLANK))
        states.append(chain.step(windows))
    return states


def test_every_picture_of_a_flight_moves_it_at_the_middle_of_its_exposure() -> None:
    states = [state for state in follow() if state.t_us > 32_000]
    pictures = [state for state in states if state.t_us % 16_000 == 0]
    moved = [state for state in pictures if FRAMES in state.single]
    assert len(pictures) == 10 and len(moved) >= 8, "all but those around the bounce"
    assert all(state.used == {*EVENT_CAMERAS, FRAMES} for state in moved)
    assert all(state.point is not None and np.linalg.norm(state.point.p_world_m - place(state.point.t_us)) < 1e-3
               for state in states)  # fmt: skip
    assert all(FRAMES not in state.used for state in states if state.t_us % 16_000), "only when there is a new one"


def test_a_prediction_is_made_from_all_cameras_that_were_used_since_the_one_before_it() -> None:
    used, predictions = set(), []
    for state in follow():
        used |= state.used
        if state.is_new:
            predictions.append(state.predicted_from)
            assert state.predicted_from == tuple(name for name in CAMERAS if name in used)
            used = set()
        assert state.predicted_from == (predictions[-1] if predictions else ())
    both = tuple(EVENT_CAMERAS)
    assert set(predictions) == {both, (*both, FRAMES)} and predictions.count(both) > 8


def test_a_picture_of_something_else_moves_nothing() -> None:
    assert not any(FRAMES in state.single for state in follow(off_px=60.0))


def test_pictures_hold_the_depth_that_one_event_camera_alone_does_not_know() -> None:
    blind_us, sigmas = 60_000, {}
    for pictures in (False, True):
        states = follow(0.13, blind_from_us=blind_us, pictures=pictures)
        last = [state.point for state in states if state.point is not None][-1]
        assert last.t_us > blind_us + 50_000 and last.uvs_px.keys() == {"near_left"}
        sigmas[pictures] = np.sqrt(np.linalg.eigvalsh(last.covariance_m2)[-1])
        assert np.linalg.norm(last.p_world_m - place(last.t_us)) < 4e-3
    assert sigmas[True] < 0.95 * sigmas[False], "after three pictures"


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """Events of two cameras without any ball in them, and pictures of the third."""
    sensors = {name: camera.sensor for name, camera in CAMERAS.items()}
    with RecordingWriter(tmp_path / "mixed.h5", sensors, calibration=CAMERAS) as writer:
        for name in EVENT_CAMERAS:
            writer.append(name, Events.from_columns([1000, 99_000], [3, 3], [2, 2], [True, True], sensors[name]))
        t_us = np.array([5_000, 20_000, 23_000, 60_000])
        writer.write_frames(FRAMES, t_us, np.full(4, 6_000), np.zeros((4, 9, 16), np.uint8))
        none = np.empty((0, 3))
        writer.write_ball(BallTruth(np.empty(0, np.int64), none, none, none, np.empty(0, np.bool_)))
        writer.extend_duration(100_000)
    return tmp_path / "mixed.h5"


def test_a_frame_camera_of_a_recording_is_part_of_the_rig(mixed: Path) -> None:
    with open_recording(mixed) as recording:
        assert list(recording.cameras) == list(EVENT_CAMERAS) and list(frame_cameras(recording)) == [FRAMES]
        rig = calibrated_rig(recording)
    assert list(rig) == [*EVENT_CAMERAS, FRAMES]
    assert np.array_equal(rig[FRAMES].T_world_camera, CAMERAS[FRAMES].T_world_camera)


def test_a_picture_comes_in_the_window_in_which_its_exposure_ends_the_newest_of_two(mixed: Path) -> None:
    with open_recording(mixed) as recording:
        steps = list(windows_with_frames(recording.cameras, frame_cameras(recording), 100_000, 10_000))
    pictures = {number: one[FRAMES].frame for number, one in enumerate(steps) if FRAMES in one}
    came = {number: frame.t_us for number, frame in pictures.items() if frame is not None}
    assert came == {0: 5_000, 2: 23_000, 6: 60_000}, "[17, 23) and [20, 26) ms end in one window"
    assert len(steps) == 10 and all(set(EVENT_CAMERAS) <= one.keys() for one in steps)


class CountingDetector:
    """No ball in any picture; says which it saw."""

    extra_circles = 0
    seen: tuple[int, ...] = ()

    def reset(self) -> None: ...

    def step(self, window: Window) -> None:
        assert window.frame is not None
        self.seen = (*self.seen, window.frame.t_us)


def test_a_recording_is_followed_with_its_pictures_where_there_is_a_detector_for_them(mixed: Path) -> None:
    detector = CountingDetector()
    with open_recording(mixed) as recording:
        track = follow_recording(recording, ChainConfig(), 2000, frame_detector=lambda: detector)
        alone = follow_recording(recording, ChainConfig(), 2000)
    assert detector.seen == (5_000, 20_000, 23_000, 60_000)
    assert track.windows == alone.windows == 50 and track.single == {} and not len(track.t_us)
