"""Simulated recordings and their truth."""

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import open_recording
from core.simulation import (
    LaunchConfig,
    SensorConfig,
    StereoConfig,
    draw_serve_series,
    ensure_demo,
    pixel_truth,
    simulate_recording,
    simulate_stereo,
    truth_times,
)
from core.simulation.bodies import make_actors
from core.simulation.frames import FrameConfig

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset()
SMALL = stereo_preset(sensor=SensorSize(320, 240))


def test_the_truth_is_linear_enough_between_its_samples() -> None:
    flights = draw_serve_series([LaunchConfig(speed_mps=9.0), LaunchConfig(speed_mps=3.0)], np.random.default_rng(0))
    end_us = int(flights.end_s * 1e6)
    truth = pixel_truth(CAMERAS["left"], flights, truth_times(flights, 0, end_us))
    fine_us = np.arange(0, end_us, 137)
    exact, between = pixel_truth(CAMERAS["left"], flights, fine_us), truth.at(fine_us)
    both = exact.visible & between.visible
    assert both.sum() > 2000 and abs(int(exact.visible.sum()) - int(between.visible.sum())) < 20
    for column in ("u_px", "v_px", "r_px"):
        assert np.abs(getattr(exact, column) - getattr(between, column))[both].max() < 0.01


def test_the_leading_edge_of_the_events_lies_on_the_truth(serve_recording) -> None:
    recording = open_recording(serve_recording)
    stream = recording.cameras["left"]
    delay_us = SensorConfig().photoreceptor_us  # the photoreceptor shows the light of this long ago
    gaps = []
    for end_us in range(200_000, 320_000, 10_000):
        events = stream.slice(end_us - 300, end_us)
        now, before = (stream.truth.at(int(t)) for t in (end_us - 150 - delay_us, end_us - 1150 - delay_us))
        motion = np.array([now.u_px[0] - before.u_px[0], now.v_px[0] - before.v_px[0]])
        offset = np.stack([events.x_px - now.u_px[0], events.y_px - now.v_px[0]], axis=1)
        distance = np.linalg.norm(offset, axis=1)
        ahead = offset @ motion / np.maximum(distance * np.linalg.norm(motion), 1e-9) > 0.7
        edge = events.on & ahead & (np.abs(distance - now.r_px[0]) < 3)
        if edge.sum() > 10:
            gaps.append(np.median(distance[edge]) - now.r_px[0])
    recording.close()
    assert len(gaps) >= 8 and abs(np.median(gaps)) < 0.6


def test_a_recording_holds_events_truth_and_how_it_was_made(tmp_path) -> None:
    path = tmp_path / "made.h5"
    shares: list[float] = []
    made = simulate_recording(path, StereoConfig(), SMALL, [LaunchConfig()], seed=3, progress=shares.append)
    with_file = open_recording(path)
    try:
        assert with_file.duration_us == made.duration_us and made.finished
        assert {name: stream.event_count for name, stream in with_file.cameras.items()} == made.events
        for name, stream in with_file.cameras.items():
            assert stream.truth is not None and stream.calibration is not None
            assert np.allclose(stream.calibration.T_world_camera, SMALL[name].T_world_camera)
        assert with_file.ball is not None and with_file.ball.visible.any()
    finally:
        with_file.close()
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0)
    with pytest.raises(RecordingError, match="exists"):
        simulate_recording(path, StereoConfig(), SMALL, [LaunchConfig()], seed=3)


def test_a_cancelled_recording_keeps_what_there_is(tmp_path) -> None:
    path, calls = tmp_path / "short.h5", []

    def cancelled() -> bool:
        calls.append(None)
        return len(calls) > 10

    made = simulate_recording(path, StereoConfig(), SMALL, [LaunchConfig()], seed=3, cancelled=cancelled)
    assert not made.finished and made.duration_us == 100_000
    recording = open_recording(path)
    assert recording.duration_us == 100_000 and sum(s.event_count for s in recording.cameras.values()) > 0
    recording.close()


def test_a_demo_that_is_there_is_left_alone(tmp_path) -> None:
    path = tmp_path / "demo.h5"
    path.write_bytes(b"mine")
    ensure_demo(path)
    assert path.read_bytes() == b"mine" and list(tmp_path.iterdir()) == [path]


def test_a_demo_that_fails_leaves_nothing_behind(tmp_path) -> None:
    class StopError(Exception):
        pass

    def stop(share: float) -> None:
        raise StopError

    with pytest.raises(StopError):
        ensure_demo(tmp_path / "demo.h5", stop)
    assert list(tmp_path.iterdir()) == []


def test_a_scene_with_people_hides_the_ball_in_the_truth_too(tmp_path) -> None:
    """The head passes between the left camera and the ball of a rally's scene at some time; nobody does in `ball`."""
    flights = draw_serve_series([LaunchConfig(speed_mps=3.0)] * 8, np.random.default_rng(3))
    times_us = truth_times(flights, 0, int(flights.end_s * 1e6))
    camera = CAMERAS["left"]
    alone = pixel_truth(camera, flights, times_us).visible
    among = pixel_truth(camera, flights, times_us, make_actors("head", 0)).visible
    assert 0 < (alone & ~among).sum() < 0.5 * alone.sum() and not (among & ~alone).any()


def test_pictures_change_nothing_in_the_events_and_lie_beside_them(tmp_path) -> None:
    serves, frames = [LaunchConfig(speed_mps=9.0)], FrameConfig(rate_hz=40.0)
    made = simulate_recording(tmp_path / "a.h5", StereoConfig(), SMALL, serves, seed=3, frames=frames, threads=1)
    flights = draw_serve_series(serves, np.random.default_rng(3))
    found: dict[str, list[np.ndarray]] = {name: [] for name in SMALL}
    for chunk in simulate_stereo(StereoConfig(), SMALL, flights, seed=3):  # the way of recordings before there were any
        for name, events in chunk.events.items():
            found[name].append(np.stack([events.t_us, events.x_px, events.y_px, events.on]))
    with open_recording(tmp_path / "a.h5") as recording:
        for name, parts in found.items():
            events = recording.cameras[name].slice(0, recording.duration_us)
            assert np.array_equal(np.stack([events.t_us, events.x_px, events.y_px, events.on]), np.hstack(parts))
            pictures = recording.frames[name]
            assert pictures.t_us.tolist() == list(range(12_500, made.duration_us - 2500 + 1, 25_000))
            assert (pictures.exposure_us == 5000).all() and pictures.image(3).shape == (240, 320, 3)
            rows = recording.read_rows(f"/readout/{name}")
            assert rows is not None and rows["dropped"].tolist() == [made.dropped[name]]
        assert made.frames == 2 * len(recording.frames["left"])


def test_without_pictures_there_are_none(tmp_path) -> None:
    made = simulate_recording(tmp_path / "a.h5", StereoConfig(), SMALL, [LaunchConfig(speed_mps=9.0)], seed=3)
    with open_recording(made.path) as recording:
        assert made.frames == 0 and not recording.frames
