"""A replayed recording is a live source: the same events, at the pace that was asked for, again and again."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.chain import ChainConfig, RallyChain
from core.chain.control.player import PlayerState
from core.detection import make_detector
from core.detection.window import windows_between, windows_side_by_side
from core.errors import ConfigError, RecordingError
from core.events import Events, SensorSize
from core.history.record_live import LiveRecorder
from core.live.link import messages as m
from core.live.live_player import LivePlayer
from core.live.replay_source import ReplaySource
from core.live.ring_recording import RingRecording
from core.live.stream_watch import StreamWatch
from core.physics.config import physics_profile
from core.recordings import RecordingWriter, open_recording
from tests.waiting import PATIENCE_S, eventually

SENSOR = SensorSize(64, 48)
BLOCK_US = 10_000
DURATION_US = 123_456
LOOP_US = 130_000
TICK_S = 0.002


class TickingClock:
    """A clock that is TICK_S later at each look, so that waiting for it takes some looks and no certain time."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        self.now_s += TICK_S
        return self.now_s


class Halting:
    """Hears blocks until it has some number of them; then the source goes no further."""

    def __init__(self, source: ReplaySource, blocks: int) -> None:
        self._source, self._left = source, blocks
        self.sessions: list[str] = []
        self.blocks: list[tuple[int, list[str]]] = []
        self._names: list[str] = []
        self.done = threading.Event()

    def on_session(self, welcome: m.Reply) -> None:
        self.sessions.append(welcome.session)

    def on_events(self, batch: m.EventBatch) -> None:
        self._names.append(batch.camera)

    def on_state(self, state: m.WorldState) -> None:
        self.blocks.append((state.t_us, self._names))
        self._names = []
        self._left -= 1
        if not self._left:
            self._source.listen(False)
            self.done.set()

    def on_notice(self, notice: m.Notice) -> None:
        raise AssertionError("a recording has no notices")


class Damaged:
    """A stream that cannot be read in some stretch."""

    def __init__(self, stream, start_us: int, end_us: int) -> None:
        self._stream, self._span_us = stream, (start_us, end_us)

    def __getattr__(self, name: str):
        return getattr(self._stream, name)

    def slice(self, start_us: int, end_us: int) -> Events:
        if self._span_us[0] <= start_us < self._span_us[1]:
            raise RecordingError("a damaged block")
        return self._stream.slice(start_us, end_us)


def draw(seed: int, count: int = 3000) -> Events:
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.integers(0, DURATION_US, count))
    columns = rng.integers(0, 64, count), rng.integers(0, 48, count), rng.random(count) < 0.5
    return Events.from_columns(t_us, *columns, SENSOR)


@pytest.fixture
def pair(tmp_path):
    """Two small calibrated cameras of which each saw something else, with a true ball."""
    cameras = stereo_preset("side", SENSOR)
    path = tmp_path / "pair.h5"
    with RecordingWriter(path, dict.fromkeys(cameras, SENSOR), calibration=cameras) as writer:
        for seed, name in enumerate(cameras):
            writer.append(name, draw(seed))
        writer.extend_duration(DURATION_US)
    with open_recording(path) as recording:
        yield recording


@contextmanager
def replaying(recording, **settings) -> Iterator[ReplaySource]:
    source = ReplaySource(recording, "pair.h5", **settings)
    try:
        yield source
    finally:
        source.close()


def play(source: ReplaySource, blocks: int, *listeners) -> Halting:
    """Let the listeners hear exactly so many blocks."""
    source.listen(False)
    halting = Halting(source, blocks)
    for listener in (*listeners, halting):
        source.add_listener(listener)
    source.listen(True)
    assert halting.done.wait(PATIENCE_S), "the blocks did not come"
    return halting


def assert_same(found: Events, expected: Events, later_us: int = 0) -> None:
    np.testing.assert_array_equal(found.t_us, expected.t_us + later_us)
    for name in ("x_px", "y_px", "on"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_the_ring_has_exactly_the_files_events_and_the_next_round_runs_on_in_whole_blocks(pair):
    with replaying(pair, speed=10.0) as source:
        ring = RingRecording()
        halting = play(source, 30, ring)
        assert [t_us for t_us, _ in halting.blocks] == [BLOCK_US * (k + 1) for k in range(30)]
        assert ring.duration_us == 300_000 and len(halting.sessions) == 1
        for name, stream in pair.cameras.items():
            live = ring.cameras[name]
            whole = stream.slice(0, DURATION_US)
            assert len(whole) == 3000
            assert_same(live.slice(0, LOOP_US), whole)
            assert_same(live.slice(LOOP_US, 2 * LOOP_US), whole, LOOP_US)
            assert_same(live.slice(2 * LOOP_US, 300_000), whole.between(0, 40_000), 2 * LOOP_US)
            np.testing.assert_array_equal(live.calibration.T_world_camera, stream.calibration.T_world_camera)


def test_there_is_no_truth_no_robot_and_no_word_of_outcomes(pair):
    with replaying(pair, speed=10.0) as source:
        ring = RingRecording()
        play(source, 3, ring)
        assert ring.ball is None and all(camera.truth is None for camera in ring.cameras.values())
        assert source.robot is None and not source.has_outcomes and source.physics is None
        assert source.state.scene == "" and not len(source.state.racket_t_us)
        assert source.status == "connected" and source.description == "replay of pair.h5"


@pytest.mark.parametrize("speed", [2.0, 0.5])
def test_a_block_comes_at_its_time_and_never_before_it(pair, speed):
    clock = TickingClock()
    with replaying(pair, speed=speed, clock=clock) as source:
        came_s: list[float] = []

        class Stamps(Halting):
            def on_state(self, state: m.WorldState) -> None:
                came_s.append(clock.now_s)
                super().on_state(state)

        stamps = Stamps(source, 40)
        eventually(lambda: clock.now_s > 1000.0, "the replay to rest")  # until it has a listener it looks no more
        began_s = clock.now_s
        source.add_listener(stamps)
        assert stamps.done.wait(PATIENCE_S)
        due_s = (np.arange(40) + 1) * BLOCK_US * 1e-6 / speed
        late_s = np.array(came_s) - began_s - due_s
        assert late_s.min() > -1e-9 and late_s.max() < 3 * TICK_S
        eventually(lambda: source.state, "the state of the last block")
        assert abs(source.state.speed_factor - speed) < 1e-9


def test_what_falls_behind_is_counted_and_nothing_is_left_out(pair):
    clock = TickingClock()

    class Slow(Halting):
        def on_state(self, state: m.WorldState) -> None:
            clock.now_s += 0.15 if state.t_us in (50_000, 100_000) else 0.0
            super().on_state(state)

    with replaying(pair, speed=1.0, clock=clock) as source:
        slow, ring = Slow(source, 20), RingRecording()
        source.add_listener(ring)
        source.add_listener(slow)
        assert slow.done.wait(PATIENCE_S)
        assert [t_us for t_us, _ in slow.blocks] == [BLOCK_US * (k + 1) for k in range(20)]
        assert source.behind_s == pytest.approx(0.3, abs=0.02)
        assert len(ring.cameras["left"].slice(0, LOOP_US)) == 3000


def test_for_nobody_it_stands_still_and_goes_on_where_it_stopped(pair):
    clock = TickingClock()
    with replaying(pair, speed=5.0, clock=clock) as source:
        clock.now_s += 10.0
        assert source.state is None, "nobody has listened yet"
        first = play(source, 4)
        assert first.blocks[0][0] == 10_000
        eventually(lambda: source.state is not None and source.state.t_us == 40_000, "the state of the last block")
        clock.now_s += 10.0
        source.remove_listener(first)
        assert play(source, 2).blocks[0][0] == 50_000
        assert source.behind_s == 0.0, "resting is not falling behind"


def test_a_camera_that_cannot_be_read_is_missing_and_the_other_goes_on(pair):
    cameras = dict(pair.cameras)
    pair_with_damage = type(
        "Pair",
        (),
        {
            "duration_us": pair.duration_us,
            "cameras": cameras | {"right": Damaged(cameras["right"], 50_000, 10**9)},
            "close": lambda self: None,
        },
    )()
    with replaying(pair_with_damage, speed=10.0) as source:
        ring, watch = RingRecording(), StreamWatch()
        halting = play(source, 13, ring, watch)
        assert [len(names) for _, names in halting.blocks] == [2] * 5 + [1] * 8
        assert_same(ring.cameras["left"].slice(0, LOOP_US), pair.cameras["left"].slice(0, DURATION_US))
        assert_same(ring.cameras["right"].slice(0, LOOP_US), pair.cameras["right"].slice(0, 50_000))
        left, right = watch.health().cameras
        assert (left.blocks_missing, right.blocks_missing) == (0, 8) and right.absent_us == 80_000


def test_one_camera_without_calibration_is_replayed_and_nothing_is_made_up(tmp_path):
    path = tmp_path / "mono.h5"
    with RecordingWriter(path, {"only": SENSOR}) as writer:
        writer.append("only", draw(3))
    with replaying(open_recording(path), speed=10.0) as source:
        ring = RingRecording()
        play(source, 13, ring)
        (camera,) = ring.cameras.values()
        assert camera.calibration is None and camera.sensor == SENSOR and camera.event_count == 3000
        source.listen(False)
        player = LivePlayer(source)
        eventually(lambda: player.snapshot.session, "a session of the player")
        assert "two" in player.snapshot.problem and not player.playing
        player.close()


@pytest.mark.parametrize("profile", ["paper", "real"])
def test_the_controller_takes_the_rubber_of_the_physics_that_is_given(pair, profile):
    with replaying(pair, physics=physics_profile(profile)) as source:
        source.listen(False)
        player = LivePlayer(source)
        assert player.controller.task.physics.rubber == physics_profile(profile).rubber
        assert player.controller.task.physics.air != physics_profile(profile).air, "learned"
        player.close()


def test_after_the_longest_session_another_one_begins_at_zero(pair):
    with replaying(pair, speed=20.0, longest_us=40_000) as source:
        halting = play(source, 10)
        assert [t_us // BLOCK_US for t_us, _ in halting.blocks] == [1, 2, 3, 4, 1, 2, 3, 4, 1, 2]
        assert len(set(halting.sessions)) == 3


@pytest.mark.parametrize("speed", [0.0, -1.0, 21.0, 1e-9, float("nan"), float("inf")])
def test_a_speed_that_makes_no_sense_is_refused_in_words(pair, speed):
    with pytest.raises(ConfigError, match=r"no such speed of a replay.*0\.01 to 20"):
        ReplaySource(pair, "pair.h5", speed=speed)


def test_an_empty_recording_is_refused_in_words(tmp_path):
    with RecordingWriter(tmp_path / "empty.h5", {"only": SENSOR}):
        pass
    with open_recording(tmp_path / "empty.h5") as empty, pytest.raises(RecordingError, match="empty recording"):
        ReplaySource(empty, "empty.h5")


def test_what_is_recorded_of_it_opens_again_over_the_seam_with_no_truth(pair, tmp_path):
    with replaying(pair, speed=10.0) as source:
        source.listen(False)
        recorder = LiveRecorder(source, tmp_path / "again.h5")
        play(source, 30)
        duration_us = recorder.stop()
        assert duration_us == 290_000, "all but the block that it began in"
        with open_recording(tmp_path / "again.h5") as again:
            assert again.ball is None and again.seed is None
            for name, stream in pair.cameras.items():
                first = stream.slice(BLOCK_US, DURATION_US)
                assert_same(again.cameras[name].slice(0, LOOP_US - BLOCK_US), first, -BLOCK_US)
                second = again.cameras[name].slice(LOOP_US - BLOCK_US, 2 * LOOP_US - BLOCK_US)
                assert_same(second, stream.slice(0, DURATION_US), LOOP_US - BLOCK_US)
                assert again.cameras[name].truth is None and again.cameras[name].calibration is not None


@pytest.mark.parametrize("method", ["paper", "refined"])
def test_detections_on_the_replayed_ring_are_those_of_the_file(serve_recording, method):
    with open_recording(serve_recording) as recording:
        ring = RingRecording()
        with replaying(open_recording(serve_recording), speed=20.0) as source:
            play(source, 60, ring)
        found = {}
        for kind, streams in {"file": recording.cameras, "live": ring.cameras}.items():
            for name, stream in streams.items():
                detector = make_detector(method, stream.sensor, ChainConfig.of_method(method).detector)
                found[kind, name] = [detector.step(one) for one in windows_between(stream, 0, 600_000, 2000)]
        for name in recording.cameras:
            assert sum(one is not None for one in found["file", name]) > 100
            assert found["live", name] == found["file", name]


class Patient(Halting):
    """Holds the source up until a player has followed the block."""

    def __init__(self, source: ReplaySource, blocks: int, player: LivePlayer) -> None:
        super().__init__(source, blocks)
        self._player = player

    def on_state(self, state: m.WorldState) -> None:
        eventually(lambda: self._player.snapshot.t_us >= state.t_us, "the player to follow the block")
        super().on_state(state)


def test_every_block_that_the_player_cannot_follow_is_counted_once(serve_recording):
    with replaying(open_recording(serve_recording), speed=20.0) as source:
        source.listen(False)
        player = LivePlayer(source)
        go_on, held = threading.Event(), threading.Event()

        def hold(session: str, state: PlayerState, decision: object) -> None:
            held.set()
            go_on.wait(PATIENCE_S)

        player.add_step_listener(hold)
        eventually(lambda: player.snapshot.session, "a session of the player")
        play(source, 60)
        assert held.wait(PATIENCE_S)
        go_on.set()
        eventually(lambda: player.snapshot.t_us == 600_000, "the last block to be played")
        meter = player._meter  # what `health` shows ten times a second
        player.close()
    assert meter.dropped > 40 and meter.blocks + meter.dropped == 60


@pytest.mark.gate
@pytest.mark.parametrize(("name", "most_cameras"), [("serve_recording", 2), ("four_recording", 4)])
def test_the_live_chain_sees_what_the_chain_sees_in_the_file(request, name, most_cameras):
    path = request.getfixturevalue(name)
    with open_recording(path) as recording:
        cameras = {name: stream.calibration for name, stream in recording.cameras.items()}
        chain = RallyChain(cameras, ChainConfig())
        offline = [chain.step(one) for one in windows_side_by_side(recording.cameras, 0, 600_000, 2000)]
    steps: list[PlayerState] = []
    with replaying(open_recording(path), speed=20.0) as source:
        source.listen(False)
        player = LivePlayer(source)
        player.add_step_listener(lambda session, state, decision: steps.append(state))
        eventually(lambda: player.snapshot.session, "a session of the player")
        patient = Patient(source, 60, player)
        source.add_listener(patient)
        source.listen(True)
        assert patient.done.wait(PATIENCE_S), "the blocks did not come"
        assert player._meter.dropped == 0 and not player.playing
        player.close()
    assert len(steps) == len(offline) == 300
    assert sum(state.point is not None for state in offline) > 100
    assert max(len(state.used) for state in offline) == most_cameras
    for live, known in zip([step.chain for step in steps], offline, strict=True):
        assert live.t_us == known.t_us and live.detections == known.detections and live.verdict == known.verdict
        assert live.used == known.used
        assert (live.point is None) == (known.point is None)
        if live.point is not None:
            np.testing.assert_array_equal(live.point.p_world_m, known.point.p_world_m)


def test_cameras_that_are_calibrated_while_it_runs_begin_a_new_session(pair):
    with replaying(pair, speed=20.0) as source:
        play(source, 3)
        before, found = source.welcome, stereo_preset("behind", SENSOR)
        source.recalibrate({"left": found["left"]})
        halting = play(source, 2)
        known = source.welcome.calibrated()
        assert halting.sessions == [before.session, source.welcome.session] and before.session != source.welcome.session
        assert [t_us for t_us, _ in halting.blocks] == [10_000, 20_000]
        np.testing.assert_allclose(known["left"].T_world_camera, found["left"].T_world_camera)
        np.testing.assert_allclose(known["right"].T_world_camera, before.calibrated()["right"].T_world_camera)
