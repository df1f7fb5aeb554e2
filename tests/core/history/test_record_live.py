"""What a live recorder writes opens again and is what the live recording showed."""

from __future__ import annotations

import contextlib

import h5py
import numpy as np
import pytest

from core.cameras import stereo_preset
from core.cameras.presets import SENSOR_720
from core.errors import RecordingError
from core.events import SensorSize
from core.history.record_live import LiveRecorder
from core.history.recorded_rally import HIT_CHOICES, PREDICTIONS, REWARD, read_targets
from core.live.link.client import SimulationClient
from core.live.link.server import ServerConfig, SimulationServer
from core.live.live_player import LivePlayer, LivePlayerConfig
from core.live.ring_recording import RingRecording
from core.recordings import open_recording
from tests.core.live.stepped import play_block
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually


@pytest.fixture(params=[SensorSize(320, 240)])
def client(request):
    with serving(SimulationServer(ServerConfig(), stereo_preset("side", request.param), "tcp://127.0.0.1:0")) as server:
        client = SimulationClient(server.address, timeout_s=PATIENCE_S)
        client.wait_for_messages()  # else the first blocks may be published before the subscription arrives
        yield client
        client.close()


def test_a_recorded_rally_plays_back_as_it_was_seen(client, tmp_path):
    client.pause()
    live = RingRecording()
    client.add_listener(live)
    recorder = LiveRecorder(client, tmp_path / "live.h5")
    t_us = client.step(5).t_us
    eventually(lambda: live.duration_us >= t_us + 50_000, "the five blocks")
    t_us = client.launch((1.0, 0.5, 0.3), (-5.0, 0.0, 1.0)).t_us
    for number in range(12):  # no more at once than the link keeps for a slow listener
        client.step(10)
        eventually(lambda: live.duration_us >= t_us + 100_000 * (number + 1), "ten blocks")  # noqa: B023
    assert recorder.recording
    eventually(lambda: recorder.duration_us > 1_200_000, "what was simulated, however long that took")
    duration_us = recorder.stop()
    assert recorder.duration_us == duration_us
    zero_us = live.duration_us - duration_us
    assert live.start_us <= zero_us <= t_us
    recording = open_recording(recorder.path)
    for name, camera in live.cameras.items():
        seen = camera.slice(zero_us, live.duration_us)
        found = recording.cameras[name].slice(0, duration_us)
        np.testing.assert_array_equal(found.t_us + zero_us, seen.t_us)
        np.testing.assert_array_equal(found.x_px, seen.x_px)
        np.testing.assert_array_equal(found.on, seen.on)
        assert recording.cameras[name].calibration is not None
    assert recording.ball is not None and recording.ball.visible.sum() > 100
    recording.close()
    with h5py.File(recorder.path) as file:
        assert file["/episodes/case"][()].tolist() == [5]
        assert file["/episodes/s"][0, 0] == pytest.approx(-1.42)
        assert file["/scenes/name"][()].tolist() == [b"ball"] and file["/scenes/zero_us"][0] == zero_us
        assert len(file["/racket/t_us"]) == len(file["/racket/q_world_wxyz"]) > 100


def test_a_new_session_ends_the_recording_and_a_file_is_not_overwritten(client, tmp_path):
    recorder, live = LiveRecorder(client, tmp_path / "live.h5"), RingRecording()
    client.add_listener(live)
    eventually(lambda: live.duration_us - live.start_us > 50_000, "five blocks to record")
    client.reset()
    eventually(lambda: not recorder.recording, "the recording to end")
    recorder.stop()
    open_recording(recorder.path).close()
    with pytest.raises(RecordingError):
        LiveRecorder(client, tmp_path / "live.h5")


@pytest.mark.parametrize("client", [SENSOR_720], indirect=True)
def test_what_the_player_expected_and_decided_is_read_back(client, tmp_path):
    player = LivePlayer(client, config=LivePlayerConfig(hit="chosen"))
    heard, choices = [], []
    eventually(lambda: player.snapshot.t_us > 0, "the first block to be played")
    client.pause()
    recorder = LiveRecorder(client, tmp_path / "played.h5", player=player)
    player.add_listener(lambda session, state, decision: heard.append((state.chain.prediction, decision)))
    player.add_listener(lambda session, state, decision: choices.append(state.choice))
    play_block(client, player)
    client.serve(5.0)
    while player.snapshot.played == 0:
        play_block(client, player)
    ball = player.snapshot.finished[-1]
    for _ in range(5):
        play_block(client, player)
    recorder.stop()
    player.close()
    with contextlib.closing(open_recording(recorder.path)) as recording:
        predictions, targets = recording.read_rows(PREDICTIONS), read_targets(recording)
        racket, episodes = recording.read_rows("/racket"), recording.read_rows("/episodes")
        places = recording.read_rows(HIT_CHOICES)
    count = len(predictions["t_us"])
    expected = [one for one, _ in heard if one.hit_plane is not None][:count]
    assert count > 10
    zero_us = expected[0].t_us - int(predictions["t_us"][0])
    for k, one in enumerate(expected):
        found = {name: column[k] for name, column in predictions.items()}
        assert (found["t_us"] + zero_us, found["stage"].decode()) == (one.t_us, one.stage)
        assert found["t_hit_us"] + zero_us == round(1e6 * one.hit_plane.t_s)
        np.testing.assert_array_equal(found["p_hit_m"], one.hit_plane.p_world_m)
        np.testing.assert_array_equal(found["cov"], one.hit_plane.covariance)
    assert set(predictions["cameras"].tolist()) == {b"left+right"}
    made = list(dict.fromkeys(one for one in choices if one is not None))
    assert np.unique(places["t_us"] + zero_us).tolist() == [one.t_us for one in made if one.candidates]
    looked_at = [(one, place) for one in made for place in one.candidates]
    assert places["chosen"].tolist() == [place is one.chosen for one, place in looked_at] and places["chosen"].any()
    assert [why.decode() for why in places["why_not"]] == [place.why_not for _, place in looked_at]
    np.testing.assert_array_equal(places["p_hit_m"], [place.hit.p_world_m for _, place in looked_at])
    decided = [decision for _, decision in heard if decision is not None][: len(targets)]
    for found, one in zip(targets, decided, strict=True):
        assert found.t_us + zero_us == one.t_us
        np.testing.assert_array_equal(found.target.p_m, one.target.p_m)
        np.testing.assert_array_equal(found.action, one.action)
    assert episodes["s"][0] == pytest.approx(ball.decision.state) and episodes["g"][0].tolist() == [0.8, 0.0]
    assert episodes["a"][0] == pytest.approx(ball.decision.action) and episodes["policy"][0] == b"built-in"
    if ball.returned:
        accuracy = REWARD.base + REWARD.scale * max(0, 1 - ball.error_m / REWARD.reach_m)
        assert episodes["reward"][0] == pytest.approx(0.5 * REWARD.base + 0.5 * accuracy)
    gap_m = np.linalg.norm(racket["p_world_m"] - targets[-1].target.p_m, axis=1).min()
    assert gap_m < 0.05, "the racket went there"
