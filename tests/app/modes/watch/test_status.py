"""What the figures say of the live rally's health."""

from types import SimpleNamespace

import numpy as np
import pytest

from app.modes.watch.status import live_html
from core.rally.link.messages import WorldState


def state(**more) -> WorldState:
    times = np.empty(0, np.int64)
    return WorldState(
        session="s", seq=1, wall_ns=1, start_us=0, t_us=10_000, phase="idle", paused=False, speed_factor=1.0,
        noise_hz=0.1, auto_serve_mps=0.0, real_time_factor=1.2, served=0, returned=0, ball_t_us=times,
        ball=np.empty((0, 9)), ball_visible=np.empty(0, np.uint8), racket_t_us=times, racket=np.empty((0, 10)), **more,
    )  # fmt: skip


@pytest.fixture
def snapshot() -> SimpleNamespace:
    span = SimpleNamespace(p50_ms=0.2, p99_ms=1.0)
    health = SimpleNamespace(state_hz=400.0, step=span, window_to_sent=span, blocks_dropped=0)
    return SimpleNamespace(health=health, controller="built-in", problem="")


def test_a_readout_in_time_is_not_spoken_of(snapshot) -> None:
    assert "Readout" not in live_html(snapshot, state(), "connected")


def test_late_and_lost_events_are_said(snapshot) -> None:
    late = live_html(snapshot, state(readout_delayed=1200, readout_longest_us=70), "connected")
    assert "1,200 late, up to 70 us" in late and "lost" not in late
    lost = live_html(snapshot, state(readout_delayed=5, readout_dropped=34_000), "connected")
    assert "34,000 events lost" in lost


def test_a_lost_simulation_and_a_slow_one_are_bad(snapshot) -> None:
    good = live_html(snapshot, state(), "connected")
    assert live_html(snapshot, state(), "lost") != good and "lost, " in live_html(snapshot, state(), "lost")
