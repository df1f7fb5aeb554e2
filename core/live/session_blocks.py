"""Welcome and state messages of sources without a robot and without truth."""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping

import numpy as np

from core.cameras import Camera
from core.events import SensorSize
from core.live.link import messages as m
from core.simulation.event_cameras.event_camera import BLOCK_US


def welcome_to(cameras: Mapping[str, tuple[SensorSize, Camera | None]]) -> m.Reply:
    """A new session of cameras, with their calibration where it is known."""
    infos = tuple(
        m.CameraInfo.uncalibrated(name, sensor) if known is None else m.CameraInfo.of(name, known)
        for name, (sensor, known) in cameras.items()
    )
    return m.Reply(id=0, ok=True, session=uuid.uuid4().hex, t_us=0, block_us=BLOCK_US, cameras=infos)


def state_of_block(session: str, seq: int, span_us: tuple[int, int], speed: float) -> m.WorldState:
    """The state that ends a block: its times, and nothing of ball or racket."""
    none = np.empty(0, np.int64)
    return m.WorldState(
        session=session, seq=seq, wall_ns=time.time_ns(), start_us=span_us[0], t_us=span_us[1],
        phase="idle", paused=False, speed_factor=speed, noise_hz=0.0, auto_serve_mps=0.0,
        real_time_factor=speed, served=0, returned=0, scene="", ball_t_us=none, ball=np.empty((0, 9)),
        ball_visible=np.empty(0, np.uint8), racket_t_us=none, racket=np.empty((0, 10)),
    )  # fmt: skip
