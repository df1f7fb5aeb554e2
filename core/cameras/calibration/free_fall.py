"""What balls in free flight know: which way is down, and how long a metre is.

Between two bounces every ball is pulled by the same gravity and braked by the air. A track in units of unknown length
is cut into such arcs, and one acceleration is fitted to all of them together: its direction is down, its size in those
units is 9.81 m/s^2. Spin bends flights too; over arcs of different spin that averages out, over few it does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import CalibrationError
from core.table import AIR_KG_PER_M3, BALL_MASS_KG, BALL_RADIUS_M, GRAVITY_MPS2, REAL_DRAG

Array = NDArray[np.float64]

REAL_DRAG_PER_M: Final = 0.5 * AIR_KG_PER_M3 * REAL_DRAG.value * np.pi * BALL_RADIUS_M**2 / BALL_MASS_KG
"""Braking over the squared speed of a real ball."""
GAP_US: Final = 20_000.0
"""A longer pause in the track ends a flight."""
ARC_AT_LEAST_US: Final = 80_000.0
"""Shorter arcs say little: the uncertainty of an acceleration falls with the square of the time."""
POINTS_AT_LEAST: Final = 12
SPLIT_WHEN: Final = 0.25
"""An arc is cut in two where that leaves less than this share of its squared residuals."""
TRIM_US: Final = 5000.0
"""Kept away from where a flight was cut: detections straddle the bounce."""
WORST_SIGMA: Final = 0.05
ROUNDS: Final = 6
ARCS_AT_LEAST: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class Gravity:
    """What the arcs say together."""

    metres_per_unit: float
    sigma_relative: float
    """Standard deviation of `metres_per_unit` over itself."""
    up: Array
    """(3,) unit vector in the track's frame."""
    sigma_up_rad: float
    arcs: int
    points: int


def measure_gravity(
    t_us: Array, ps: Array, information: Array, *, drag_per_m: float, gravity_mps2: float = GRAVITY_MPS2
) -> Gravity:
    """Scale and vertical from a track (N, 3) in any unit, with the inverse covariances (N, 3, 3) of its points.

    `drag_per_m` is the braking acceleration over the squared speed, 0 in a vacuum.

    Args:
        t_us: (N,) times of the points, ascending.
        ps: (N, 3) points in the unit and the frame of the track.
        information: (N, 3, 3) their inverse covariances, in the same unit.
        drag_per_m: braking acceleration over the squared speed, 1/m.
        gravity_mps2: what the common acceleration of all arcs is known to be.

    Raises:
        CalibrationError: with fewer than three arcs of 80 ms.
    """
    arcs = find_arcs(t_us, ps, information)
    if len(arcs) < ARCS_AT_LEAST:
        remedy = "throw or serve the ball several times, or give the scale by a baseline, a wand or the table's corners"
        raise CalibrationError(
            "too little free flight", expected=f"{ARCS_AT_LEAST} arcs of 80 ms", got=len(arcs), remedy=remedy
        )
    braking = [np.zeros((len(arc), 3)) for arc in arcs]
    scale = 1.0
    pull = np.zeros(3)
    covariance = np.eye(3)
    for _ in range(ROUNDS):
        pull, covariance, velocities = _common_pull(t_us, ps, information, arcs, braking)
        scale = gravity_mps2 / float(np.linalg.norm(pull))
        braking = [
            -drag_per_m * scale * np.linalg.norm(v, axis=1, keepdims=True) * v for v in velocities
        ]  # in units: scale * a = -k (scale |v|) (scale v)
    size = float(np.linalg.norm(pull))
    up = -pull / size
    along = float(up @ covariance @ up)
    if along > (WORST_SIGMA * size) ** 2:
        remedy = "gravity needs balls in free flight, not in a hand; or give a baseline, a wand or the table's corners"
        raise CalibrationError(
            "the flights do not agree on gravity",
            expected=f"a scale known to {100 * WORST_SIGMA:.0f} %",
            got=f"{100 * along**0.5 / size:.0f} %",
            remedy=remedy,
        )
    across = max(float(np.trace(covariance)) - along, 0.0)
    points = sum(len(arc) for arc in arcs)
    return Gravity(scale, along**0.5 / size, up, (across / 2) ** 0.5 / size, len(arcs), points)


def find_arcs(t_us: Array, ps: Array, information: Array) -> list[NDArray[np.intp]]:
    """The rows of each arc between bounces, ascending in time."""
    good = np.flatnonzero(np.isfinite(ps).all(axis=1) & np.isfinite(information).all(axis=(1, 2)))
    if not len(good):
        return []
    good = good[np.argsort(t_us[good], kind="stable")]
    runs = np.split(good, np.flatnonzero(np.diff(t_us[good]) > GAP_US) + 1)
    return [arc for run in runs for arc in _cut(run, t_us, ps, information)]


def _cut(rows: NDArray[np.intp], t_us: Array, ps: Array, information: Array) -> list[NDArray[np.intp]]:
    if not _long_enough(rows, t_us):
        return []
    whole = _squares(rows, t_us, ps, information)
    places = np.unique(np.linspace(POINTS_AT_LEAST, len(rows) - POINTS_AT_LEAST, 40).astype(int))
    places = places[(places >= 6) & (places <= len(rows) - 6)]
    if not len(places):
        return [rows]
    left = [_squares(rows[:k], t_us, ps, information) + _squares(rows[k:], t_us, ps, information) for k in places]
    best = int(np.argmin(left))
    if left[best] > SPLIT_WHEN * whole:
        return [rows]
    cut_us = t_us[rows[places[best]]]
    step_us = (t_us[rows[-1]] - t_us[rows[0]]) / 40
    before, after = t_us[rows] < cut_us - step_us - TRIM_US, t_us[rows] > cut_us + step_us + TRIM_US
    return _cut(rows[before], t_us, ps, information) + _cut(rows[after], t_us, ps, information)


def _long_enough(rows: NDArray[np.intp], t_us: Array) -> bool:
    return len(rows) >= POINTS_AT_LEAST and bool(t_us[rows[-1]] - t_us[rows[0]] >= ARC_AT_LEAST_US)


def _squares(rows: NDArray[np.intp], t_us: Array, ps: Array, information: Array) -> float:
    """Squared residuals of the best parabola, each axis by its typical information."""
    t = 1e-6 * (t_us[rows] - t_us[rows].mean())
    design = np.column_stack([np.ones(len(t)), t, t * t])
    left = ps[rows] - design @ np.linalg.lstsq(design, ps[rows], rcond=None)[0]
    return float(np.einsum("ni,nij,nj->", left, information[rows], left))


def _common_pull(
    t_us: Array, ps: Array, information: Array, arcs: list[NDArray[np.intp]], braking: list[Array]
) -> tuple[Array, Array, list[Array]]:
    """The acceleration shared by all arcs beside the braking, its covariance, and the velocities along each arc.

    Errors of neighbouring points go together, so the covariance takes an arc's errors as one (a sandwich estimate).
    """
    normal, right = np.zeros((3, 3)), np.zeros(3)
    parts = []
    for rows, brake in zip(arcs, braking, strict=True):
        t = 1e-6 * (t_us[rows] - t_us[rows].mean())
        whiten = np.linalg.cholesky(information[rows]).transpose(0, 2, 1)
        lost = _twice_summed(t, brake)
        wanted = np.einsum("nij,nj->ni", whiten, ps[rows] - lost).ravel()
        own = np.concatenate([whiten, whiten * t[:, None, None]], axis=2).reshape(-1, 6)
        shared = (whiten * (0.5 * t * t)[:, None, None]).reshape(-1, 3)
        # Start and velocity of each arc are its own: what they explain is taken out, so the shared unknowns stay
        # three.
        Q, _ = np.linalg.qr(own)
        shared_left, wanted_left = shared - Q @ (Q.T @ shared), wanted - Q @ (Q.T @ wanted)
        normal += shared_left.T @ shared_left
        right += shared_left.T @ wanted_left
        parts.append((t, own, shared, wanted, shared_left, wanted_left, brake))
    pull = np.linalg.solve(normal, right)
    middle = np.zeros((3, 3))
    velocities = []
    for t, own, shared, wanted, shared_left, wanted_left, brake in parts:
        score = shared_left.T @ (wanted_left - shared_left @ pull)
        middle += np.outer(score, score)
        start = np.linalg.lstsq(own, wanted - shared @ pull, rcond=None)[0]
        velocities.append(start[3:] + t[:, None] * pull + _summed(t, brake))
    inverse = np.linalg.inv(normal)
    pull = np.asarray(pull, np.float64)
    return pull, inverse @ middle @ inverse, velocities


def _summed(t: Array, rates: Array) -> Array:
    """Integral over time (trapezoids) from the first time on."""
    steps = 0.5 * np.diff(t)[:, None] * (rates[1:] + rates[:-1])
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def _twice_summed(t: Array, rates: Array) -> Array:
    return _summed(t, _summed(t, rates))
