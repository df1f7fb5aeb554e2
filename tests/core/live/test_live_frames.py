"""Frame cameras of a replayed recording: the file's pictures, times and flights, and bounded memory."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from core.chain import ChainConfig, RallyChain
from core.chain.chain import ChainState
from core.chain.control.player import PlayerState
from core.chain.follow import calibrated_rig, frame_cameras, windows_with_frames
from core.detection import Detection
from core.errors import LinkError, RecordingError
from core.events import CameraFrame, Events, SensorSize, Window
from core.history.record_live import LiveRecorder
from core.live.link import messages as m
from core.live.live_pictures import TRY_AGAIN, LiveFrameCameras, TimedLooks
from core.live.live_player import LivePlayer
from core.live.replay_source import ReplaySource
from core.live.ring_pictures import PictureRing
from core.live.ring_recording import LiveConfig, RingRecording
from core.recordings import PixelTruth, RecordingWriter, open_recording
from core.recordings.frames import FrameStream, frames_in_memory
from tests.waiting import PATIENCE_S, eventually

EVENT_CAMERAS: Final = ("near_left", "near_right")
FRAMES: Final = "far_left"
EXPOSURE_US: Final = 6_000
EVERY_US: Final = 8_333
"""No whole part of a window or a block."""
DURATION_US: Final = 600_000
BLOCKS: Final = 60


@pytest.fixture(scope="module")
def mixed(four_recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Events of two cameras, and pictures of a third one, the first of which was begun before time 0."""
    path = tmp_path_factory.mktemp("mixed") / "mixed.h5"
    t_us = np.arange(-1_000, DURATION_US - EXPOSURE_US, EVERY_US)
    images = np.random.default_rng(5).integers(0, 256, (len(t_us), 9, 16, 3), np.uint8)
    with open_recording(four_recording) as four:
        cameras = {name: four.cameras[name].calibration for name in (*EVENT_CAMERAS, FRAMES)}
        known = {name: camera for name, camera in cameras.items() if camera is not None}
        with RecordingWriter(path, {name: one.sensor for name, one in known.items()}, calibration=known) as writer:
            for name in EVENT_CAMERAS:
                writer.append(name, four.cameras[name].slice(0, DURATION_US))
            writer.write_frames(FRAMES, t_us, np.full(len(t_us), EXPOSURE_US), images)
            writer.extend_duration(DURATION_US)
    return path


@pytest.fixture
def seen(four_recording: Path) -> Callable[[], TrueInPictures]:
    """Makes the detector of the frame camera."""
    with open_recording(four_recording) as four:
        truth = four.cameras[FRAMES].truth
    assert truth is not None
    return lambda: TrueInPictures(truth)


class TrueInPictures:
    """The true ball in the middle of each exposure."""

    extra_circles = 0

    def __init__(self, truth: PixelTruth) -> None:
        self._truth = truth
        self.looked_us: list[int] = []

    def reset(self) -> None:
        self.looked_us.clear()

    def step(self, window: Window) -> Detection | None:
        assert window.frame is not None, "it is asked about pictures only"
        t_us, truth = window.frame.t_us, self._truth
        self.looked_us.append(t_us)
        row = int(np.argmin(np.abs(truth.t_us - t_us)))
        u, v, r = (float(column[row]) for column in (truth.u_px, truth.v_px, truth.r_px))
        return Detection(t_us, u, v, r) if truth.visible[row] else None


class NoBall:
    """Finds nothing."""

    extra_circles = 0

    def reset(self) -> None: ...
    def step(self, window: Window) -> None: ...


class Halting:
    """Hears so many blocks and their pictures, then the source goes no further; waits for a player after each."""

    def __init__(self, source: ReplaySource, blocks: int, player: LivePlayer | None = None) -> None:
        self._source, self._left, self._player = source, blocks, player
        self.pictures: list[m.PictureMessage] = []
        self.done = threading.Event()

    def on_session(self, welcome: m.Reply) -> None: ...
    def on_events(self, batch: m.EventBatch) -> None: ...
    def on_notice(self, notice: m.Notice) -> None: ...
    def on_picture(self, picture: m.PictureMessage) -> None:
        self.pictures.append(picture)

    def on_state(self, state: m.WorldState) -> None:
        player = self._player
        if player is not None:
            eventually(lambda: player.snapshot.t_us >= state.t_us, "the player to follow the block")
        self._left -= 1
        if not self._left:
            self._source.listen(False)
            self.done.set()


@contextmanager
def replaying(path: Path, **settings) -> Iterator[ReplaySource]:
    source = ReplaySource(open_recording(path), path.name, speed=20.0, **settings)
    source.listen(False)
    try:
        yield source
    finally:
        source.close()


def play(source: ReplaySource, halting: Halting, *listeners) -> None:
    for listener in (*listeners, halting):
        source.add_listener(listener)
    source.listen(True)
    assert halting.done.wait(PATIENCE_S), "the blocks did not come"


def assert_same_pictures(found: FrameStream, expected: FrameStream, later_us: int = 0, skip: int = 0) -> None:
    np.testing.assert_array_equal(found.t_us, expected.t_us[skip:] + later_us)
    np.testing.assert_array_equal(found.exposure_us, expected.exposure_us[skip:])
    for number in range(len(found)):
        np.testing.assert_array_equal(found.image(found.first + number), expected.image(skip + number))


def states_of(path: Path, detector: TrueInPictures) -> list[ChainState]:
    """What the chain says of a file."""
    with open_recording(path) as recording:
        chain = RallyChain(calibrated_rig(recording), ChainConfig(), {FRAMES: detector})
        return [
            chain.step(one)
            for one in windows_with_frames(recording.cameras, frame_cameras(recording), DURATION_US, 2000)
        ]


def assert_same_flight(found: list[ChainState], expected: list[ChainState]) -> None:
    assert len(found) == len(expected) == 300
    for one, known in zip(found, expected, strict=True):
        assert one.detections == known.detections and one.single == known.single and one.used == known.used
        assert one.t_us == known.t_us and (one.point is None) == (known.point is None)
        if one.point is not None and known.point is not None:
            np.testing.assert_array_equal(one.point.p_world_m, known.point.p_world_m)
            np.testing.assert_array_equal(one.point.covariance_m2, known.point.covariance_m2)


def test_the_ring_has_the_pictures_of_the_file_each_in_the_block_in_which_its_exposure_ends(mixed: Path) -> None:
    ring = RingRecording()
    with replaying(mixed) as source, open_recording(mixed) as file:
        halting = Halting(source, BLOCKS)
        play(source, halting, ring)
        assert source.description == "replay of mixed.h5"
        assert [info.name for info in source.welcome.frame_cameras] == [FRAMES]
        assert list(ring.cameras) == list(EVENT_CAMERAS), "it is no event camera"
        assert_same_pictures(ring.frames[FRAMES], file.frames[FRAMES])
        assert [picture.seq for picture in halting.pictures] == list(range(1, 1 + len(file.frames[FRAMES])))
        found, known = ring.frames[FRAMES].calibration, file.frames[FRAMES].calibration
        assert found is not None and known is not None and list(frame_cameras(ring)) == [FRAMES]
        np.testing.assert_array_equal(found.K, known.K)


def test_the_next_round_goes_on_without_the_picture_that_was_begun_before_the_file(mixed: Path) -> None:
    ring = RingRecording()
    with replaying(mixed) as source, open_recording(mixed) as file:
        play(source, Halting(source, 2 * BLOCKS), ring)
        count = len(file.frames[FRAMES])
        both = ring.frames[FRAMES]
        second = frames_in_memory([both.frame(number) for number in range(count, len(both))])
        assert_same_pictures(second, file.frames[FRAMES], DURATION_US, skip=1)


def test_a_listener_that_does_not_ask_for_pictures_gets_none_and_they_are_not_read(mixed: Path) -> None:
    with replaying(mixed) as source:

        class EventsOnly:
            blocks = 0

            def on_session(self, welcome: m.Reply) -> None: ...
            def on_events(self, batch: m.EventBatch) -> None: ...
            def on_notice(self, notice: m.Notice) -> None: ...
            def on_state(self, state: m.WorldState) -> None:
                self.blocks += 1

        only = EventsOnly()
        source.add_listener(only)
        source.listen(True)
        eventually(lambda: only.blocks > 3, "some blocks")
        source.listen(False)
        assert not source._listeners.want_pictures
        assert source._picture_numbers == 0


@pytest.mark.gate
def test_live_and_recorded_again_the_flight_is_that_of_the_file(
    mixed: Path, seen: Callable[[], TrueInPictures], tmp_path: Path
) -> None:
    expected = states_of(mixed, seen())
    assert sum(FRAMES in state.single for state in expected) > 20
    steps: list[PlayerState] = []
    with replaying(mixed, loop=False) as source:
        player = LivePlayer(source, frame_detector=seen)
        player.add_step_listener(lambda session, state, decision: steps.append(state))
        eventually(lambda: player.snapshot.session, "a session of the player")
        recorder = LiveRecorder(source, tmp_path / "again.h5", from_start=True)
        halting = Halting(source, BLOCKS, player)
        play(source, halting)
        health = player.meter
        assert health.pictures == len(halting.pictures) and health.pictures_skipped == 0
        player.close()
        recorder.stop()
    assert_same_flight([step.chain for step in steps], expected)
    with open_recording(tmp_path / "again.h5") as again, open_recording(mixed) as file:
        assert_same_pictures(again.frames[FRAMES], file.frames[FRAMES])
        assert not again.notes
    assert_same_flight(states_of(tmp_path / "again.h5", seen()), expected)


def test_a_player_that_is_behind_looks_at_no_pictures_and_counts_them(
    mixed: Path, seen: Callable[[], TrueInPictures]
) -> None:
    go_on, held = threading.Event(), threading.Event()
    with replaying(mixed) as source:
        player = LivePlayer(source, frame_detector=seen)

        def hold(session: str, state: PlayerState, decision: object) -> None:
            held.set()
            go_on.wait(PATIENCE_S)

        player.add_step_listener(hold)
        eventually(lambda: player.snapshot.session, "a session of the player")
        halting = Halting(source, BLOCKS)
        play(source, halting)
        assert held.wait(PATIENCE_S)
        go_on.set()
        eventually(lambda: player.snapshot.t_us == DURATION_US, "the last block to be played")
        meter = player.meter
        player.close()
    assert meter.pictures + meter.pictures_skipped == len(halting.pictures)
    assert meter.pictures_skipped > 40 and meter.blocks + meter.dropped == BLOCKS


def test_a_detector_that_is_too_slow_for_the_source_is_tried_again_after_some_pictures() -> None:
    frames = LiveFrameCameras(None)
    timed = frames._detectors[FRAMES] = TimedLooks(NoBall())

    def has_time(speed: float, *, tries: bool = True) -> bool:
        return frames.has_time([FRAMES], speed, tries=tries)

    assert has_time(20.0), "nothing is known of it yet"
    timed.took_s = 0.09
    assert not has_time(1.0) and has_time(0.25), "slower than real time there is time"
    tries = [has_time(1.0) for _ in range(2 * TRY_AGAIN)]
    assert np.flatnonzero(tries).tolist() == [TRY_AGAIN - 1, 2 * TRY_AGAIN - 1]
    assert not any(has_time(1.0, tries=False) for _ in range(2 * TRY_AGAIN)), "a robot is not to wait for a try"
    timed.took_s = 0.01
    assert has_time(1.0, tries=False)


def frame(t_us: int, value: int = 0) -> CameraFrame:
    return CameraFrame(t_us, 1000, np.full((10, 10), value, np.uint8))


def test_the_oldest_pictures_are_forgotten_beyond_a_number_of_bytes_and_numbers_stay() -> None:
    ring = PictureRing(None, most_bytes=350)
    before = ring.stream()
    assert len(before) == 0 and before.newest(10_000) == -1
    for number in range(5):
        ring.add(frame(1000 * number, number))
    stream = ring.stream()
    assert stream.first == 2 and stream.t_us.tolist() == [2000, 3000, 4000]
    assert stream.newest(3_600) == 3 and stream.image(3)[0, 0] == 3 and stream.frame(4).t_us == 4000
    assert stream.newest(2_000) == -1, "the one that was over is forgotten"
    ring.forget_before(2_500)
    assert ring.stream().first == 3
    with pytest.raises(RecordingError, match="no longer in memory"):
        stream.image(2)
    with pytest.raises(LinkError, match="run backwards"):
        ring.add(frame(3_999))


def test_the_ring_forgets_pictures_with_the_events_of_their_time(mixed: Path) -> None:
    ring = RingRecording(LiveConfig(seconds=1.0))
    with replaying(mixed) as source:
        play(source, Halting(source, 3 * BLOCKS), ring)
        stream = ring.frames[FRAMES]
        assert ring.start_us < stream.ends_us[0] <= ring.start_us + 2 * EVERY_US
        assert stream.ends_us[-1] > ring.duration_us - 2 * EVERY_US


def test_pictures_of_an_event_cameras_lens_are_told_and_recorded_and_not_followed(tmp_path: Path, mixed: Path) -> None:
    with open_recording(mixed) as file:
        camera = file.cameras[EVENT_CAMERAS[0]].calibration
    assert camera is not None
    with RecordingWriter(tmp_path / "own.h5", {"a": camera.sensor}, calibration={"a": camera}) as writer:
        writer.append("a", Events.from_columns([1000], [3], [2], [True], camera.sensor))
        writer.write_frames("a", np.array([5_000]), np.full(1, 4_000), np.full((1, 48, 64), 120, np.uint8))
        writer.extend_duration(20_000)
    with replaying(tmp_path / "own.h5", loop=False) as source:
        recorder = LiveRecorder(source, tmp_path / "again.h5", from_start=True)
        play(source, Halting(source, 2))
        recorder.stop()
        assert source.welcome.calibrated_frame_cameras() == {}
    with open_recording(tmp_path / "own.h5") as own, open_recording(tmp_path / "again.h5") as again:
        assert_same_pictures(again.frames["a"], own.frames["a"])
        assert again.cameras["a"].event_count == 1


def test_pictures_of_another_size_do_not_spoil_a_recording(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "sizes.h5", {"rgb": SensorSize(16, 9)}) as writer:
        writer.write_frame("rgb", frame(1_000, 5), 0)
        with pytest.raises(RecordingError, match="pictures of another size"):
            writer.write_frame("rgb", CameraFrame(2_000, 1_000, np.zeros((9, 16), np.uint8)), 0)
    with open_recording(tmp_path / "sizes.h5") as found:
        assert found.frames["rgb"].image(0).shape == (10, 10)


def test_pictures_for_which_the_disk_is_too_slow_are_left_out_and_a_note_says_so(
    mixed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("core.history.record_live.WAITING_BYTES", -1)
    with replaying(mixed, loop=False) as source:
        recorder = LiveRecorder(source, tmp_path / "again.h5", from_start=True)
        halting = Halting(source, BLOCKS)
        play(source, halting)
        recorder.stop()
    with open_recording(tmp_path / "again.h5") as again:
        assert again.notes == (
            f"{len(halting.pictures)} pictures of frame cameras left out: they came faster than they could be written.",
        )
        assert again.cameras[EVENT_CAMERAS[0]].event_count > 1000
        assert list(again.cameras) == list(EVENT_CAMERAS), "one without pictures is no event camera"
        assert len(again.frames[FRAMES]) == 0 and frame_cameras(again) == {}
