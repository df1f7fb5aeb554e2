"""One stroke judged: what became of the ball, by sampled flights that explain the points of its way back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.outcomes.ball_log import BallPoints, ServeSeen, contact_time
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.outgoing_fit import (
    FOUND,
    FRICTION,
    NET_SHARE,
    RESTITUTION,
    ROW,
    OutgoingFit,
    fit_outgoing,
    look_ahead,
    places_after,
)
from core.physics import contact
from core.physics.contact import HALF_LENGTH_M, HALF_WIDTH_M, NET_HALF_WIDTH_M
from core.physics.episode import CASE_OF_CONTACT, Case
from core.table import BALL_RADIUS_M, NET_HEIGHT_M

Array = NDArray[np.float64]

RESTITUTION_SIGMA: Final = 0.04
FRICTION_SIGMA: Final = 0.06
"""Spread of the table's restitution and friction over the sampled flights. Chosen by hand; not measured: wider than the
0.009 and 0.010 to which `core.table` knows those of real balls."""
NET_SHARES: Final = (0.0, 0.4)
"""Share of the speed across the net that it gives back (choice)."""
ODD: Final = 2e-3
"""Probability of outcomes that no sampled flight has (choice)."""
CAP: Final = 9.0
"""Largest squared normalised distance per coordinate that counts against a flight (robustness)."""
MAX_POINTS: Final = 24
"""Most points of the way on that hypotheses are compared with; more are thinned evenly."""
SEED: Final = 7
"""Fixed: the same points give the same outcome."""


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


FIRST_LOOK_S: Final = 0.040
"""Length of the outgoing flight from which its first contact is predicted (choice)."""
ROUNDS: Final = 4
"""The flight is fitted up to where it may touch something, which depends on the fit."""
STOPPED_M: Final = 0.7
"""Where a ball would have come down, had it not fallen between racket and table at once (standard deviation, choice:
nothing was seen of that flight)."""
MARGIN_M: Final = 0.05
SIGMAS: Final = 3.0
"""Standard deviations within which a ball near an edge of table or net may touch it."""


@dataclass(frozen=True, slots=True, eq=False)
class ClassifiedStroke:
    """Outcome of a ball, classified by perception. NaN where there was no stroke; times are those of the points."""

    t_us: int
    """Time of the classification."""
    case: Case
    """The most probable case."""
    probabilities: Array
    """(6,) by the value of `Case`; the first is zero."""
    hit_us: float
    """Time of the impact on the racket, us."""
    hit_state: Array
    """(6,) position and velocity just after the impact."""
    landing_us: float
    landing_m: Array
    """(3,) landing point in the table's plane, net and floor ignored."""
    landing_covariance_m2: Array
    """(2, 2) of x and y."""
    landing_v_mps: Array
    """(3,) velocity there."""
    net_z_m: float
    """Height of its centre over x = 0; NaN if it does not get there."""
    net_sigma_m: float
    contact_us: float
    """Time of the first contact after the racket, us."""
    contact_m: Array
    """(3,) position of the ball at this contact."""
    points: int
    """Points of the outgoing flight, without outliers."""
    serve: ServeSeen | None = None
    """The observed serve; None if it was not seen."""
    final: bool = False
    """Whether the classification is final."""

    @property
    def probability(self) -> float:
        """Probability of the case, 0 to 1."""
        return float(self.probabilities[self.case])


def judge_stroke(points: BallPoints, turn_s: float, config: OutcomeClassifierConfig) -> ClassifiedStroke | None:
    """Classify a ball that turned back at `turn_s`; None without enough points of the way back."""
    guard_s = 1e-3 * config.guard_ms
    back_s = points.t_s[points.t_s > turn_s + guard_s]
    if len(back_s) < config.fewest_points:
        return None
    at_s, end_s = turn_s, max(turn_s + guard_s + FIRST_LOOK_S, float(back_s[config.fewest_points - 1]))
    fits: list[OutgoingFit] = []
    part = points.part(slice(0, 0))
    candidates: list[float] = []
    # The time of the contact depends on the fit, and which points are fitted on the contact.
    for _ in range(ROUNDS):
        which = (points.t_s > at_s + guard_s) & (points.t_s <= end_s)
        if which.sum() < config.fewest_points:
            break
        part = points.part(which)
        fits = [fit_outgoing(part, at_s, config, air=air) for air in (False, True)]
        best = max(fits, key=_evidence)
        met_s = contact_time(points, turn_s, float(best.row[0]), float(best.row[3]), at_s, guard_s)
        candidates = possible_contacts(best)
        new_end_s = min(candidates) - guard_s
        if abs(new_end_s - end_s) < 5e-4 and abs(met_s - at_s) < 5e-4:
            break
        at_s, end_s = met_s, max(new_end_s, at_s + 2 * guard_s)
    if not fits:
        return None
    futures = draw_hypotheses(fits, config, _points_after(points, float(part.t_s[-1]), candidates, config))
    return _describe(futures, max(fits, key=_evidence), points)


def possible_contacts(fit: OutgoingFit) -> list[float]:
    """Times (seconds of the points) at which the ball may touch something first, as far as its flight is known."""
    found = np.empty((1, FOUND))
    look_ahead(fit.row[None], fit.lift, found)
    one, cov = found[0], fit.covariance
    # Points after a contact must not be fitted: so what the ball only may have touched counts as well.
    times = [float(one[10])] if np.isfinite(one[10]) else []

    def margin_m(after_s: float) -> float:
        spread = np.diag(cov)[:3] + 2 * after_s * np.diag(cov[:3, 3:6]) + after_s**2 * np.diag(cov)[3:6]
        return MARGIN_M + SIGMAS * float(np.sqrt(max(0.0, spread.max())))

    if np.isfinite(one[8]):
        near = margin_m(float(one[8]))
        y = fit.row[1] + fit.row[4] * one[8]
        low, high = -BALL_RADIUS_M - near, NET_HEIGHT_M + BALL_RADIUS_M + near
        if low < one[7] < high and abs(y) < NET_HALF_WIDTH_M + near:
            times.append(float(one[8]))
    near = margin_m(float(one[0]))
    if abs(one[1]) < HALF_LENGTH_M + near and abs(one[2]) < HALF_WIDTH_M + near:
        times.append(float(one[0]))
    return [fit.at_s + t for t in times] or [float("inf")]


def _evidence(fit: OutgoingFit) -> float:
    return fit.log_evidence


def _points_after(
    points: BallPoints, last_s: float, candidates: list[float], config: OutcomeClassifierConfig
) -> BallPoints:
    """Points around and shortly after each possible contact."""
    before_s, follow_s = 2e-3 * config.guard_ms, 1e-3 * config.follow_ms
    near = [(points.t_s > t - before_s) & (points.t_s < t + follow_s) for t in candidates]
    return points.part((points.t_s > last_s) & np.any(near, axis=0))


def _describe(futures: Hypotheses, fit: OutgoingFit, points: BallPoints) -> ClassifiedStroke:
    probabilities = futures.probabilities()
    case = Case(int(np.argmax(probabilities)))
    w = futures.weights
    mine = w * (futures.cases == case)
    mine = mine / mine.sum() if mine.sum() > 0 else w
    over = np.isfinite(futures.net_z_m)
    crosses = float(w[over].sum()) > 0.5
    net_z = float(w[over] @ futures.net_z_m[over] / w[over].sum()) if crosses else float("nan")
    net_var = float(w[over] @ (futures.net_z_m[over] - net_z) ** 2 / w[over].sum()) if crosses else float("nan")
    landing = w @ futures.landings
    # What is seen after the contact moves the weights, never the spread below what the points leave open.
    off = futures.landings[:, :2] - landing[:2]
    start_us = points.start_us
    return ClassifiedStroke(
        t_us=start_us + round(1e6 * float(points.t_s[-1])),
        case=case,
        probabilities=probabilities,
        hit_us=start_us + 1e6 * fit.at_s,
        hit_state=fit.row[:6].copy(),
        landing_us=start_us + 1e6 * float(w @ futures.landing_s),
        landing_m=landing[:3],
        landing_covariance_m2=(off * w[:, None]).T @ off,
        landing_v_mps=landing[3:6],
        net_z_m=net_z,
        net_sigma_m=float(np.sqrt(net_var)) if crosses else float("nan"),
        contact_us=start_us + 1e6 * _weighted_median(futures.contact_s, mine),
        contact_m=mine @ futures.contacts_m,
        points=fit.points,
    )


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())])


def missed_stroke(t_us: int, probability: float) -> ClassifiedStroke:
    """Classification of a ball that the racket missed: the other cases share the remaining probability."""
    return _without_flight(t_us, Case.MISSED, probability, np.full(3, np.nan))


def stopped_stroke(t_us: int, at_m: Array, probability: float) -> ClassifiedStroke:
    """A ball that fell between racket and table, at the table's end: it came down where it was met."""
    return _without_flight(t_us, Case.OWN_HALF, probability, at_m)


def _without_flight(t_us: int, case: Case, probability: float, at_m: Array) -> ClassifiedStroke:
    probabilities = np.r_[0.0, np.full(len(Case), (1 - probability) / (len(Case) - 1))]
    probabilities[case] = probability
    nan, known = float("nan"), bool(np.isfinite(at_m[0]))
    return ClassifiedStroke(
        t_us=t_us,
        case=case,
        probabilities=probabilities,
        hit_us=nan,
        hit_state=np.full(6, nan),
        landing_us=nan,
        landing_m=at_m,
        landing_covariance_m2=STOPPED_M**2 * np.eye(2) if known else np.full((2, 2), nan),
        landing_v_mps=np.zeros(3) if known else np.full(3, nan),
        net_z_m=nan,
        net_sigma_m=nan,
        contact_us=nan,
        contact_m=at_m,
        points=0,
        final=True,
    )
