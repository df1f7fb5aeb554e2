"""Messages that a server publishes for a block, and those of sources without a robot and without truth."""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from core.cameras import Camera
from core.events import Events, SensorSize
from core.live.link import messages as m
from core.recordings import PixelTruth
from core.simulation.episodes.ball_outcome import RallyEvent
from core.simulation.event_cameras.event_camera import BLOCK_US

if TYPE_CHECKING:  # it loads MuJoCo, which is not needed for real cameras
    from core.live.worlds.world import Block, ClassifiedBall, RacketContact


def event_batch(block: Block, camera: str, session: str, seq: int) -> m.EventBatch:
    """One camera's events, and where the ball is in its picture."""
    span_us = block.start_us, block.end_us
    return camera_batch(camera, block.events[camera], span_us, session, seq, truth=block.circles[camera])


def camera_batch(
    camera: str, events: Events, span_us: tuple[int, int], session: str, seq: int, *, truth: PixelTruth | None = None
) -> m.EventBatch:
    """The events of a camera in a stretch, and where the ball is in its picture if that is known.

    Args:
        camera: its name.
        events: of the span, on the session's clock.
        span_us: start and end.
        session: identity of the session.
        seq: number of the message.
        truth: where the ball is, if known.
    """
    start_us, end_us = span_us
    nobody_knows = np.empty(0, np.int64), np.empty((0, 3))
    known = None if truth is None else (truth.t_us, np.column_stack([truth.u_px, truth.v_px, truth.r_px]))
    truth_t_us, circle = known or nobody_knows
    return m.EventBatch(
        session=session,
        seq=seq,
        wall_ns=time.time_ns(),
        camera=camera,
        start_us=start_us,
        end_us=end_us,
        width_px=events.sensor.width_px,
        height_px=events.sensor.height_px,
        since_us=(events.t_us - start_us).astype(np.uint32),
        x_px=events.x_px,
        y_px=events.y_px,
        on=events.on.view(np.uint8),
        truth_t_us=truth_t_us,
        circle=circle,
    )


def serve_notice(serve: RallyEvent, session: str, seq: int) -> m.ServeNotice:
    """A ball was put into play."""
    state = tuple(serve.state.tolist())
    speed_mps = float(np.linalg.norm(serve.state[3:6]))
    t_us = round(serve.t_s * 1e6)
    return m.ServeNotice(
        session=session, seq=seq, t_us=t_us, speed_mps=speed_mps, p_m=state[:3], v_mps=state[3:6], spin_radps=state[6:]
    )


def contact_notice(contact: RacketContact, session: str, seq: int) -> m.BounceNotice | m.HitNotice:
    """The ball touched the table, or was hit."""
    event, t_us = contact.event, round(contact.event.t_s * 1e6)
    p, v = tuple(event.state[:3].tolist()), tuple(event.state[3:6].tolist())
    if event.kind == "bounce":
        return m.BounceNotice(session=session, seq=seq, t_us=t_us, p_m=p, v_mps=v)
    before, q = tuple(event.touched[3:6].tolist()), tuple(contact.q_wxyz.tolist())
    return m.HitNotice(session=session, seq=seq, t_us=t_us, p_m=p, v_mps=v, v_before_mps=before, q_wxyz=q)


def outcome_notice(judged: ClassifiedBall, session: str, seq: int) -> m.OutcomeNotice:
    """What came of a ball."""
    outcome, serve = judged.outcome, judged.serve
    return m.OutcomeNotice(
        session=session,
        seq=seq,
        t_us=round(outcome.t_s * 1e6),
        serve_us=round(serve.t_s * 1e6),
        speed_mps=float(np.linalg.norm(serve.state[3:6])),
        case=outcome.case,
        arrival=tuple(judged.arrival.tolist()),
        q_wxyz=tuple(judged.q_wxyz.tolist()),
        landing_m=tuple(outcome.landing_m.tolist()),
        landing_v_mps=tuple(outcome.landing_v_mps.tolist()),
        net_z_m=float(outcome.net_z_m),
    )


def published_ball_rows(block: Block) -> m.Array:
    """(N, 9) position, velocity and spin of a state."""
    ball = block.ball
    return np.concatenate([ball.p_world_m, ball.v_world_mps, ball.spin_radps], axis=1)


CamerasBySize = Mapping[str, tuple[SensorSize, Camera | None]]
"""Size of each camera's pictures, and its calibration where that is known, by name."""


def welcome_to(cameras: CamerasBySize, frame_cameras: CamerasBySize | None = None) -> m.Reply:
    """A new session of event cameras, and of ordinary ones."""
    return m.Reply(
        id=0, ok=True, session=uuid.uuid4().hex, t_us=0, block_us=BLOCK_US,
        cameras=_infos(cameras), frame_cameras=_infos(frame_cameras or {}),
    )  # fmt: skip


def _infos(cameras: CamerasBySize) -> tuple[m.CameraInfo, ...]:
    return tuple(
        m.CameraInfo.uncalibrated(name, sensor) if known is None else m.CameraInfo.of(name, known)
        for name, (sensor, known) in cameras.items()
    )


def state_of_block(session: str, seq: int, span_us: tuple[int, int], speed: float) -> m.WorldState:
    """The state that ends a block: its times, and nothing of ball or racket.

    Args:
        session: identity of the session.
        seq: number of the message.
        span_us: start and end of the block.
        speed: times real time.
    """
    none = np.empty(0, np.int64)
    return m.WorldState(
        session=session, seq=seq, wall_ns=time.time_ns(), start_us=span_us[0], t_us=span_us[1],
        phase="idle", paused=False, speed_factor=speed, noise_hz=0.0, auto_serve_mps=0.0,
        real_time_factor=speed, served=0, returned=0, scene="", ball_t_us=none, ball=np.empty((0, 9)),
        ball_visible=np.empty(0, np.uint8), racket_t_us=none, racket=np.empty((0, 10)),
    )  # fmt: skip
