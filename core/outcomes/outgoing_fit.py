"""Fit of a struck ball's flight: position and velocity after the contact, with covariance.

Least squares of all points at once, strays weighing less, with what is known of air and spin as a prior.

Many flights at once, each with its own constants: positions at given times, and the first contact. A row is (13,):
position, velocity, spin, drag coefficient, restitution and friction of the table, share of the speed that a net gives
back. The rules of contact are those of `core.physics.contact`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.outcomes.ball_log import BallPoints
from core.outcomes.config import OutcomeClassifierConfig
from core.physics import contact
from core.physics.contact import come_down, cross_net_plane, highest_point, next_contact
from core.physics.flight import Air, rk4_step
from core.physics.impact import Surface, strike
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory.ball_kernel import DRAG_PER_M, LIFT

Array = NDArray[np.float64]
ROW: Final = 13
DRAG, RESTITUTION, FRICTION, NET_SHARE = 9, 10, 11, 12
STEP_S: Final = 0.010
"""Step of a flight: with air, exact to a few micrometres."""
NET_ALONG: Final = 0.5
"""Share of the speed along the net that is left after a touch."""
FOUND: Final = 14
"""What `look_ahead` writes: landing time, position, velocity; height at the net; when it is over the net plane; first
contact: its code, time, position."""


@njit
def glide(s: Array, seconds: float, lift: float) -> None:
    """Move position and velocity of a row through the air, forwards or back in time."""
    left = abs(seconds)
    sign = 1.0 if seconds >= 0 else -1.0
    while left > 1e-12:
        h = min(left, STEP_S)
        rk4_step(s, sign * h, DRAG_PER_M * s[DRAG], lift, s)
        left -= h


@njit
def places_along(rows: Array, t_s: Array, lift: float, ps_m: Array) -> None:
    """Write to `ps_m` (N, K, 3) where each row (N, 13) at time 0 is at ascending times (K,): there is no table here.

    Args:
        rows: (N, 13) states at time 0.
        t_s: (K,) ascending.
        lift: acceleration per spin and velocity across it.
        ps_m: (N, K, 3) output.
    """
    s = np.empty(ROW)
    for i in range(len(rows)):
        s[:] = rows[i]
        now = 0.0
        for k in range(len(t_s)):
            glide(s, t_s[k] - now, lift)
            now = t_s[k]
            ps_m[i, k] = s[:3]


@njit
def look_ahead(rows: Array, lift: float, found: Array) -> None:
    """Write to `found` (N, 14) the landing and first contact of each row (N, 13), see `FOUND`; times are relative to
    the rows.
    """
    state = np.empty(9)
    for i in range(len(rows)):
        s = rows[i, :9]
        air = Air(DRAG_PER_M * rows[i, DRAG], lift, 0.004, lift > 0.0 or rows[i, DRAG] > 0.0)
        t = come_down(s, air, state)
        if math.isnan(t):
            t = highest_point(s, air, state)
        found[i, 0] = t
        found[i, 1:7] = state[:6]
        found[i, 7] = found[i, 8] = math.nan
        if s[0] < 0 and s[3] > 0:
            t = cross_net_plane(s, air, state)
            if not math.isnan(t):
                found[i, 7], found[i, 8] = state[2], t
        what, t = next_contact(s, air, state)
        found[i, 9], found[i, 10] = what, t
        found[i, 11:14] = state[:3]


@njit
def places_after(rows: Array, what: Array, contact_s: Array, t_s: Array, lift: float, ps_m: Array) -> None:
    """Write to `ps_m` (N, K, 3) each row's positions at ascending times (K,), after bouncing off its first contact.

    Args:
        rows: (N, 13) states at time 0.
        what: (N,) code of the first contact.
        contact_s: (N,) when.
        t_s: (K,) ascending.
        lift: acceleration per spin and velocity across it.
        ps_m: (N, K, 3) output.
    """
    s = np.empty(ROW)
    for i in range(len(rows)):
        s[:] = rows[i]
        now, touched = 0.0, False
        for k in range(len(t_s)):
            if not touched and t_s[k] > contact_s[i]:
                glide(s, contact_s[i] - now, lift)
                now, touched = contact_s[i], True
                _leave(s, int(what[i]))
            glide(s, t_s[k] - now, lift)
            now = t_s[k]
            ps_m[i, k] = s[:3]


@njit
def _leave(s: Array, what: int) -> None:
    if what in (contact.OWN_TOP, contact.FAR_TOP):
        strike(s, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), Surface(s[RESTITUTION], 0.0, 0.0, 0.0, s[FRICTION], 1.0))
        s[2] = BALL_RADIUS_M
    elif what in (contact.NET, contact.OWN_END, contact.FAR_END):
        s[3] *= -s[NET_SHARE]
        s[4] *= NET_ALONG
        s[5] *= NET_ALONG
    elif what == contact.FLOOR:
        s[3:6] = 0.0


ROUNDS: Final = 8
"""Gauss-Newton steps of a fit at the most. Chosen by hand; not measured."""
STRAY: Final = 16.0
"""Squared normalised distance in three dimensions beyond which a point is down-weighted."""
WIDE_M, WIDE_MPS = 5.0, 20.0
"""What is known of a struck ball before it is seen: that it is in the hall."""
STEPS: Final = np.array([1e-4] * 3 + [1e-3] * 3 + [1.0] * 3 + [1e-2])
"""Steps of the numerical derivatives, in the unit of each unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class OutgoingFit:
    """A flight at the time `at_s` of its points."""

    at_s: float
    row: Array
    """(13,) of `flight_kernel`."""
    covariance: Array
    """(10, 10) covariance of position, velocity, spin and drag; zeros for fixed ones."""
    lift: float
    log_evidence: float
    """Log evidence for this kind of flight, up to a constant that all kinds share."""
    points: int
    """Number of points without outliers."""

    @property
    def has_air(self) -> bool:
        """Whether it is the kind of flight with drag and spin."""
        return self.lift > 0


def fit_outgoing(points: BallPoints, at_s: float, config: OutcomeClassifierConfig, *, air: bool) -> OutgoingFit:
    """The flight through at least three points, of one of the two kinds.

    Args:
        points: positions after the contact, with covariances.
        at_s: time of the contact, at which the fit's state holds.
        config: priors and noise.
        air: whether drag and spin are unknowns too.
    """
    unknowns = 10 if air else 6
    lift = LIFT * config.magnus if air else 0.0
    row, t_s = _first_guess(points, at_s, config, air=air), points.t_s - at_s
    prior_mean = row[:unknowns].copy()
    prior = np.array([WIDE_M] * 3 + [WIDE_MPS] * 3 + [config.spin_sigma_radps] * 3 + [config.drag_sigma])[:unknowns]
    noise = points.covariances_m2 + config.noise_m**2 * np.eye(3)
    whiten = np.linalg.inv(np.linalg.cholesky(noise))
    normal, squares, weights = np.eye(unknowns), np.zeros(len(t_s)), np.ones(len(t_s))
    for _ in range(ROUNDS):
        predicted, slopes = _slopes(row, t_s, lift, unknowns)
        misses = np.einsum("kij,kj->ki", whiten, points.ps_m - predicted)
        squares = (misses**2).sum(axis=1)
        weights = np.minimum(1.0, STRAY / np.maximum(squares, 1e-12)) / config.alike_points
        design = np.einsum("kij,kjn->kin", whiten, slopes)
        normal = np.einsum("k,kin,kim->nm", weights, design, design) + np.diag(prior**-2)
        gradient = np.einsum("k,kin,ki->n", weights, design, misses) + (prior_mean - row[:unknowns]) / prior**2
        step = np.linalg.solve(normal, gradient)
        row[:unknowns] += step
        if air:
            row[DRAG] = max(row[DRAG], 0.0)
        if (np.abs(step) < 1e-3 * STEPS[:unknowns]).all():
            break
    right = squares < STRAY
    # Mean squared normalised distance per coordinate, 1 if the points' covariances are right: by the median, of which a
    # chi squared of three has 2.366.
    misfit = float(np.median(squares) / 2.366)
    covariance = np.zeros((10, 10))
    # Noise that is larger than the points say shows in the misfit.
    covariance[:unknowns, :unknowns] = np.linalg.inv(normal) * max(1.0, misfit)
    gained = -0.5 * np.linalg.slogdet(normal * np.outer(prior, prior))[1]
    off = ((row[:unknowns] - prior_mean) / prior)[6:]
    fits = -0.5 * float(np.minimum(squares, STRAY).sum()) / config.alike_points - 0.5 * float(off @ off)
    return OutgoingFit(at_s, row, covariance, lift, float(gained) + fits, int(right.sum()))


def _first_guess(points: BallPoints, at_s: float, config: OutcomeClassifierConfig, *, air: bool) -> Array:
    """(13,) free fall through the points, by the medians of thirds (robust to outliers)."""
    t, row = points.t_s - at_s, np.zeros(ROW)
    lifted = points.ps_m.copy()
    lifted[:, 2] += 0.5 * GRAVITY_MPS2 * t**2
    third = max(1, len(t) // 3)
    early, late = slice(0, third), slice(len(t) - third, len(t))
    t0, t1 = np.median(t[early]), np.median(t[late])
    p0, p1 = np.median(lifted[early], axis=0), np.median(lifted[late], axis=0)
    row[3:6] = (p1 - p0) / max(float(t1 - t0), 1e-3)
    row[:3] = p0 - row[3:6] * t0
    row[DRAG] = config.drag if air else 0.0
    row[RESTITUTION], row[FRICTION], row[NET_SHARE] = config.restitution, config.friction, 0.15
    return row


def _slopes(row: Array, t_s: Array, lift: float, unknowns: int) -> tuple[Array, Array]:
    """Positions (K, 3), and their derivatives by the unknowns (K, 3, n)."""
    rows = np.tile(row, (1 + unknowns, 1))
    which = np.arange(unknowns)
    rows[1 + which, which] += STEPS[:unknowns]
    ps = np.empty((len(rows), len(t_s), 3))
    places_along(rows, np.ascontiguousarray(t_s), lift, ps)
    slopes = (ps[1:] - ps[0]) / STEPS[:unknowns, None, None]
    return ps[0], np.moveaxis(slopes, 0, 2)
