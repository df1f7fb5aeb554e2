"""Steps of the ball's Kalman filter: free flight, bounce, observation, and the covariance of what follows."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.trajectory.ball_kernel import (
    AHEAD,
    DRAG,
    DRAG_PER_M,
    FRICTION,
    HIGHER,
    SPIN,
    STATE,
    TOUCHES,
    bounce,
    glide,
    pull,
    touches,
)

Array = NDArray[np.float64]

LONGEST_STEP_S: Final = 0.010
"""Longest step of the covariance: its transition is a second-order series in the step."""
MOVES: Final = 10
"""Number of state components that affect position and velocity in the air."""
SIDES: Final = 2
ROWS: Final = 1 + SIDES * (STATE - 1)
"""The estimate, and a step up and down along each direction of its spread; `ahead` moves no ball."""


class ProcessNoise(NamedTuple):
    """Process noise."""

    lift: float
    """Acceleration over (spin x velocity)."""
    air: float
    """White acceleration, m/s^2 per root hertz."""
    bounce_mps: float
    """Scatter of each component of the velocity from bounce to bounce."""
    ahead_m: float
    """Stationary standard deviation of the observations' offset along the flight, m."""
    ahead_s: float
    """Correlation time of that error, s."""


@njit
def _slope(x: Array, lift: float, out: Array) -> None:
    """Write to `out` (3, 10) how the acceleration changes with position, velocity, spin and drag."""
    vx, vy, vz = x[3], x[4], x[5]
    # Of -k |v| v + lift (spin x v); a ball at rest has no direction, hence the 1e-9.
    speed = math.sqrt(vx * vx + vy * vy + vz * vz) + 1e-9
    k = DRAG_PER_M * x[DRAG]
    wx, wy, wz = x[6], x[7], x[8]
    for row in range(3):
        for column in range(3):
            out[row, column] = 0.0
            out[row, 3 + column] = -k * x[3 + row] * x[3 + column] / speed
        out[row, 3 + row] -= k * speed
        out[row, DRAG] = -DRAG_PER_M * speed * x[3 + row]
    out[0, 4] -= lift * wz
    out[0, 5] += lift * wy
    out[1, 3] += lift * wz
    out[1, 5] -= lift * wx
    out[2, 3] -= lift * wy
    out[2, 4] += lift * wx
    out[0, 6], out[0, 7], out[0, 8] = 0.0, lift * vz, -lift * vy
    out[1, 6], out[1, 7], out[1, 8] = -lift * vz, 0.0, lift * vx
    out[2, 6], out[2, 7], out[2, 8] = lift * vy, -lift * vx, 0.0


@njit
def move(x: Array, cov: Array, seconds: float, process_noise: ProcessNoise) -> None:
    """Let the estimate fly freely, in place: there is no table here.

    Args:
        x: (14,) estimate, changed in place.
        cov: (14, 14) its covariance, changed in place.
        seconds: how long.
        process_noise: what the model leaves out, and the lift.
    """
    A, F, old = np.empty((3, MOVES)), np.empty((6, STATE)), np.empty((6, STATE))
    left = seconds
    while left > 1e-12:
        h = min(left, LONGEST_STEP_S)
        left -= h
        _slope(x, process_noise.lift, A)
        # Velocity: v + h a + h^2 / 2 (da/dv a); position: its integral.
        F[:] = 0.0
        for i in range(3):
            for j in range(3, MOVES):
                bend = 0.0
                for k in range(3):
                    bend += A[i, 3 + k] * A[k, j]
                F[3 + i, j] = h * A[i, j] + h * h / 2 * bend
                F[i, j] = h * h / 2 * A[i, j] + h * h * h / 6 * bend
            F[i, i] = 1.0
            F[i, 3 + i] += h
            F[3 + i, 3 + i] += 1.0
        for i in range(6):
            for j in range(STATE):
                total = 0.0
                for k in range(MOVES):
                    total += F[i, k] * cov[k, j]
                old[i, j] = total
        for i in range(6):
            for j in range(6):
                total = 0.0
                for k in range(MOVES):
                    total += old[i, k] * F[j, k]
                cov[i, j] = total
            for j in range(6, STATE):
                cov[i, j] = cov[j, i] = old[i, j]
        q = process_noise.air * process_noise.air * h
        for k in range(3):
            cov[3 + k, 3 + k] += q
            cov[k, 3 + k] += q * h / 2
            cov[3 + k, k] += q * h / 2
            cov[k, k] += q * h * h / 3
        keep = math.exp(-h / process_noise.ahead_s)
        for k in range(STATE):
            cov[AHEAD, k] *= keep
            cov[k, AHEAD] *= keep
        cov[AHEAD, AHEAD] += (1 - keep * keep) * process_noise.ahead_m * process_noise.ahead_m
        x[AHEAD] *= keep
        glide(x, h, process_noise.lift, x)


@njit
def bounce_estimate(x: Array, cov: Array, process_noise: ProcessNoise) -> None:
    """Take the estimate, which is at the table's plane, off it. When it got there is as uncertain as its height.

    The transition is that of a flight with an event (saltation matrix): S = D + (f_after - D f_before) n' / n' f_before
    with D the slope of the bounce, f the rates of change and n the normal of z - higher.
    """
    before, after = x.copy(), x.copy()
    bounce(after)
    D, moved = np.eye(STATE), np.empty(STATE)
    for k in range(3, HIGHER):
        # Finite differences: spin is in hundreds of rad/s, the others near 1. The place is not changed by a bounce.
        eps = 1e-4 if SPIN <= k < DRAG else 1e-6
        moved[:] = before
        moved[k] += eps
        bounce(moved)
        D[:, k] = (moved - after) / eps
    if D[3, FRICTION] == 0.0 and D[4, FRICTION] == 0.0:
        # A ball that leaves the table rolling says nothing of more friction, but with less it would have slipped and
        # kept more speed: without that slope a friction assumed too high is never corrected, and the spin with it.
        less = min(math.sqrt(max(cov[FRICTION, FRICTION], 0.0)), before[FRICTION])
        if less > 0.0:
            moved[:] = before
            moved[FRICTION] -= less
            bounce(moved)
            D[3:DRAG, FRICTION] = (after - moved)[3:DRAG] / less
    rate, rate_after = np.zeros(STATE), np.zeros(STATE)
    rate[:3], rate_after[:3] = before[3:6], after[3:6]
    rate[3], rate[4], rate[5] = pull(before, process_noise.lift)
    rate_after[3], rate_after[4], rate_after[5] = pull(after, process_noise.lift)
    jump = (rate_after - D @ rate) / before[5]
    D[:, 2] += jump
    D[:, HIGHER] -= jump
    cov[:] = D @ cov @ D.T
    for k in range(3, 6):
        cov[k, k] += process_noise.bounce_mps * process_noise.bounce_mps
    x[:] = after


@njit
def observe(
    x: Array, cov: Array, p_m: Array, noise_m2: Array, scales: Array, gate: float, tally: Array
) -> tuple[float, float]:
    """Take an observed position with its covariance (3, 3), scaled by `scales` (3,), unless it is too far off.

    Its squared normalised distance, and the logarithm of its likelihood but for a constant. To `tally` (2, 3) is added
    what it says of the scales of the variances: weighted samples of them, and the weights.

    Args:
        x: (14,) estimate, changed in place.
        cov: (14, 14) its covariance, changed in place.
        p_m: (3,) observed position, world.
        noise_m2: (3, 3) its covariance.
        scales: (3,) factors of that covariance along x, y, z.
        gate: squared normalised distance beyond which the position is not taken.
        tally: (2, 3) sums, added to.
    """
    speed = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5]) + 1e-9
    PH = np.empty((STATE, 3))
    for i in range(STATE):
        for k in range(3):
            PH[i, k] = cov[i, k] + cov[i, AHEAD] * x[3 + k] / speed
    S, miss = np.empty((3, 3)), np.empty(3)
    for k in range(3):
        miss[k] = p_m[k] - x[k] - x[AHEAD] * x[3 + k] / speed
        for j in range(3):
            S[j, k] = PH[j, k] + PH[AHEAD, k] * x[3 + j] / speed
            S[j, k] += noise_m2[j, k] * math.sqrt(scales[j] * scales[k])
    # The inverse of a symmetric 3 x 3 by its cofactors.
    a, b, c, d, e, f = S[0, 0], S[0, 1], S[0, 2], S[1, 1], S[1, 2], S[2, 2]
    determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    W = np.empty((3, 3))
    W[0, 0], W[1, 1], W[2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
    W[0, 1] = W[1, 0] = c * e - b * f
    W[0, 2] = W[2, 0] = b * e - c * d
    W[1, 2] = W[2, 1] = b * c - a * e
    W /= determinant
    pulled = W @ miss
    distance = miss[0] * pulled[0] + miss[1] * pulled[1] + miss[2] * pulled[2]
    # An outlier counts no more than a point at the gate.
    likelihood = -0.5 * (min(distance, gate) + math.log(determinant))
    if distance > gate:
        return distance, likelihood
    for k in range(3):
        noise = noise_m2[k, k]
        weight = (scales[k] * noise / S[k, k]) ** 2
        tally[0, k] += weight * ((miss[k] * miss[k] - S[k, k]) / noise + scales[k])
        tally[1, k] += weight
    K = PH @ W
    for i in range(STATE):
        x[i] += K[i, 0] * miss[0] + K[i, 1] * miss[1] + K[i, 2] * miss[2]
        for j in range(i + 1):
            cov[i, j] -= K[i, 0] * PH[j, 0] + K[i, 1] * PH[j, 1] + K[i, 2] * PH[j, 2]
            cov[j, i] = cov[i, j]
    return distance, likelihood


@njit
def _neighbours(x: Array, cov: Array, rows: Array) -> None:
    """Write to `rows` (27, 14) the estimate and its neighbours, a column of the covariance's root up and down."""
    n = STATE - 1
    root = np.zeros((n, n))
    for k in range(n):
        pivot = cov[k, k]
        for m in range(k):
            pivot -= root[k, m] * root[k, m]
        if pivot <= 1e-14 * cov[k, k]:
            continue
        root[k, k] = math.sqrt(pivot)
        for i in range(k + 1, n):
            total = cov[i, k]
            for m in range(k):
                total -= root[i, m] * root[k, m]
            root[i, k] = total / root[k, k]
    rows[0] = x
    for k in range(n):
        for i in range(n):
            rows[1 + 2 * k, i] = x[i] + root[i, k]
            rows[2 + 2 * k, i] = x[i] - root[i, k]
        rows[1 + 2 * k, AHEAD] = rows[2 + 2 * k, AHEAD] = x[AHEAD]


@njit
def foresee(x: Array, cov: Array, t_s: float, hit_x_m: float, lift: float, rows: Array, spread: Array) -> Array:
    """(22,) what the estimate touches next. The neighbours go to `rows`, to `spread` (22, 22) the covariance of that.

    Where a neighbour does not touch it (it misses the table's edge, say), the difference to the other one counts.

    Args:
        x: (14,) estimate.
        cov: (14, 14) its covariance.
        t_s: its time.
        hit_x_m: x of the hitting plane.
        lift: acceleration per spin and velocity across it.
        rows: (27, 14) output: the estimate, and two neighbours of it along each unknown.
        spread: (22, 22) output: covariance of what is touched.
    """
    _neighbours(x, cov, rows)
    found = np.empty((len(rows), TOUCHES))
    touches(rows, t_s, hit_x_m, lift, found)
    moves = np.zeros((STATE - 1, TOUCHES))
    for k in range(STATE - 1):
        for j in range(TOUCHES):
            up, down = found[1 + 2 * k, j], found[2 + 2 * k, j]
            middle, share = found[0, j], 0.5
            if math.isnan(up):
                up, share = middle, 1.0
            elif math.isnan(down):
                down, share = middle, 1.0
            change = share * (up - down)
            moves[k, j] = 0.0 if math.isnan(change) else change
    # The neighbours are one standard deviation away along independent directions, so the squares add.
    spread[:] = moves.T @ moves
    return found[0].copy()
