"""Classification of one struck ball from its points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.outcomes.ball_log import BallPoints
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.flight_kernel import FOUND, look_ahead
from core.outcomes.hypotheses import Hypotheses, draw_hypotheses
from core.outcomes.outgoing_fit import OutgoingFit, fit_outgoing
from core.outcomes.serve_seen import ServeSeen
from core.outcomes.turn import contact_time
from core.physics.contact import HALF_LENGTH_M, HALF_WIDTH_M, NET_HALF_WIDTH_M
from core.physics.episode import Case
from core.table import BALL_RADIUS_M, NET_HEIGHT_M

Array = NDArray[np.float64]

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
    hit_covariance: Array
    """(6, 6) covariance of `hit_state`."""
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
    return _describe(futures, max(fits, key=_evidence), points, config)


def possible_contacts(fit: OutgoingFit) -> list[float]:
    """Times (seconds of the points) at which the ball may touch something first, as far as its flight is known."""
    found = np.empty((1, FOUND))
    look_ahead(fit.row[None], fit.lift, found)
    one, cov = found[0], fit.covariance
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


def _describe(
    futures: Hypotheses, fit: OutgoingFit, points: BallPoints, config: OutcomeClassifierConfig
) -> ClassifiedStroke:
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
    state = fit.row[:6].copy()
    covariance = fit.covariance[:6, :6] + np.diag([config.bias_m**2] * 3 + [config.tilt_mps**2] * 3)
    return ClassifiedStroke(
        t_us=start_us + round(1e6 * float(points.t_s[-1])),
        case=case,
        probabilities=probabilities,
        hit_us=start_us + 1e6 * fit.at_s,
        hit_state=state,
        hit_covariance=covariance,
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
        hit_covariance=np.full((6, 6), nan),
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
