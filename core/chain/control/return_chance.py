"""The probability that a stroke returns a ball whose state is known only so well."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.control.stroke_solver import NET_TOP_M, StrokeProblem, play_stroke
from core.jit import njit
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

PROBES: Final = (1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 1.0, 1.0, 1.0)
"""Steps of the finite differences in position (m), velocity (m/s) and spin (rad/s)."""
LANDING_SIGMA_M: Final = 0.04
"""What the stroke itself adds to the landing point (choice: the median of returned balls is 2 to 4 cm off)."""
NET_SIGMA_M: Final = 0.015
"""What it adds to the height over the net (choice)."""


@njit
def _slopes(problem: StrokeProblem, stroke: Array, reached: Array, J: Array) -> bool:
    """Write to `J` (3, 9) how landing and height at the net change with the ball; false where there is no slope."""
    ball, near = problem.ball.copy(), np.empty(3)
    for k in range(9):
        ball[k] += PROBES[k]
        if not play_stroke(ball, stroke[0], stroke[1], stroke[2], problem.rubber, problem.air, near):
            return False
        ball[k] = problem.ball[k]
        for i in range(3):
            J[i, k] = (near[i] - reached[i]) / PROBES[k]
    return True


def return_chance(
    problem: StrokeProblem, stroke: Array, reached: Array, covariance: Array, radius_m: float
) -> tuple[float, float]:
    """Probability (0 to 1) that the ball comes back, and the standard deviation of where it lands, m.

    It comes back if it meets the face, passes the net, and lands on the opponent's half.

    Args:
        problem: ball, what is wanted, bounds, surface and air.
        stroke: (3,) tilt, turn (rad) and speed (m/s).
        reached: (3,) landing x and y, and height over the net plane, of the ball as it is expected, m.
        covariance: (9, 9) of the ball's position, velocity and spin.
        radius_m: of the face.
    """
    J = np.empty((3, 9))
    if not _slopes(problem, stroke, reached, J):
        return 0.0, math.inf
    spread = (J @ covariance @ J.T).diagonal() + np.square([LANDING_SIGMA_M, LANDING_SIGMA_M, NET_SIGMA_M])
    along, across, high = np.sqrt(spread).tolist()
    x, y, z = reached.tolist()
    half = TABLE_WIDTH_M / 2
    lands = _between(0.0, TABLE_LENGTH_M / 2, x, along) * _between(-half, half, y, across)
    off_face = (covariance[1, 1] + covariance[2, 2]) / 2
    meets = 1.0 - math.exp(-(radius_m**2) / (2 * off_face)) if off_face > 0 else 1.0
    return meets * lands * _between(NET_TOP_M, math.inf, z, high), math.hypot(along, across)


def _between(low: float, high: float, mean: float, sigma: float) -> float:
    """Probability that a normal value is between two bounds."""
    return (math.erf((high - mean) / sigma / math.sqrt(2)) - math.erf((low - mean) / sigma / math.sqrt(2))) / 2
