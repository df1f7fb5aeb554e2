"""Outcome of an episode from a classified ball of a live world."""

from __future__ import annotations

import numpy as np

from core.physics.episode import Case, Outcomes
from core.simulation.episodes.ball_outcome import BallOutcome


def outcomes_of(ball: BallOutcome, served_s: float) -> Outcomes:
    """One row: what learning needs of a ball that was judged in the world, with times since its serve.

    The world reports where the ball comes down and how high it crosses the net; when it was hit and how it left the
    racket stay unknown (NaN), and so do spins.
    """
    landing = np.concatenate([ball.landing_m, ball.landing_v_mps, np.full(3, np.nan)])[None]
    contact = landing.copy()
    contact_t_s, landing_t_s = np.array([ball.t_s - served_s]), np.array([ball.t_s - served_s])
    if ball.case is Case.NET:
        # Decided at the net, before the ball would have come down.
        contact[0, 0], landing_t_s[0] = 0.0, np.inf
    elif ball.case is Case.MISSED:
        contact_t_s[0] = landing_t_s[0] = np.nan
    return Outcomes(
        case=np.array([ball.case], np.int8),
        hit_t_s=np.full(1, np.nan),
        hit_states=np.full((1, 9), np.nan),
        landing_t_s=landing_t_s,
        landing_states=landing,
        net_z_m=np.array([ball.net_z_m]),
        contact_t_s=contact_t_s,
        contact_states=contact,
    )
