"""Cameras are a live source: recordings in their place, in the driver's own packets, give what the files give."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from core.chain import ChainConfig, RallyChain
from core.chain.control.player import PlayerState
from core.detection import make_detector
from core.detection.window import windows_between, windows_side_by_side
from core.devices.neuromorphic import open_camera
from core.errors import DeviceError
from core.events import Events, SensorSize
from core.history.record_live import LiveRecorder
from core.live.camera_source import CameraSource
from core.live.link import messages as m
from core.live.live_player import LivePlayer
from core.live.ring_recording import RingRecording
from core.live.stream_watch import StreamWatch
from core.recordings import open_recording
from tests.core.devices.replayed_hardware import ENDLESS, RING, Replayed, ReplayedLibrary
from tests.waiting import eventually

SENSOR = SensorSize(1280, 720)
BLOCK_US = 10_000


class Noise:
    """A stream of events that are known: one for each pixel number n at n x 10 us."""

    sensor = SENSOR

    def slice(self, start_us: int, end_us: int) -> Events:
        numbers = np.arange(-(-start_us // 10), -(-end_us // 10))
        return Events.from_columns(numbers * 10, numbers % 1280, numbers // 1280 % 720, numbers % 2 == 0, SENSOR)


class Loaded:
    """A camera of a recording, in memory: USB needs no time to unpack a file."""

    def __init__(self, stream, duration_us: int) -> None:
        self.sensor, self._events = stream.sensor, stream.slice(0, duration_us)

    def slice(self, start_us: int, end_us: int) -> Events:
        return self._events.between(start_us, end_us)


class Heard:
    """Remembers what is told of blocks."""

    def __init__(self) -> None:
        self.blocks: list[tuple[int, dict[str, Events]]] = []
        self.sessions: list[str] = []
        self._batches: dict[str, Events] = {}

    def on_session(self, welcome: m.Reply) -> None:
        self.sessions.append(welcome.session)

    def on_events(self, batch: m.EventBatch) -> None:
        self._batches[batch.camera] = batch.events()

    def on_state(self, state: m.WorldState) -> None:
        self.blocks.append((state.t_us, self._batches))
        self._batches = {}

    def on_notice(self, notice: m.Notice) -> None:
        raise AssertionError("cameras have no notices")

    def events(self, name: str, blocks: int | None = None) -> np.ndarray:
        """(N, 3) time, x, y of all that was told of a camera, or in so many blocks: `Noise` repeats after 9 s."""
        parts = [seen[name] for _, seen in self.blocks[:blocks] if name in seen]
        return np.concatenate([np.column_stack([one.t_us, one.x_px, one.y_px]) for one in parts])


@contextmanager
def cameras(seen: dict[str, Replayed], *, cable: bool = True, **settings) -> Iterator[tuple]:
    """A source of held cameras, and their library. Nothing is lost or skipped because the machine stood still."""
    seen = {name: replace(one, ring=ENDLESS) if one.ring == RING else one for name, one in seen.items()}
    settings = {"behind_us": ENDLESS} | settings
    library = ReplayedLibrary({f"000{k}": one for k, one in enumerate(seen.values())}, hold=True)
    devices = {name: open_camera(f"000{k}", driver=library) for k, name in enumerate(seen)}
    source = CameraSource(devices, cable=cable, **settings)
    try:
        yield source, library
    finally:
        source.close()
        assert all(device.closed for device in library.opened)


def of_recording(recording) -> dict[str, Replayed]:
    duration_us = recording.duration_us
    return {
        name: Replayed(stream=Loaded(stream, duration_us), duration_us=duration_us)
        for name, stream in recording.cameras.items()
    }


def calibration_of(recording):
    return {name: stream.calibration for name, stream in recording.cameras.items()}


@pytest.fixture(scope="module")
def recording(serve_recording):
    with open_recording(serve_recording) as opened:
        yield opened


@pytest.mark.parametrize("method", ["paper", "refined"])
def test_a_recorded_pair_through_the_camera_path_gives_the_offline_detections_exactly(recording, method):
    seen = of_recording(recording)
    with cameras(seen, calibration=calibration_of(recording)) as (source, library):
        ring, heard = RingRecording(), Heard()
        source.add_listener(ring)
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 60, "60 blocks")
        source.listen(False)
        assert [t_us for t_us, _ in heard.blocks[:60]] == [BLOCK_US * (k + 1) for k in range(60)]
        for name, stream in recording.cameras.items():
            live, file = ring.cameras[name].slice(0, 600_000), stream.slice(0, 600_000)
            for column in ("t_us", "x_px", "y_px", "on"):
                np.testing.assert_array_equal(getattr(live, column), getattr(file, column))
            found = {}
            for kind, one in {"file": stream, "live": ring.cameras[name]}.items():
                detector = make_detector(method, one.sensor, ChainConfig.of_method(method).detector)
                found[kind] = [detector.step(window) for window in windows_between(one, 0, 600_000, 2000)]
            assert sum(one is not None for one in found["file"]) > 100
            assert found["live"] == found["file"]
        counts = [report.counts for report in source.reports()]
        assert all(one.events_given_up == one.packets_dropped == one.packets_refused == 0 for one in counts)


@pytest.mark.gate
def test_the_live_chain_on_cameras_sees_what_the_chain_sees_in_the_file(recording):
    chain = RallyChain(calibration_of(recording), ChainConfig())
    offline = [chain.step(one) for one in windows_side_by_side(recording.cameras, 0, 600_000, 2000)]
    steps: list[PlayerState] = []
    with cameras(of_recording(recording), calibration=calibration_of(recording)) as (source, library):
        player = LivePlayer(source)
        player.add_step_listener(lambda session, state, decision: steps.append(state))
        eventually(lambda: player.snapshot.session, "a session of the player")

        class Patient(Heard):
            def on_state(self, state: m.WorldState) -> None:
                eventually(lambda: player.snapshot.t_us >= state.t_us, "the player to follow the block")
                super().on_state(state)

        heard = Patient()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 60, "60 blocks")
        source.listen(False)
        assert not player.playing
        player.close()
        assert not source.blocks_skipped
    assert sum(state.point is not None for state in offline) > 100
    for live, known in zip([step.chain for step in steps[:300]], offline, strict=True):
        assert live.t_us == known.t_us and live.detections == known.detections and live.verdict == known.verdict


@pytest.mark.gate
def test_two_clocks_are_made_one_without_a_cable():
    """The second camera's clock began elsewhere and drifts: what both see at a time has that time."""
    seen = {
        "left": Replayed(stream=Noise(), duration_us=10**9, jitter_s=0.002),
        "right": Replayed(stream=Noise(), duration_us=10**9, offset_us=123_456_789, drift=50e-6, jitter_s=0.002),
    }
    with cameras(seen, cable=False) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 300, "300 blocks")
        source.listen(False)
        left, right = heard.events("left", 300), heard.events("right", 300)
        reports = source.reports()
    times = {(x, y): t for t, x, y in left}
    apart = np.array([t - times[x, y] for t, x, y in right if (x, y) in times])
    assert len(apart) > 100_000 and np.abs(apart).max() < 500
    assert np.abs(np.median(apart[-50_000:])) < 200
    assert (np.diff(right[:, 0]) >= 0).all()
    assert reports[1].clock is not None and reports[1].clock.span_us > 1_000_000


def test_three_cameras_without_a_cable_are_on_the_clock_of_the_first():
    seen = {
        "a": Replayed(stream=Noise(), duration_us=10**9),
        "b": Replayed(stream=Noise(), duration_us=10**9, offset_us=5_000_000, drift=80e-6),
        "c": Replayed(stream=Noise(), duration_us=10**9, offset_us=123_456_789, drift=-50e-6),
    }
    with cameras(seen, cable=False) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 100, "100 blocks")
        source.listen(False)
        first, *others = (heard.events(name, 100) for name in seen)
    times = {(x, y): t for t, x, y in first}
    for events in others:
        apart = np.array([t - times[x, y] for t, x, y in events if (x, y) in times])
        assert len(apart) > 10_000 and np.abs(np.median(apart)) < 500


def test_a_camera_that_is_unplugged_is_missing_in_words_and_the_other_goes_on():
    seen = {name: Replayed(stream=Noise(), duration_us=10**9) for name in ("left", "right")}
    with cameras(seen) as (source, library):
        heard, watch = Heard(), StreamWatch()
        source.add_listener(heard)
        source.add_listener(watch)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 20, "20 blocks")
        library.opened[1].unplugged = True
        eventually(lambda: source.reports()[1].problem, "the loss of the camera")
        eventually(lambda: list(heard.blocks[-1][1]) == ["left"], "a block without the camera")
        blocks = len(heard.blocks)
        eventually(lambda: len(heard.blocks) >= blocks + 80, "80 blocks without the camera")
        assert {tuple(batches) for _, batches in heard.blocks[blocks:]} == {("left",)}
        assert source.status == "connected" and "the device was disconnected" in source.reports()[1].problem
        left, right = watch.health().cameras
        assert left.blocks_missing == 0 and right.lost
        library.opened[0].unplugged = True
        eventually(lambda: source.status == "lost", "the loss of both cameras")


@pytest.mark.parametrize("gone", [0, 1])
def test_a_camera_that_goes_before_the_clocks_are_known_holds_nobody_up(gone):
    seen = {name: Replayed(stream=Noise(), duration_us=10**9) for name in ("left", "right")}
    with cameras(seen, cable=False) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: source.reports()[gone].counts.events, "events of the camera")
        library.opened[gone].unplugged = True
        other = ["left", "right"][1 - gone]
        eventually(
            lambda: [list(batches) for _, batches in heard.blocks[-10:]] == [[other]] * 10, "ten blocks of the other"
        )


def test_the_first_camera_may_be_the_one_that_goes():
    seen = {name: Replayed(stream=Noise(), duration_us=10**9) for name in ("left", "right")}
    with cameras(seen) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 50, "50 blocks")
        library.opened[0].unplugged = True
        eventually(lambda: source.reports()[0].problem, "the loss of the camera")
        eventually(lambda: list(heard.blocks[-1][1]) == ["right"], "a block without the camera")
        blocks = len(heard.blocks)
        eventually(lambda: len(heard.blocks) >= blocks + 50, "50 blocks without the camera")
        assert {tuple(batches) for _, batches in heard.blocks[blocks:]} == {("right",)}
        assert [t_us for t_us, _ in heard.blocks] == [BLOCK_US * (k + 1) for k in range(len(heard.blocks))]


def test_packets_that_the_driver_lost_are_counted_and_the_rest_comes():
    seen = {"only": Replayed(stream=Noise(), duration_us=10**9, ring=20)}
    with cameras(seen) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.began_s = time.monotonic() - 0.5  # 500 packets wait for a ring of 20
        eventually(lambda: len(heard.blocks) >= 20, "20 blocks")
    (report,) = source.reports()  # after the last packet
    device = library.opened[0]
    assert report.counts.packets_dropped >= 400 and report.counts.gaps >= 1
    assert device.events_dropped == 100 * report.counts.packets_dropped


def test_who_listens_too_slowly_loses_whole_blocks_which_are_counted():
    seen = {"only": Replayed(stream=Noise(), duration_us=10**9)}
    with cameras(seen, behind_us=500_000) as (source, library):

        class Slow(Heard):
            def on_state(self, state: m.WorldState) -> None:
                if len(self.blocks) == 4:
                    until_us = state.t_us + 2_000_000
                    eventually(lambda: source._feeds[0].complete_us >= until_us, "two seconds of the camera")
                super().on_state(state)

        heard, watch = Slow(), StreamWatch()
        source.add_listener(heard)
        source.add_listener(watch)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 30, "30 blocks")
        source.listen(False)
        eventually(lambda: source._zero_us is None, "the block in hand to be told")  # the block in hand is told by then
        assert source.blocks_skipped >= 90
        eventually(lambda: watch.health().blocks_lost == source.blocks_skipped, "the lost blocks to be counted")
        events = heard.events("only")
        assert len(events) == 1000 * len(heard.blocks), "what is told is whole"
        assert source.reports()[0].counts.events_given_up == 1000 * source.blocks_skipped


def test_for_nobody_its_time_stands_still():
    seen = {"only": Replayed(stream=Noise(), duration_us=10**9)}
    with cameras(seen) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 10, "10 blocks")
        source.listen(False)
        eventually(lambda: source._zero_us is None, "the block in hand to be told")
        blocks, seen_us = len(heard.blocks), library.opened[0].sent_us
        eventually(lambda: library.opened[0].sent_us >= seen_us + 500_000, "the camera to see for half a second")
        assert len(heard.blocks) == blocks
        source.listen(True)
        eventually(lambda: len(heard.blocks) >= blocks + 10, "10 blocks more")
        assert [t_us for t_us, _ in heard.blocks] == [BLOCK_US * (k + 1) for k in range(len(heard.blocks))]
        assert source.reports()[0].counts.events_given_up == 0 and source.blocks_skipped == 0


def test_a_long_session_is_followed_by_another():
    seen = {"only": Replayed(stream=Noise(), duration_us=10**9)}
    with cameras(seen, longest_us=50_000) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 12, "12 blocks")
        assert [t_us // BLOCK_US for t_us, _ in heard.blocks[:12]] == [1, 2, 3, 4, 5] * 2 + [1, 2]
        assert len(set(heard.sessions)) >= 3


def test_cameras_that_are_calibrated_while_they_run_begin_a_new_session_and_miss_nothing(recording):
    seen = {"only": Replayed(stream=Noise(), duration_us=10**9)}
    found = calibration_of(recording)["left"]
    with cameras(seen) as (source, library):
        heard = Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 3, "3 blocks")
        source.recalibrate({"only": found})
        eventually(lambda: len(heard.sessions) == 2, "the second session")
        count = len(heard.blocks)
        eventually(lambda: len(heard.blocks) >= count + 3, "3 blocks of the second session")
        np.testing.assert_allclose(source.welcome.calibrated()["only"].T_world_camera, found.T_world_camera)
        assert len(heard.sessions) == 2 and source.blocks_skipped == 0


def test_what_is_recorded_of_cameras_opens_again(recording, tmp_path):
    with cameras(of_recording(recording), calibration=calibration_of(recording)) as (source, library):
        recorder, heard = LiveRecorder(source, tmp_path / "live.h5"), Heard()
        source.add_listener(heard)
        library.begin()
        eventually(lambda: len(heard.blocks) >= 40, "40 blocks")
        duration_us = recorder.stop()
    assert duration_us >= 390_000
    with open_recording(tmp_path / "live.h5") as again:
        assert again.ball is None
        for name, stream in recording.cameras.items():
            found, known = again.cameras[name].slice(0, 380_000), stream.slice(BLOCK_US, 390_000)
            np.testing.assert_array_equal(found.t_us + BLOCK_US, known.t_us)
            np.testing.assert_array_equal(found.x_px, known.x_px)
            assert again.cameras[name].calibration is not None


def test_a_source_without_cameras_is_refused_in_words():
    with pytest.raises(DeviceError, match=r"no cameras.*one or more"):
        CameraSource({})
