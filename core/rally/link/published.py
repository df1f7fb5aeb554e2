"""What a server publishes of a block, as messages."""

from __future__ import annotations

import time

import numpy as np

from core.rally.link import messages as m
from core.rally.simulated.world import Block, JudgedBall, RacketContact
from core.simulation.episodes.rally_events import RallyEvent


def event_batch(block: Block, camera: str, session: str, seq: int) -> m.EventBatch:
    """One camera's events, and where the ball is in its picture."""
    events, circle = block.events[camera], block.circles[camera]
    return m.EventBatch(
        session=session,
        seq=seq,
        wall_ns=time.time_ns(),
        camera=camera,
        start_us=block.start_us,
        end_us=block.end_us,
        width_px=events.sensor.width_px,
        height_px=events.sensor.height_px,
        since_us=(events.t_us - block.start_us).astype(np.uint32),
        x_px=events.x_px,
        y_px=events.y_px,
        on=events.on.view(np.uint8),
        truth_t_us=circle.t_us,
        circle=np.column_stack([circle.u_px, circle.v_px, circle.r_px]),
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


def outcome_notice(judged: JudgedBall, session: str, seq: int) -> m.OutcomeNotice:
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
