"""What a live recorder writes opens again and is what the live recording showed."""

from __future__ import annotations

import threading
import time

import h5py
import numpy as np
import pytest

from core.cameras import stereo_preset
from core.errors import RecordingError
from core.events import SensorSize
from core.rally.link.client import SimulationClient
from core.rally.link.server import ServerConfig, SimulationServer
from core.rally.live import LiveRecording
from core.rally.record_live import LiveRecorder
from core.recordings import open_recording


@pytest.fixture
def client():
    server = SimulationServer(ServerConfig(), stereo_preset("side", SensorSize(320, 240)), "tcp://127.0.0.1:0")
    ended = threading.Event()
    thread = threading.Thread(target=server.run, args=(ended.is_set,))
    thread.start()
    client = SimulationClient(server.address)
    yield client
    client.close()
    ended.set()
    thread.join()


def wait_for(true) -> None:
    until = time.monotonic() + 15
    while not true():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_a_recorded_rally_plays_back_as_it_was_seen(client, tmp_path):
    client.pause()
    live = LiveRecording()
    client.add_listener(live)
    recorder = LiveRecorder(client, tmp_path / "live.h5")
    t_us = client.step(5).t_us
    wait_for(lambda: live.duration_us >= t_us + 50_000)
    client.launch((1.0, 0.5, 0.3), (-5.0, 0.0, 1.0))
    t_us = client.step(120).t_us
    wait_for(lambda: live.duration_us >= t_us + 1_200_000)
    assert recorder.recording
    duration_us = recorder.stop()
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
        assert len(file["/racket/t_us"]) == len(file["/racket/q_world_wxyz"]) > 100


def test_a_new_session_ends_the_recording_and_a_file_is_not_overwritten(client, tmp_path):
    recorder = LiveRecorder(client, tmp_path / "live.h5")
    time.sleep(0.3)
    client.reset()
    wait_for(lambda: not recorder.recording)
    recorder.stop()
    open_recording(recorder.path).close()
    with pytest.raises(RecordingError):
        LiveRecorder(client, tmp_path / "live.h5")
