"""Hypotheses of a struck ball's flight: samples of its posterior, weighted by later points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.outcomes.ball_log import BallPoints
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.flight_kernel import FOUND, FRICTION, NET_SHARE, RESTITUTION, ROW, look_ahead, places_after
from core.outcomes.outgoing_fit import OutgoingFit
from core.physics import contact
from core.physics.episode import CASE_OF_CONTACT, Case

Array = NDArray[np.float64]

RESTITUTION_SIGMA: Final = 0.04
FRICTION_SIGMA: Final = 0.06
NET_SHARES: Final = (0.0, 0.4)
"""Share of the speed across the net that it gives back (choice)."""
ODD: Final = 2e-3
"""Probability of outcomes that no sampled flight has (choice)."""
CAP: Final = 9.0
"""Largest squared normalised distance per coordinate that counts against a flight (robustness)."""
MAX_POINTS: Final = 24
SEED: Final = 7


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """N flights with their weights; times in seconds of the points."""

    states: Array
    """(N, 6) at `at_s`."""
    at_s: float
    weights: Array
    """(N,) sum 1."""
    landing_s: Array
    landings: Array
    """(N, 6) where each comes down to the table's plane, net ignored, and its velocity there."""
    net_z_m: Array
    """(N,) NaN where it does not cross the net plane."""
    contact_s: Array
    contacts_m: Array
    """(N, 3) first contacts."""
    what: NDArray[np.int64]
    """(N,) codes of `core.physics.contact`."""

    @property
    def cases(self) -> NDArray[np.int8]:
        """(N,)."""
        return CASE_OF_CONTACT[self.what]

    def probabilities(self) -> Array:
        """(6,) by the value of `Case`."""
        found = np.bincount(self.cases, weights=self.weights, minlength=len(Case) + 1)
        return (1 - ODD) * found + np.r_[0.0, np.full(len(Case), ODD / len(Case))]


def draw_hypotheses(fits: Sequence[OutgoingFit], config: OutcomeClassifierConfig, after: BallPoints) -> Hypotheses:
    """Sample flights of all kinds that explain the points about as well as the best, weighted by the points `after`."""
    best = max(fit.log_evidence for fit in fits)
    shares = np.exp(np.array([fit.log_evidence for fit in fits]) - best)
    shares /= shares.sum()
    parts = [
        _draw(fit, max(16, round(config.samples * share)), share, config, after)
        for fit, share in zip(fits, shares, strict=True)
        if share > 1e-3
    ]
    states, landing_s, landings, net_z, contact_s, contacts, what, logs = (
        np.concatenate([part[k] for part in parts]) for k in range(8)
    )
    weights = np.exp(logs - logs.max())
    whats = what.astype(np.int64)
    return Hypotheses(
        states, fits[0].at_s, weights / weights.sum(), landing_s, landings, net_z, contact_s, contacts, whats
    )


def _draw(
    fit: OutgoingFit, count: int, share: float, config: OutcomeClassifierConfig, after: BallPoints
) -> tuple[Array, ...]:
    rng = np.random.default_rng(SEED)  # equal points give equal results
    rows = np.tile(fit.row, (count, 1))
    spread = fit.covariance.copy()
    spread[:3, :3] += config.bias_m**2 * np.eye(3)
    spread[3:6, 3:6] += config.tilt_mps**2 * np.eye(3)
    rows[1:, :10] += rng.standard_normal((count - 1, 10)) @ _root(spread).T
    rows[:, 9] = np.maximum(rows[:, 9], 0.0)
    rows[1:, RESTITUTION] += RESTITUTION_SIGMA * rng.standard_normal(count - 1)
    rows[1:, FRICTION] = np.abs(rows[1:, FRICTION] + FRICTION_SIGMA * rng.standard_normal(count - 1))
    rows[1:, NET_SHARE] = rng.uniform(*NET_SHARES, count - 1)
    assert rows.shape[1] == ROW
    found = np.empty((count, FOUND))
    look_ahead(rows, fit.lift, found)
    contact_s = np.where(found[:, 9] == contact.NOTHING, np.inf, found[:, 10])
    logs = np.full(count, np.log(share / count)) + _likelihood(rows, found[:, 9], contact_s, fit, config, after)
    return (
        rows[:, :6], fit.at_s + found[:, 0], found[:, 1:7], found[:, 7], fit.at_s + contact_s, found[:, 11:14],
        found[:, 9], logs,
    )  # fmt: skip


def _root(covariance: Array) -> Array:
    """A matrix R with R R^T the covariance, also of what is known exactly."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _likelihood(
    rows: Array, what: Array, contact_s: Array, fit: OutgoingFit, config: OutcomeClassifierConfig, after: BallPoints
) -> Array:
    """(N,) logarithm of how well each flight, thrown off what it touches, explains the points after the fitted ones."""
    if not len(after):
        return np.zeros(len(rows))
    thinned = after.part(np.unique(np.linspace(0, len(after) - 1, MAX_POINTS).astype(np.int64)))
    t_s = np.ascontiguousarray(thinned.t_s - fit.at_s)
    ps = np.empty((len(rows), len(t_s), 3))
    places_after(rows, what, contact_s, t_s, fit.lift, ps)
    since_s = np.maximum(t_s[None] - contact_s[:, None], 0.0)
    sigma = np.where(since_s > 0, np.hypot(config.after_m, config.after_mps * since_s), 0.5 * config.after_m)
    squares = ((thinned.ps_m[None] - ps) ** 2).sum(axis=2) / sigma**2
    logs = -0.5 * np.minimum(squares, 3 * CAP) - 3 * np.log(sigma)
    return logs.sum(axis=1) / config.alike_points
