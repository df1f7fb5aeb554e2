"""Recordings in which the robot plays: racket, targets and episodes beside events, truth and pictures."""

from pathlib import Path

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.data_sets.robot_recording import record_robot
from core.errors import ConfigError
from core.events import SensorSize
from core.history.recorded_rally import EPISODES, RACKET, read_choices, read_targets
from core.live.worlds.world import WorldConfig
from core.physics.task import task_profile
from core.recordings import open_recording
from core.recordings.reader import FileRecording
from core.simulation import StereoConfig, scene_named
from core.simulation.frames import FrameConfig
from core.simulation.recording import SimulatedRecording

SPEEDS = (5.0, 8.0)
CAMERAS = stereo_preset("behind", SensorSize(160, 90))
WIDE = {name: camera for name, camera in stereo_preset("behind").items() if name == "left"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> SimulatedRecording:
    path = tmp_path_factory.mktemp("robot") / "robot.h5"
    return record_robot(path, WorldConfig(), CAMERAS, SPEEDS, seed=4, frames=FrameConfig(rate_hz=50.0))


@pytest.fixture(scope="module")
def recording(made: SimulatedRecording) -> FileRecording:
    return open_recording(made.path)


def test_every_serve_is_an_episode_of_its_speed_that_lands_where_it_was_sent(recording) -> None:
    rows = recording.read_rows(EPISODES)
    assert rows is not None and np.allclose(rows["speed_mps"], SPEEDS) and rows["case"].tolist() == [4, 4]
    assert np.abs(rows["f"][:, :2] - rows["g"]).max() < 1e-3, "the state is known, so nothing is off"
    assert (rows["serve_us"] % 10_000 == 0).all() and rows["policy"].tolist() == [b"built-in"] * 2
    assert rows["reward"] == pytest.approx(2.5, abs=0.01), "half of l_base, and half of l_base + l_scale"


def test_the_state_of_an_episode_is_the_ball_at_the_hitting_plane(recording) -> None:
    rows, ball, targets = recording.read_rows(EPISODES), recording.ball, read_targets(recording)
    assert rows is not None and ball is not None
    for state, target in zip(rows["s"], targets[1::2], strict=True):
        hit_us = round(target.target.t_s * 1e6)
        before = ball.t_us <= hit_us - 500
        p, v, t = ball.p_world_m[before][-1], ball.v_world_mps[before][-1], ball.t_us[before][-1]
        assert np.allclose(p + v * (hit_us - t) * 1e-6, state[:3], atol=1e-4)
        assert state[0] == pytest.approx(-1.42)


def test_the_racket_is_written_every_2_ms_and_is_where_it_was_sent_when_the_ball_comes(recording) -> None:
    rows, targets = recording.read_rows(RACKET), read_targets(recording)
    assert rows is not None and np.array_equal(rows["t_us"], np.arange(0, recording.duration_us, 2000))
    assert np.linalg.norm(rows["q_world_wxyz"], axis=1) == pytest.approx(1.0)
    assert [target.stage for target in targets] == ["pre", "post"] * 2
    for early, late in zip(targets[::2], targets[1::2], strict=True):
        assert not early.action.any() and late.action.any(), "the orientation is decided after the bounce"
        row = int(np.searchsorted(rows["t_us"], late.target.t_s * 1e6)) - 1
        lead_s = late.target.t_s - rows["t_us"][row] * 1e-6
        reached = rows["p_world_m"][row] + lead_s * rows["v_world_mps"][row]
        assert np.linalg.norm(reached - late.target.p_m) < 1e-3
        assert abs(abs(float(rows["q_world_wxyz"][row] @ late.target.q_wxyz)) - 1) < 1e-6


def test_events_truth_and_pictures_are_there_and_counted(made, recording) -> None:
    assert made.duration_us == recording.duration_us and made.serves == 2
    truths = 0
    for name, stream in recording.cameras.items():
        assert stream.event_count == made.events[name] > 1000
        assert stream.truth is not None and (np.diff(stream.truth.t_us) >= 0).all()
        truths += int(stream.truth.visible.sum())
        t_us = recording.frames[name].t_us
        assert np.array_equal(t_us, np.arange(len(t_us)) * 20_000 + 10_000)
        assert recording.frames[name].image(0).shape == (90, 160, 3)
    assert made.truths == truths > 0
    assert made.frames == sum(len(frames) for frames in recording.frames.values()) >= 2 * 50 * 3


def test_the_racket_is_in_the_pictures(tmp_path: Path) -> None:
    made = record_robot(
        tmp_path / "a.h5", WorldConfig(), WIDE, [9.0], seed=1, frames=FrameConfig(rate_hz=10.0, read_noise=0.0)
    )
    with open_recording(made.path) as recording:
        rows, frames = recording.read_rows(RACKET), recording.frames["left"]
        assert rows is not None
        black = round(255 * 0.04 ** (1 / 2.2))
        for number in range(3):
            at = int(np.searchsorted(rows["t_us"], frames.t_us[number]))
            u, v = WIDE["left"].project(rows["p_world_m"][at] - [0.03, 0.0, 0.0]).ravel()
            assert abs(frames.image(number)[round(v), round(u)].astype(int) - black).max() <= 1


def test_the_same_seed_makes_the_same_recording_whatever_the_threads(made, recording, tmp_path: Path) -> None:
    again = record_robot(tmp_path / "again.h5", WorldConfig(), CAMERAS, SPEEDS[:1], seed=4, threads=1)
    end_us = again.duration_us - 150_000
    with open_recording(again.path) as same:
        for name, stream in recording.cameras.items():
            ours, theirs = stream.slice(0, end_us), same.cameras[name].slice(0, end_us)
            assert len(ours) > 1000 and np.array_equal(ours.t_us, theirs.t_us)
            assert np.array_equal(ours.x_px, theirs.x_px) and np.array_equal(ours.y_px, theirs.y_px)
        assert EPISODES in same.groups and not same.frames, "no pictures unless asked for"


def test_two_players_need_no_robot(tmp_path: Path) -> None:
    world = WorldConfig(stereo=StereoConfig(scene=scene_named("rally")))
    with pytest.raises(ConfigError, match="two players have the table"):
        record_robot(tmp_path / "a.h5", world, CAMERAS, [5.0], seed=1)
    assert list(tmp_path.iterdir()) == []


def test_the_robot_meets_slow_balls_where_they_can_be_met_and_the_recording_says_where(tmp_path: Path) -> None:
    world = WorldConfig(task=task_profile("real"))
    made = record_robot(tmp_path / "a.h5", world, CAMERAS, [3.0, 3.0], seed=3, hit="chosen")
    with open_recording(made.path) as recording:
        episodes, targets, choices = recording.read_rows(EPISODES), read_targets(recording), read_choices(recording)
    assert episodes is not None and episodes["case"].tolist() == [4, 4] and len(choices) == 2
    for choice, target in zip(choices, targets[1::2], strict=True):
        assert choice.chosen is not None and len(choice.candidates) > 5
        np.testing.assert_allclose(target.state[:3], choice.chosen.hit.p_world_m, atol=1e-6)
        assert target.target.t_s == pytest.approx(choice.chosen.hit.t_s, abs=2e-6)
