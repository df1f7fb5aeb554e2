"""The live recording offers what was sent, forgets what is old, and begins anew with a session."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.errors import LinkError
from core.events import SensorSize
from core.live.link import messages as m
from core.live.ring_recording import LiveConfig, RingRecording
from tests.waiting import PATIENCE_S

SENSOR = SensorSize(64, 48)
BLOCK_US = 10_000


def welcome(session: str = "one") -> m.Reply:
    cameras = tuple(m.CameraInfo.of(name, camera) for name, camera in stereo_preset("side", SENSOR).items())
    return m.Reply(id=1, ok=True, session=session, t_us=0, block_us=BLOCK_US, seed=0, cameras=cameras)


def send(live: RingRecording, block: int, rng: np.random.Generator, count: int = 200, session: str = "one"):
    start_us = block * BLOCK_US
    since = np.sort(rng.integers(0, BLOCK_US, count)).astype(np.uint32)
    x, y = rng.integers(0, 64, count).astype(np.uint16), rng.integers(0, 48, count).astype(np.uint16)
    for name in ("left", "right"):
        live.on_events(
            m.EventBatch(
                session=session,
                seq=1,
                wall_ns=0,
                camera=name,
                start_us=start_us,
                end_us=start_us + BLOCK_US,
                width_px=64,
                height_px=48,
                since_us=since,
                x_px=x,
                y_px=y,
                on=(x % 2).astype(np.uint8),
                truth_t_us=np.array([start_us]),
                circle=np.array([[1.0, 2.0, 3.0]]),
            )
        )
    live.on_state(state(start_us, session))
    return since.astype(np.int64) + start_us, x, y


def state(start_us: int, session: str = "one") -> m.WorldState:
    return m.WorldState(
        session=session,
        seq=1,
        wall_ns=0,
        start_us=start_us,
        t_us=start_us + BLOCK_US,
        phase="serve",
        paused=False,
        speed_factor=1.0,
        noise_hz=0.1,
        auto_serve_mps=0.0,
        real_time_factor=1.0,
        served=0,
        returned=0,
        ball_t_us=np.array([start_us]),
        ball=np.full((1, 9), 0.5),
        ball_visible=np.ones(1, np.uint8),
        racket_t_us=np.array([start_us]),
        racket=np.ones((1, 10)),
    )


@pytest.fixture
def live() -> RingRecording:
    live = RingRecording(LiveConfig(seconds=1.0, events_per_camera=100_000))
    live.on_session(welcome())
    return live


def test_slices_anywhere_hold_exactly_what_was_sent(live):
    rng = np.random.default_rng(0)
    sent = [send(live, block, rng) for block in range(50)]
    t, x, y = (np.concatenate(column) for column in zip(*sent, strict=True))
    camera = live.cameras["left"]
    assert live.duration_us == 500_000 and camera.event_count == len(t)
    for start, end in [(0, 500_000), (-5, 10**9), (10_000, 20_000), *rng.integers(0, 500_000, (30, 2)).tolist()]:
        found, inside = camera.slice(start, end), (t >= start) & (t < end)
        np.testing.assert_array_equal(found.t_us, t[inside])
        np.testing.assert_array_equal(found.x_px, x[inside])
        np.testing.assert_array_equal(found.y_px, y[inside])
        np.testing.assert_array_equal(found.on, x[inside] % 2 == 1)
    np.testing.assert_array_equal(camera.counts_per_ms(), np.bincount(t // 1000, minlength=500))
    assert live.ball is not None and live.ball.t_us.tolist() == [k * BLOCK_US for k in range(50)]
    assert camera.truth is not None and len(camera.truth.t_us) == 50


def test_a_block_is_seen_only_once_it_is_complete(live):
    send(live, 0, np.random.default_rng(0))
    before = live.cameras["left"].slice(0, 10**6)
    batch = m.EventBatch(
        session="one",
        seq=1,
        wall_ns=0,
        camera="left",
        start_us=10_000,
        end_us=20_000,
        width_px=64,
        height_px=48,
        since_us=np.zeros(1, np.uint32),
        x_px=np.ones(1, np.uint16),
        y_px=np.ones(1, np.uint16),
        on=np.ones(1, np.uint8),
        truth_t_us=np.empty(0, np.int64),
        circle=np.empty((0, 3)),
    )
    live.on_events(batch)
    assert len(live.cameras["left"].slice(0, 10**6)) == len(before)
    live.on_state(state(10_000))
    assert len(live.cameras["left"].slice(0, 10**6)) == len(before) + 1


def test_a_robot_that_does_not_know_where_the_ball_is_fills_the_ring_all_the_same(live):
    send(live, 0, np.random.default_rng(0))
    empty = {"ball_t_us": np.empty(0, np.int64), "ball": np.empty((0, 9)), "ball_visible": np.empty(0, np.uint8)}
    live.on_state(replace(state(10_000), **empty))
    assert live.duration_us == 20_000 and live.ball is not None and live.ball.t_us.tolist() == [0]
    live.on_state(replace(state(50_000), **empty, t_us=50_000))
    assert live.duration_us == 20_000, "a sign of life"


def test_what_is_older_than_the_ring_is_forgotten_and_the_rest_stays(live):
    rng = np.random.default_rng(1)
    sent = [send(live, block, rng, 20) for block in range(250)]
    camera = live.cameras["right"]
    assert live.start_us == 1_500_000 and live.duration_us == 2_500_000
    assert camera.event_count == 100 * 20
    np.testing.assert_array_equal(camera.slice(0, 10**9).t_us, np.concatenate([t for t, _, _ in sent[150:]]))
    assert len(camera.slice(0, 1_500_000)) == 0
    assert len(camera.counts_per_ms()) == 2500


def test_memory_is_bounded_by_events_too(live):
    rng = np.random.default_rng(1)
    for block in range(30):
        send(live, block, rng, 10_000)
    assert live.cameras["left"].event_count == 100_000


def test_a_connection_in_the_middle_of_a_session_starts_where_it_came(live):
    send(live, 1_000_000, np.random.default_rng(1))
    assert live.start_us == 10**10 and live.duration_us == 10**10 + BLOCK_US
    assert len(live.cameras["left"].slice(0, 10**11)) == 200


def test_a_new_session_is_a_new_recording_and_old_streams_are_empty(live):
    send(live, 3, np.random.default_rng(1))
    old, uuid = live.cameras["left"], live.uuid
    live.on_session(welcome("two"))
    assert live.uuid != uuid and live.duration_us == 0
    send(live, 0, np.random.default_rng(2), session="two")
    assert len(old.slice(0, 10**6)) == 0 and old.event_count == 0
    assert live.cameras["left"].event_count == 200


def test_events_of_an_unknown_camera_are_refused(live):
    batch = m.EventBatch(
        session="one",
        seq=1,
        wall_ns=0,
        camera="nose",
        start_us=0,
        end_us=10_000,
        width_px=64,
        height_px=48,
        since_us=np.empty(0, np.uint32),
        x_px=np.empty(0, np.uint16),
        y_px=np.empty(0, np.uint16),
        on=np.empty(0, np.uint8),
        truth_t_us=np.empty(0, np.int64),
        circle=np.empty((0, 3)),
    )
    with pytest.raises(LinkError, match="nose"):
        live.on_events(batch)


def test_before_a_session_every_block_is_refused_in_words_and_nothing_is_there():
    fresh = RingRecording()
    assert (fresh.duration_us, fresh.start_us, fresh.cameras, fresh.ball) == (0, 0, {}, None)
    with pytest.raises(LinkError, match="not a block of this session"):
        send(fresh, 0, np.random.default_rng(0))


def test_readers_in_other_threads_see_whole_blocks_only(live):
    wrong: list[int] = []
    done = threading.Event()

    def read() -> None:
        while not done.is_set():
            found = len(live.cameras["left"].slice(0, 10**9))
            if found % 100:
                wrong.append(found)

    threads = [threading.Thread(target=read) for _ in range(3)]
    for thread in threads:
        thread.start()
    rng = np.random.default_rng(4)
    for block in range(300):
        send(live, block, rng, 100)
    done.set()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert not wrong
