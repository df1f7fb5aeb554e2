"""The inverse of impact and flight: which stroke sends an arriving ball to a place on the table.

Three numbers describe the stroke: tilt and turn of the racket's face and its speed along +x. Three are wanted: where
the ball lands and how high it passes the net. A bounded Gauss-Newton on the forward model finds them; where the bounds
forbid all three, the landing counts more than the height.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics.contact import come_down, cross_net_plane
from core.physics.flight import Air, fly
from core.physics.impact import SPIN_PER_IMPULSE, Surface, strike
from core.table import BALL_RADIUS_M, GRAVITY_MPS2, NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

TILT, TURN, SPEED = range(3)
"""Rows of the unknowns: angle about y (a positive one looks down), about z (to the left), racket speed along +x."""
ROUNDS: Final = 30
"""Most rounds of the solver. Chosen by hand; not measured."""
DONE_M: Final = 1e-4
"""A round that moves the wanted quantities by less is the last one."""
HEIGHT_WEIGHT: Final = 0.3
"""Weight of the height at the net against the landing point, where both cannot be had."""
PROBE: Final = (1e-5, 1e-5, 1e-4)
"""Steps of the finite differences: rad, rad, m/s."""
GRID: Final = (9, 3, 10)
"""Tilts, turns and speeds that the search tries."""
NET_TOP_M: Final = NET_HEIGHT_M + BALL_RADIUS_M
"""A ball's centre that passes higher does not touch the net."""
NEAR_M: Final = 0.02
"""A stroke does what is wanted if the ball lands this near to the target. Chosen by hand; not measured."""
MIN_CLEARANCE_M: Final = 0.03
EDGE_M: Final = 0.08
"""A stroke is safe if the ball passes the net and lands inside the table by this much. Chosen by hand; not measured."""
LONGEST_HOP_STEPS: Final = 250
"""Flights back to the bounce end after one second."""
LONGEST: Final = (0.2, 0.2, 2.0)
"""Steps beyond which the linear model means nothing."""


class StrokeProblem(NamedTuple):
    """A ball, and what a stroke is to make of it."""

    ball: Array
    """(9,) position, velocity and spin at the racket."""
    wanted: Array
    """(3,) landing x, y and height of the ball's centre at the net, metres."""
    low: Array
    """(3,) least tilt, turn and speed."""
    high: Array
    """(3,) largest ones."""
    rubber: Surface
    air: Air


class StrokeSolution(NamedTuple):
    """What the solver found, and what it expects to come of it."""

    tilt_rad: float
    turn_rad: float
    speed_mps: float
    landing_x_m: float
    landing_y_m: float
    net_z_m: float
    """Height of the ball's centre over the net plane."""
    evaluations: int
    """Number of evaluations of the forward model."""


@njit
def play_stroke(ball: Array, tilt: float, turn: float, speed: float, rubber: Surface, air: Air, out: Array) -> bool:
    """Landing x, y and height at the net of a ball state (9,) struck by a face of these angles; false if it fails.

    It fails if the racket does not meet the ball, or the ball does not fly over the net plane and come down.

    Args:
        ball: (9,) position, velocity and spin at the impact: m, m/s, rad/s, world.
        tilt: angle of the face's normal below the horizontal, rad.
        turn: angle of the normal to the left, rad.
        speed: of the racket along +x, m/s.
        rubber: the racket's surface.
        air: the ball's air.
        out: (3,) output: landing x and y, and height over the net plane, m.
    """
    s, end = ball.copy(), np.empty(9)
    normal = (math.cos(turn) * math.cos(tilt), math.sin(turn), -math.cos(turn) * math.sin(tilt))
    # A ball that goes away from the face does not meet it.
    if not (s[3] - speed) * normal[0] + s[4] * normal[1] + s[5] * normal[2] < 0:
        return False
    strike(s, normal, (speed, 0.0, 0.0), rubber)
    if not s[3] > 0 or math.isnan(cross_net_plane(s, air, end)):
        return False
    out[2] = end[2]
    if math.isnan(come_down(s, air, end)):
        return False
    out[0], out[1] = end[0], end[1]
    return True


@njit
def _miss(reached: Array, wanted: Array) -> float:
    height = HEIGHT_WEIGHT * (reached[2] - wanted[2])
    return (reached[0] - wanted[0]) ** 2 + (reached[1] - wanted[1]) ** 2 + height * height


@njit
def _step(problem: StrokeProblem, x: Array, reached: Array, damping: float, step: Array) -> bool:
    """Write the bounded, damped Gauss-Newton step from `x`; false where the model has no derivative."""
    ball, wanted, low, high, rubber, air = problem
    J, near, probe = np.empty((3, 3)), np.empty(3), np.empty(3)
    weights = (1.0, 1.0, HEIGHT_WEIGHT)
    for k in range(3):
        probe[:] = x
        h = PROBE[k] if x[k] + PROBE[k] <= high[k] else -PROBE[k]
        probe[k] += h
        if not play_stroke(ball, probe[0], probe[1], probe[2], rubber, air, near):
            return False
        for i in range(3):
            J[i, k] = weights[i] * (near[i] - reached[i]) / h * LONGEST[k]
    frozen = np.zeros(3, np.bool_)
    for _ in range(3):  # an unknown that would leave its bounds stays on them, and the others are solved for again
        A, b = np.eye(3) * damping, np.zeros(3)
        for k in range(3):
            for m in range(3):
                if not frozen[k] and not frozen[m]:
                    for i in range(3):
                        A[k, m] += J[i, k] * J[i, m]
            if not frozen[k]:
                for i in range(3):
                    b[k] += J[i, k] * weights[i] * (wanted[i] - reached[i])
        solved = np.linalg.solve(A, b)
        again = False
        for k in range(3):
            step[k] = min(max(solved[k], -1.0), 1.0) * LONGEST[k]
            if not frozen[k] and not low[k] <= x[k] + step[k] <= high[k]:
                if x[k] == low[k] or x[k] == high[k]:
                    frozen[k] = again = True
                step[k] = min(max(x[k] + step[k], low[k]), high[k]) - x[k]
        if not again:
            break
    return True


@njit
def solve_stroke(problem: StrokeProblem, start: Array, x: Array, best: Array) -> int:
    """Write the stroke (3,) to `x` and what it reaches (3,) to `best`; the evaluations it took, 0 if none plays.

    Args:
        problem: ball, what is wanted, bounds, surface and air.
        start: (3,) tilt, turn (rad) and speed (m/s) to begin with.
        x: (3,) output: the stroke.
        best: (3,) output: landing x and y, and height over the net plane, m.
    """
    ball, wanted, low, high, rubber, air = problem
    trial, reached, step = np.empty(3), np.empty(3), np.empty(3)
    x[:] = start
    if not play_stroke(ball, x[0], x[1], x[2], rubber, air, best):
        return 0
    cost, damping, evaluations = _miss(best, wanted), 1e-6, 1
    new_cost = cost
    for _ in range(ROUNDS):
        evaluations += 3
        if not _step(problem, x, best, damping, step):
            break
        better = False
        for _ in range(6):
            for k in range(3):
                trial[k] = min(max(x[k] + step[k], low[k]), high[k])
            evaluations += 1
            if play_stroke(ball, trial[0], trial[1], trial[2], rubber, air, reached):
                new_cost = _miss(reached, wanted)
                if new_cost < cost:
                    better = True
                    break
            for k in range(3):
                # Six shorter tries, down to 1 % of the step: beyond a tilt the ball no longer crosses the net, where
                # slopes say nothing.
                step[k] *= 0.4
        if not better:
            break
        moved = math.sqrt(cost) - math.sqrt(new_cost)
        x[:], best[:], cost = trial, reached, new_cost
        if moved < DONE_M or cost < DONE_M * DONE_M:
            break
    return evaluations


@njit
def is_as_wanted(reached: Array, wanted: Array) -> bool:
    """Whether the ball lands where it should, and passes the net though perhaps lower than wanted."""
    near = math.hypot(reached[0] - wanted[0], reached[1] - wanted[1]) < NEAR_M
    return near and reached[2] > min(wanted[2], NET_TOP_M + MIN_CLEARANCE_M)


@njit
def is_safe(reached: Array) -> bool:
    """Whether the ball passes the net and lands on the opponent's half, with room for errors."""
    over = reached[2] > NET_TOP_M + MIN_CLEARANCE_M
    return over and EDGE_M < reached[0] < TABLE_LENGTH_M / 2 - EDGE_M and abs(reached[1]) < TABLE_WIDTH_M / 2 - EDGE_M


@njit
def search_stroke(problem: StrokeProblem, x: Array, best: Array) -> int:
    """Like `solve_stroke` from a grid: the safe stroke that lands nearest, or the one that passes the net highest.

    For balls that the wanted stroke cannot be played on, low ones above all. `x` and `best` are NaN if none plays.
    """
    ball, wanted, low, high, rubber, air = problem
    trial, reached = np.empty(3), np.empty(3)
    x[:], best[:] = math.nan, math.nan
    lowest, found_safe = math.inf, False
    for i in range(GRID[TILT]):
        trial[TILT] = low[TILT] + (high[TILT] - low[TILT]) * i / (GRID[TILT] - 1)
        for j in range(GRID[TURN]):
            trial[TURN] = low[TURN] + (high[TURN] - low[TURN]) * j / (GRID[TURN] - 1)
            for k in range(GRID[SPEED]):
                trial[SPEED] = low[SPEED] + (high[SPEED] - low[SPEED]) * k / (GRID[SPEED] - 1)
                if not play_stroke(ball, trial[TILT], trial[TURN], trial[SPEED], rubber, air, reached):
                    continue
                safe = is_safe(reached)
                cost = math.hypot(reached[0] - wanted[0], reached[1] - wanted[1]) if safe else -reached[2]
                if (safe and not found_safe) or (safe == found_safe and cost < lowest):
                    lowest, found_safe = cost, safe
                    x[:], best[:] = trial, reached
    if not found_safe:
        return GRID[TILT] * GRID[TURN] * GRID[SPEED]
    # From the best of the grid on, as near to the landing point as that height over the net allows.
    lower = np.array([wanted[0], wanted[1], min(wanted[2], best[2])])
    used = solve_stroke(StrokeProblem(ball, lower, low, high, rubber, air), x.copy(), trial, reached)
    if used and is_safe(reached) and math.hypot(reached[0] - wanted[0], reached[1] - wanted[1]) < lowest:
        x[:], best[:] = trial, reached
    return used + GRID[TILT] * GRID[TURN] * GRID[SPEED]


@njit
def _speeds_at_bounce(state: Array, air: Air) -> tuple[float, float]:
    """How fast a ball rose, and went along the table, just after the bounce before this state, by flying it back."""
    s = state.copy()
    along = math.hypot(s[3], s[4])
    if not air.acts:
        return math.sqrt(max(0.0, s[5] * s[5] + 2 * GRAVITY_MPS2 * (s[2] - BALL_RADIUS_M))), along
    for _ in range(LONGEST_HOP_STEPS):
        z, rate, along = s[2], s[5], math.hypot(s[3], s[4])
        fly(s, -air.step_s, air, s)
        if s[2] < BALL_RADIUS_M and s[5] > 0:
            share = (z - BALL_RADIUS_M) / (z - s[2])
            return rate + share * (s[5] - rate), along + share * (math.hypot(s[3], s[4]) - along)
    return 0.0, along


def spin_after_bounce(ball: Array, table: Surface, air: Air) -> Array:
    """The spin (3,) that the table gave a ball which came to it without, from its state (9,) after the bounce.

    The climb rate at the bounce tells the friction impulse, and that the spin: sliding while friction cannot stop the
    contact point, else rolling. The spin in `ball` is a first guess; with the Magnus force it matters a little.
    """
    now = math.hypot(float(ball[3]), float(ball[4]))
    if now == 0.0:
        return np.zeros(3)
    rise, along = _speeds_at_bounce(ball, air)
    e = table.restitution
    push = min(table.friction * (1 + e) / e * rise, along * 2 / 3)
    rate = SPIN_PER_IMPULSE * push / now
    return np.array([-float(ball[4]) * rate, float(ball[3]) * rate, 0.0])
