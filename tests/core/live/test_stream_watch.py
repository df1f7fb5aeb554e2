"""What is missing of a live source is counted from its blocks alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.events import SensorSize
from core.live.link import messages as m
from core.live.stream_watch import StreamWatch

SENSOR = SensorSize(64, 48)
BLOCK_US = 10_000


class Wall:
    """A clock that is moved by hand."""

    s = 100.0

    def __call__(self) -> float:
        return self.s


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def watch(wall) -> StreamWatch:
    watch = StreamWatch(wall)
    cameras = tuple(m.CameraInfo.uncalibrated(name, SENSOR) for name in ("left", "right"))
    watch.on_session(m.Reply(id=0, ok=True, session="one", t_us=0, block_us=BLOCK_US, cameras=cameras))
    return watch


def send(watch: StreamWatch, block: int, **counts: int) -> None:
    """A block with packets of so many events of the cameras that are named."""
    start_us, none = block * BLOCK_US, np.empty(0, np.int64)
    for name, count in counts.items():
        zeros = np.zeros(count)
        watch.on_events(
            m.EventBatch(
                session="one", seq=1, wall_ns=0, camera=name, start_us=start_us, end_us=start_us + BLOCK_US,
                width_px=64, height_px=48, since_us=zeros.astype(np.uint32), x_px=zeros.astype(np.uint16),
                y_px=zeros.astype(np.uint16), on=zeros.astype(np.uint8), truth_t_us=none, circle=np.empty((0, 3)),
            )
        )  # fmt: skip
    watch.on_state(ending(start_us, start_us + BLOCK_US))


def ending(start_us: int, t_us: int) -> m.WorldState:
    none = np.empty(0, np.int64)
    return m.WorldState(
        session="one", seq=1, wall_ns=0, start_us=start_us, t_us=t_us, phase="idle", paused=False, speed_factor=1.0,
        noise_hz=0.0, auto_serve_mps=0.0, real_time_factor=1.0, served=0, returned=0, ball_t_us=none,
        ball=np.empty((0, 9)), ball_visible=np.empty(0, np.uint8), racket_t_us=none, racket=np.empty((0, 10)),
    )  # fmt: skip


def test_a_source_that_is_complete_has_nothing_to_say(watch):
    for block in range(200):
        send(watch, block, left=3, right=1)
    health = watch.health()
    assert health.blocks_lost == 0 and not health.stopped
    assert [(one.blocks_missing, one.lost, one.silent) for one in health.cameras] == [(0, False, False)] * 2


def test_a_camera_without_packets_is_missing_then_lost_and_comes_back(watch):
    send(watch, 0, left=1, right=1)
    for block in range(1, 50):
        send(watch, block, left=1)
    left, right = watch.health().cameras
    assert (right.blocks_missing, right.absent_us, right.lost) == (49, 490_000, False)
    send(watch, 50, left=1)
    left, right = watch.health().cameras
    assert right.lost and not right.silent and left.blocks_missing == 0 and not left.lost
    send(watch, 51, left=1, right=1)
    assert not watch.health().cameras[1].lost and watch.health().cameras[1].blocks_missing == 50


def test_a_camera_whose_packets_are_empty_is_silent_and_not_lost(watch):
    send(watch, 0, left=1, right=1)
    for block in range(1, 101):
        send(watch, block, left=1, right=0)
    left, right = watch.health().cameras
    assert right.silent and not right.lost and right.blocks_missing == 0 and not left.silent


def test_blocks_that_never_come_are_counted_and_a_sign_of_life_is_no_block(watch):
    send(watch, 10, left=1, right=1)
    watch.on_state(ending(110_000, 110_000))
    assert watch.health().blocks_lost == 0
    send(watch, 14, left=1, right=1)
    assert watch.health().blocks_lost == 3


def test_the_pace_is_that_of_the_last_two_seconds(watch, wall):
    assert watch.health().pace is None
    for block in range(1000):
        wall.s += 0.02 if block < 500 else 0.01
        send(watch, block, left=1, right=1)
    assert watch.health().pace == pytest.approx(1.0)


def test_a_source_that_says_nothing_has_stopped_unless_nobody_listened(watch, wall):
    send(watch, 0, left=1, right=1)
    wall.s += 3.0
    assert watch.health().stopped and watch.health().quiet_s == 3.0
    watch.wake()
    assert not watch.health().stopped
    wall.s += 1.5
    assert watch.health().stopped
    watch.on_state(ending(10_000, 10_000))
    assert not watch.health().stopped, "a simulation whose clock stands still"


def test_what_is_sent_while_nobody_listens_is_neither_lost_nor_silent_nor_stopped(watch, wall):
    send(watch, 0, left=1, right=1)
    watch.rest()
    wall.s += 60.0
    assert not watch.health().stopped and watch.health().quiet_s == 0.0
    watch.wake()
    send(watch, 6000, left=1, right=0)
    health = watch.health()
    assert health.blocks_lost == 0 and not health.stopped
    assert [(one.blocks_missing, one.lost, one.silent) for one in health.cameras] == [(0, False, False)] * 2
    send(watch, 6003, left=1, right=1)
    assert watch.health().blocks_lost == 2


def test_a_source_that_is_asked_to_be_slow_is_waited_for(watch, wall):
    watch.on_state(replace(ending(0, BLOCK_US), speed_factor=0.01))
    wall.s += 2.5
    assert not watch.health().stopped
    wall.s += 1.0
    assert watch.health().stopped
