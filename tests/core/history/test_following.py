"""When it was seen what came of a recorded ball: rows of episodes do not say, the true ball does. And frame cameras."""

import numpy as np
import pytest

from core.cameras.presets import camera_preset
from core.detection import Detection
from core.events import Events, Window
from core.history.following import Following, Followings, add_known
from core.history.rally_history import RallyHistory
from core.history.recorded_rally import EPISODES
from core.physics.episode import Case
from core.recordings import BallTruth, RecordingWriter, open_recording

SERVES_US = (50_000, 1_050_000)


class Rows:
    """Two balls: one lands at (0.8, 0.1), of the other nobody knows where it went."""

    def read_rows(self, group: str):
        if group != EPISODES:
            return None
        landing = np.array([[0.8, 0.1, 0.02], [np.nan] * 3])
        case = np.array([Case.RETURNED, Case.MISSED])
        return {"serve_us": np.array(SERVES_US), "speed_mps": np.array([5.0, 5.0]), "case": case, "f": landing}


def ball() -> BallTruth:
    """Straight along x at 2 m/s, past the landing spot 0.4 s after the serve, gone 0.8 s after it."""
    t_us = np.arange(0, 2_000_000, 1000)
    since_s = ((t_us - SERVES_US[0]) % 1_000_000) / 1e6
    p = np.column_stack([2.0 * since_s, np.full(len(t_us), 0.1), np.full(len(t_us), 0.02)])
    there = since_s < 0.8
    p[~there] = np.nan
    return BallTruth(t_us, p, np.zeros_like(p), np.zeros_like(p), there)


def test_a_landing_is_seen_when_the_ball_lands_and_a_lost_ball_when_it_is_gone() -> None:
    history = RallyHistory()
    add_known(history, ball(), Rows())
    spots = {t_us: len(history.at(t_us, {}).picture.spots) for t_us in (440_000, 460_000, 1_840_000, 1_860_000)}
    assert spots == {440_000: 0, 460_000: 1, 1_840_000: 1, 1_860_000: 2}


@pytest.mark.parametrize("truth", [None, BallTruth(np.empty(0, np.int64), *[np.empty((0, 3))] * 3, np.empty(0, bool))])
def test_without_a_true_ball_it_is_known_at_the_serve(truth) -> None:
    history = RallyHistory()
    add_known(history, truth, Rows())
    assert len(history.at(SERVES_US[0], {}).picture.spots) == 1


def test_frame_cameras_are_followed_where_there_is_a_detector_for_them(tmp_path) -> None:
    rig = {name: camera for name, camera in camera_preset("corners").items() if name != "far_right"}
    with RecordingWriter(
        tmp_path / "a.h5", {name: camera.sensor for name, camera in rig.items()}, calibration=rig
    ) as writer:
        for name in ("near_left", "near_right"):
            writer.append(name, Events.from_columns([1000], [3], [2], [True], rig[name].sensor))
        writer.write_frames("far_left", np.array([5_000]), np.array([4_000]), np.zeros((1, 9, 16), np.uint8))
        writer.extend_duration(20_000)
    with open_recording(tmp_path / "a.h5") as recording:
        followings = Followings()
        without = followings.of(recording)
        assert without is not None and list(without.cameras) == ["near_left", "near_right"]
        without.wait()
        detector = PictureDetector()
        following = Following(recording, frame_detector=lambda: detector)
        following.wait()
        assert list(following.cameras) == ["near_left", "near_right", "far_left"] and following.share == 1.0
        step = following.history.at(20_000, {}).step
        assert step is not None and step.circles == {}, "it was found in the step of its picture"
        assert [one.t_us for one in following.history.steps_between(0, 20_000) if one.circles] == [8_000]
        followings.close()


class PictureDetector:
    """A ball in every picture."""

    extra_circles = 0

    def reset(self) -> None: ...

    def step(self, window: Window) -> Detection | None:
        return None if window.frame is None else Detection(window.frame.t_us, 8.0, 4.0, 2.0)
