"""Inputs of the networks as numbers of the order of one, by constants that never change during or between runs."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.config import StateKind

Floats = NDArray[np.float32]

STATE_CENTRE: Final = np.array([-1.42, 0.0, 0.24, -5.0, 0.0, 0.9])
STATE_SCALE: Final = np.array([0.1, 0.25, 0.1, 2.2, 0.5, 0.9])
"""Middle and spread of p_c (m) and v_c (m/s) over standard and hard serves of 3 to 9 m/s at the hitting plane."""
SPIN_CENTRE_RADPS: Final = np.array([0.0, -120.0, 0.0])
SPIN_SCALE_RADPS: Final = 100.0
SPIN_SIGMA_SCALE_RADPS: Final = 20.0
"""Scale of the spin at the hitting plane, where a state has it (the table gives every ball topspin), and its
uncertainty."""
STATE_SIZES: Final[dict[StateKind, int]] = {"plain": 6, "spin": 12}
"""Numbers of a state: p_c and v_c; with spin also the spin and its standard deviations, both (3,) in rad/s."""
STATE_LIMIT: Final = 10.0
"""A state far outside every serve is clipped to this, so that a wild estimate cannot blow up a network."""
GOAL_CENTRE: Final = np.array([0.775, 0.0])
GOAL_SCALE: Final = np.array([0.325, 0.45])
"""The default target box becomes [-1, 1]."""
RACKET_CENTRE: Final = 1.0
RACKET_SCALE: Final = 1.4
"""Scale of the racket speed (m/s)."""
LANDING_CENTRE: Final = np.array([0.7, 0.0, 0.3])
LANDING_SCALE: Final = np.array([0.8, 0.5, 0.3])
"""Scales of landing point and height at the net (m), the outputs of the landing model."""


_SPIN_CENTRE: Final = np.concatenate([STATE_CENTRE, SPIN_CENTRE_RADPS, np.zeros(3)])
_SPIN_SCALE: Final = np.concatenate([STATE_SCALE, np.full(3, SPIN_SCALE_RADPS), np.full(3, SPIN_SIGMA_SCALE_RADPS)])


def normal_states(states: NDArray[np.floating]) -> Floats:
    """(N, 6) or, with spin, (N, 12) float32, clipped."""
    centre, scale = (STATE_CENTRE, STATE_SCALE) if states.shape[1] == len(STATE_CENTRE) else (_SPIN_CENTRE, _SPIN_SCALE)
    return np.clip((states - centre) / scale, -STATE_LIMIT, STATE_LIMIT).astype(np.float32)


def normal_goals(goals_m: NDArray[np.floating]) -> Floats:
    """Goals (N, 2) scaled for the networks, float32."""
    return ((goals_m - GOAL_CENTRE) / GOAL_SCALE).astype(np.float32)


def normal_racket_speeds(speeds_mps: NDArray[np.floating]) -> Floats:
    """Racket speeds (N,) scaled for the networks, float32."""
    return ((speeds_mps - RACKET_CENTRE) / RACKET_SCALE).astype(np.float32)


def normal_observations(
    states: NDArray[np.floating], goals_m: NDArray[np.floating], racket_speeds_mps: NDArray[np.floating] | None = None
) -> Floats:
    """Input of an actor: state, the racket's speed (N,) if used, and goal; (N, 8) or (N, 9) float32.

    A state with spin adds six columns.
    """
    speeds = [] if racket_speeds_mps is None else [normal_racket_speeds(racket_speeds_mps)[:, None]]
    return np.concatenate([normal_states(states), *speeds, normal_goals(goals_m)], axis=1)
