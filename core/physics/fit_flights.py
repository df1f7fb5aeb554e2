"""Fitting the constants of flight and bounce to recorded flights of real balls.

Every flight has a start of its own (position, velocity, spin); all share drag, restitution and friction. Flights
without spin labels fix only the product of Magnus coefficient and spin, so the coefficient is given and the spins are
*effective* ones. All unknowns are found together by robust least squares, with a weak prior on the spins.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix

from core.errors import ConfigError, RecordingError
from core.jit import njit
from core.physics.config import PhysicsConfig, physics_profile
from core.physics.contact import come_down, over_table
from core.physics.flight import Air, air_from_config, fly
from core.physics.impact import Surface, strike, surfaces_from_config
from core.physics.points_file import PointsFile, read_points_file

Array = NDArray[np.float64]


@njit
def positions_at(start: Array, t_s: Array, air: Air, table: Surface, ps_m: Array) -> None:
    """Write to `ps_m` (N, 3) where a ball that starts as `start` (9,) is at the times `t_s` (N,) >= 0, ascending.

    It bounces on the table's top as often as it comes down there; net, racket and floor are not in the way.

    Args:
        start: (9,) position, velocity and spin at time 0: m, m/s, rad/s.
        t_s: (N,) times since the start.
        air: the ball's air.
        table: the table's surface.
        ps_m: (N, 3) output.
    """
    s, landed = start.copy(), np.empty(9)
    now = 0.0
    wait = come_down(s, air, landed)
    bounce = now + wait if not math.isnan(wait) and over_table(landed[0], landed[1]) else math.inf
    for n in range(len(t_s)):
        while bounce <= t_s[n]:
            s[:] = landed
            strike(s, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), table)
            now = bounce
            wait = come_down(s, air, landed)
            # A ball that lies on the table would bounce for ever in no time.
            later = not math.isnan(wait) and wait > 1e-6 and over_table(landed[0], landed[1])
            bounce = now + wait if later else math.inf
        left = t_s[n] - now
        steps = max(1, math.ceil(left / air.step_s))
        for _ in range(steps):
            fly(s, left / steps, air, s)
        now = t_s[n]
        ps_m[n, 0], ps_m[n, 1], ps_m[n, 2] = s[0], s[1], s[2]


NOISE_M: Final = 0.003
"""Residuals far above it count less (soft L1)."""
SPIN_PRIOR_RADPS: Final = 200.0
"""Standard deviation, each axis: play has 98 / 289 / 754 rad/s (5 / 50 / 95 %)."""
STATE: Final = 9
SCALES: Final = np.array([0.01, 0.01, 0.01, 0.1, 0.1, 0.1, 50.0, 50.0, 50.0])
"""Scales of a start's unknowns: position, velocity, spin."""
SHARED_SCALES: Final = np.array([0.1, 0.05, 0.05])
LOWEST, HIGHEST = np.array([0.0, 0.5, 0.0]), np.array([1.0, 1.0, 1.0])
"""Bounds of drag coefficient, restitution and friction."""
MAX_EVALUATIONS: Final = 60
"""Evaluations after which a fit ends where it is. Chosen by hand; not measured."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFlight:
    """One recorded flight, seen from its first point."""

    name: str
    t_s: Array
    """(N,) from 0."""
    ps_m: Array
    """(N, 3) world."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedPhysics:
    """Fitted constants with standard deviations."""

    drag_coefficient: float
    restitution: float
    friction: float
    magnus_coefficient: float
    """The Magnus coefficient that was given; it is not fitted."""
    starts: Array
    """(flights, 9) position, velocity and effective spin at each flight's first point."""
    rms_m: float
    """Root mean square error of one coordinate, m."""
    median_m: float
    """Distance between a flight and its points: not moved by the few flights that touched something."""

    def profile(self) -> PhysicsConfig:
        """The profile `real` with these constants."""
        return with_constants(self.magnus_coefficient, self.drag_coefficient, self.restitution, self.friction)


def with_constants(magnus: float, drag: float, restitution: float, friction: float) -> PhysicsConfig:
    """The profile `real` with other constants of air and table.

    Args:
        magnus: coefficient of lift by spin.
        drag: drag coefficient.
        restitution: share of the speed across the table that a bounce keeps.
        friction: Coulomb coefficient of the table.
    """
    real = physics_profile("real")
    air = replace(real.air, drag_coefficient=float(drag), magnus_coefficient=float(magnus))
    # One restitution for all speeds is what a fit of so few bounces can tell.
    table = replace(real.table, restitution=float(restitution), restitution_loss_s_per_m=0.0, friction=float(friction))
    return replace(real, air=air, table=table)


def simulate_flight(start: Array, t_s: Array, physics: PhysicsConfig) -> Array:
    """(N, 3) positions at times (N,) from 0, for a start (9,)."""
    ps = np.empty((len(t_s), 3))
    positions_at(start, t_s, air_from_config(physics), surfaces_from_config(physics)[0], ps)
    return ps


def first_guess(flight: RecordedFlight) -> Array:
    """A start (9,): a line with gravity through the first points, without spin."""
    early = flight.t_s <= max(0.1, flight.t_s[min(5, len(flight.t_s) - 1)])
    t = flight.t_s[early]
    flat = flight.ps_m[early] + np.outer(t**2, (0.0, 0.0, 9.81 / 2))
    slope, place = np.polyfit(t, flat, 1)
    return np.concatenate([place, slope, np.zeros(3)])


def fit_physics(
    flights: Sequence[RecordedFlight], magnus: float, *, guess: tuple[Array, Array] | None = None
) -> FittedPhysics:
    """Constants and starts that explain the flights best, from a guess of constants (3,) and starts (flights, 9).

    Raises:
        ConfigError: if there are no flights, or one has fewer than six points.
    """
    if not flights or any(len(flight.t_s) < 6 for flight in flights):
        raise ConfigError("not enough to fit", expected="flights of six points or more", got=len(flights))
    real = physics_profile("real")
    if guess is None:
        constants = np.array([real.air.drag_coefficient, real.table.restitution, real.table.friction])
        guess = constants, np.array([first_guess(flight) for flight in flights])
    shared, starts = guess[0] / SHARED_SCALES, (guess[1] / SCALES).ravel()
    low = np.concatenate([LOWEST / SHARED_SCALES, np.full(len(starts), -np.inf)])
    high = np.concatenate([HIGHEST / SHARED_SCALES, np.full(len(starts), np.inf)])
    # A start moves only its own flight's residuals: the sparsity makes the cost linear in the flights.
    solution = least_squares(
        lambda x: _residuals(x, flights, magnus),
        np.concatenate([shared, starts]),
        jac_sparsity=_sparsity(flights),
        bounds=(low, high),
        loss="soft_l1",
        f_scale=1.0,
        # The unknowns are scaled already, and residuals are in units of NOISE_M.
        x_scale=1.0,
        diff_step=1e-4,
        max_nfev=MAX_EVALUATIONS,
    )
    found = solution.x[:3] * SHARED_SCALES
    fitted = (solution.x[3:].reshape(-1, STATE)) * SCALES
    places = _place_residuals(solution.x, flights, magnus) * NOISE_M
    rms = float(np.sqrt(np.mean(places**2)))
    median = float(np.median(np.linalg.norm(places.reshape(-1, 3), axis=1)))
    return FittedPhysics(float(found[0]), float(found[1]), float(found[2]), magnus, fitted, rms, median)


@dataclass(frozen=True, slots=True)
class BootstrapSigmas:
    """Standard deviations of the shared constants, by bootstrap over the flights."""

    drag_coefficient: float
    restitution: float
    friction: float
    samples: int


def bootstrap(
    flights: Sequence[RecordedFlight], fitted: FittedPhysics, samples: int, seed: int, progress: Callable[[float], None]
) -> BootstrapSigmas:
    """Bootstrap of the constants over the flights from which `fitted` was made.

    Args:
        flights: the recorded flights.
        fitted: the fit to all of them, where each fit begins.
        samples: number of drawings of as many flights, with replacement.
        seed: of the drawings.
        progress: gets the share that is done.
    """
    constants = np.array([fitted.drag_coefficient, fitted.restitution, fitted.friction])
    rng = np.random.default_rng(seed)
    found = np.empty((samples, 3))
    for number in range(samples):
        chosen = rng.integers(0, len(flights), len(flights))
        guess = constants, fitted.starts[chosen]
        fit = fit_physics([flights[k] for k in chosen], fitted.magnus_coefficient, guess=guess)
        found[number] = fit.drag_coefficient, fit.restitution, fit.friction
        progress((number + 1) / samples)
    drag, restitution, friction = found.std(axis=0, ddof=1).tolist()
    return BootstrapSigmas(drag, restitution, friction, samples)


def fit_start(flight: RecordedFlight, physics: PhysicsConfig, *, with_spin: bool) -> Array:
    """The start (9,) of one flight under known constants; without spin it stays 0."""
    unknowns = STATE if with_spin else 6
    guess = first_guess(flight)

    def residuals(x: Array) -> Array:
        start = np.concatenate([x * SCALES[:unknowns], np.zeros(STATE - unknowns)])
        places = (simulate_flight(start, flight.t_s, physics) - flight.ps_m).ravel() / NOISE_M
        return np.concatenate([places, start[6:] / SPIN_PRIOR_RADPS])

    solution = least_squares(residuals, guess[:unknowns] / SCALES[:unknowns], loss="soft_l1", max_nfev=40)
    return np.concatenate([solution.x * SCALES[:unknowns], np.zeros(STATE - unknowns)])


def _place_residuals(x: Array, flights: Sequence[RecordedFlight], magnus: float) -> Array:
    drag, restitution, friction = np.clip(x[:3] * SHARED_SCALES, LOWEST, HIGHEST).tolist()
    physics = with_constants(magnus, drag, restitution, friction)
    air, table = air_from_config(physics), surfaces_from_config(physics)[0]
    starts = x[3:].reshape(-1, STATE) * SCALES
    parts = []
    for flight, start in zip(flights, starts, strict=True):
        ps = np.empty_like(flight.ps_m)
        positions_at(start, flight.t_s, air, table, ps)
        parts.append((ps - flight.ps_m).ravel() / NOISE_M)
    return np.concatenate(parts)


def _residuals(x: Array, flights: Sequence[RecordedFlight], magnus: float) -> Array:
    spins = (x[3:].reshape(-1, STATE) * SCALES)[:, 6:]
    places = np.nan_to_num(_place_residuals(x, flights, magnus), nan=1e3, posinf=1e3, neginf=-1e3)
    return np.concatenate([places, (spins / SPIN_PRIOR_RADPS).ravel()])


def _sparsity(flights: Sequence[RecordedFlight]) -> lil_matrix:
    """Sparsity of the Jacobian: shared constants move all points, a start only its own flight."""
    counts = [3 * len(flight.t_s) for flight in flights]
    rows, unknowns = sum(counts) + 3 * len(flights), 3 + STATE * len(flights)
    pattern = lil_matrix((rows, unknowns), dtype=np.int8)
    pattern[: sum(counts), :3] = 1
    first = 0
    for number, count in enumerate(counts):
        columns = slice(3 + STATE * number, 3 + STATE * (number + 1))
        pattern[first : first + count, columns] = 1
        prior = sum(counts) + 3 * number
        pattern[prior : prior + 3, columns] = 1
        first += count
    return pattern


FEWEST = 12
"""Points of a flight: its start alone has nine unknowns."""


def read_flight_file(path: Path) -> tuple[RecordedFlight, PointsFile]:
    """One flight, and what its file was taken for.

    Raises:
        RallyscopeError: if it cannot be read, or has too few points.
    """
    found = read_points_file(path)
    if len(found.t_s) < FEWEST:
        got = len(found.t_s)
        raise RecordingError("too short a flight", expected=f"{FEWEST} points or more", got=got, where=path)
    return RecordedFlight(path.stem, found.t_s - found.t_s[0], found.ps_m), found
