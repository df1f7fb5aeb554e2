"""Kinks of a ball's path in space: where it touches something.

Round a contact at time tc the path is two parabolas that meet there: p(t) = p0 + v (t - tc) + a (t - tc)^2 / 2, with a
velocity and an acceleration of its own on either side. For a given tc that is a linear least-squares problem; tc is
where its cost is lowest. Air drag and spin are in the accelerations, which stay near gravity and the drag of a ball of
that speed.

Points of two cameras or more decide where there are enough of them near the contact. Elsewhere, next to a person who
hides the ball from a camera, more of the path counts, and points of one camera: a point on its ray whose distance is
not known, which the least squares take as two equations instead of three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.table import GRAVITY_MPS2
from labels.assist.flight import DRAG_PER_M

Array = NDArray[np.float64]
SIGMA_VELOCITY: Final = 50.0
"""m/s: of a side that one camera sees, the velocity along its rays need not be known."""
SIGMA_ACCELERATION: Final = 10.0
"""m/s^2 between a real flight and one with gravity and drag alone: the force of a fast spin."""
MOST_STRAIN: Final = 4.0
"""More is no flight, but two balls of which one path is made."""
MOST_HIDDEN_STRAIN: Final = 7.0
"""So much where one camera's points count, too: next to a person they are up to 2 px off, all to one side, which bends
the path along their rays, and moves the time little. Seed 4001 of `benchmarks/labels/contact_proposals.py` from events:
5.6 at a hit whose time is 0.5 ms off."""
LEAST_SIGMA_PX: Final = 0.03
"""Points that fit better than this do so by chance."""
SYSTEMATIC_US: Final = 100.0
"""What the scatter of the points does not tell, of windows and delays: the root mean square error of the five bounces
of a simulated rally (`simulate --scene rally --serves 1 --speed 5 --seed 4901`), whose scatter says 10 to 20 us."""
ROUGH_SIGMA_PX: Final = 0.3
"""Scatter of a coordinate, until it is measured."""
TRY_EVERY_US: Final = 3_000
"""A kink so near to a tried time is seen."""
ENOUGH: Final = 15
"""Points of two cameras that say enough of a flight: 30 ms of windows of 2 ms."""
MOST_SEARCHES: Final = 24
"""Golden sections: they narrow 20 ms down to 0.2 us."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactProposalConfig:
    """What counts as a contact."""

    reach_us: int = setting(50_000, 10_000, 200_000)
    """The path so far to either side decides."""
    least_points: int = setting(5, 4, 50)
    """Points on either side; fewer say nothing about a velocity."""
    gap_us: int = setting(60_000, 5_000, 500_000)
    """A contact may be hidden for so long."""
    hidden_reach_us: int = setting(300_000, 10_000, 1_000_000)
    """The path up to so far decides where a camera does not see the ball next to the contact."""
    hidden_gap_us: int = setting(150_000, 5_000, 500_000)
    """A contact may be hidden from all cameras for so long: the flights before and after are extrapolated to meet."""
    hidden_sigma_us: float = setting(3_000.0, 100.0, 20_000.0)
    """A hidden contact whose time is less certain is not proposed."""
    hidden_scatter_px: float = setting(0.7, 0.05, 5.0)
    """Nor one from whose flights points are farther: another contact is hidden there (ours: 0.2 to 0.4 px)."""
    hidden_mps: float = setting(3.0, 0.05, 20.0)
    """Nor one with a smaller change of velocity: of a slow ball that drops 15 cm and bounces."""
    guard_us: int = setting(2_000, 0, 20_000)
    """Points nearer to a contact have events of both sides in their window, and are left out."""
    apart_us: int = setting(12_000, 2_000, 100_000)
    """Two contacts are farther apart."""
    tolerance_px: float = setting(3.0, 0.5, 20.0)
    """Cameras that disagree by more have no point."""
    least_gain: float = setting(12.0, 2.0, 1000.0)
    """By so many sigmas of the change of velocity a kink is one."""
    bounce_mps: float = setting(0.5, 0.05, 10.0)
    """Least change of velocity at a bounce, or at the net."""
    hit_mps: float = setting(1.5, 0.05, 20.0)
    """Least change of velocity at a hit, which may be anywhere."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class PathPoints:
    """N points in space, t_us ascending."""

    t_us: NDArray[np.int64]
    p_world_m: Array
    """(N, 3)"""
    root: Array
    """(N, 3, 3) px/m: the offset of a point times this is as long as it is improbable. It is a root of the inverse
    covariance of a point whose pixels have a standard deviation of 1 px."""
    whole: NDArray[np.bool_]
    """(N,) seen by two cameras or more; of the others the distance from their camera is not known."""

    def rows(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> PathPoints:
        """A subset in this order."""
        return PathPoints(self.t_us[rows], self.p_world_m[rows], self.root[rows], self.whole[rows])


@dataclass(frozen=True, slots=True, eq=False)
class Kink:
    """Two parabolas that meet."""

    t_us: float
    sigma_us: float
    p_world_m: Array
    v_before_mps: Array
    v_after_mps: Array
    gain: float
    """Change of velocity in standard deviations of it."""
    sigma_px: float
    """Scatter of a coordinate about the path."""
    strain: float
    """How far the accelerations are from those of a flight, in `SIGMA_ACCELERATION`: the largest component."""

    @property
    def jump_mps(self) -> float:
        """Change of velocity."""
        return float(np.linalg.norm(self.v_after_mps - self.v_before_mps))


def find_kinks(points: PathPoints, config: ContactProposalConfig) -> tuple[Kink, ...]:
    """Where the path turns, by time: first where two cameras see it, then where the ball is hidden from one or all."""
    whole = points.rows(points.whole)
    clear = _search(_Path(whole, config), _times_to_try(whole, config.gap_us), [])
    judged = _Path(whole, config)
    hidden = [t_us for t_us in _times_to_try(points, config.hidden_gap_us) if judged.near(t_us, clear) is None]
    found = _search(_Path(points, config, hidden=True), hidden, clear)
    for side in (+1, -1):
        found += _search(_Path(points, config, hidden=True, alone=side), hidden, (*clear, *found))
    return tuple(sorted((*clear, *found), key=lambda kink: kink.t_us))


def _search(path: _Path, times_us: Sequence[float], known: Sequence[Kink]) -> list[Kink]:
    """Kinks near some times: the clearest first, each fitted to the path up to its neighbours; `known` are others."""
    rough = [_rough_kink(path, t_us, known) for t_us in times_us]
    peaks = _peaks([kink for kink in rough if kink is not None], path.config)
    # By the gain of the fit: a rough one next to a contact that nobody knows yet owes its gain to that.
    fitted = [(_kink_among(path, peak.t_us, known, peaks), peak) for peak in peaks]
    chosen: list[Kink] = []
    for _, peak in sorted(fitted, key=lambda pair: 0.0 if pair[0] is None else -pair[0].gain):
        _add_kink(chosen, _kink_among(path, peak.t_us, (*known, *chosen), peaks), known, path.config)
    final: list[Kink] = []
    for kink in chosen:  # anew: a weaker neighbour was not known yet
        others = [*known, *(other for other in chosen if other is not kink)]
        _add_kink(final, _kink_among(path, kink.t_us, others, peaks), known, path.config)
    return final


def _kink_among(path: _Path, t_us: float, known: Sequence[Kink], peaks: Sequence[Kink]) -> Kink | None:
    """The kink next to a time, with the path up to the known ones, or if that is no flight, up to the nearest peaks.

    A ball that hits the net low falls onto the table 35 ms later: across either contact the path up to 50 ms has two.
    """
    kink = _refined_kink(path, t_us, known)
    if kink is not None or path.hidden:
        return kink
    others = [peak for peak in peaks if abs(peak.t_us - t_us) >= path.config.apart_us]
    return _refined_kink(path, t_us, (*known, *others))


def _add_kink(kinks: list[Kink], kink: Kink | None, known: Sequence[Kink], config: ContactProposalConfig) -> None:
    """Add it if it is clear, and none of the others."""
    if kink is None or kink.gain < config.least_gain:
        return
    if all(abs(kink.t_us - other.t_us) >= config.apart_us for other in (*known, *kinks)):
        kinks.append(kink)


def _peaks(kinks: list[Kink], config: ContactProposalConfig) -> list[Kink]:
    """Kinks that are clearer than all others within `apart_us` / 2, by time."""
    times, gains = np.array([kink.t_us for kink in kinks]), np.array([kink.gain for kink in kinks])
    first = np.searchsorted(times, times - config.apart_us / 2)
    last = np.searchsorted(times, times + config.apart_us / 2, side="right")
    return [kink for row, kink in enumerate(kinks) if gains[row] >= gains[first[row] : last[row]].max()]


def _times_to_try(points: PathPoints, gap_us: int) -> list[float]:
    """The middles between neighbours that belong together; several where the ball was hidden."""
    t_us = points.t_us.astype(np.float64)
    gaps = np.diff(t_us)
    times = []
    for start, gap in zip(t_us[:-1], gaps, strict=True):
        if gap <= gap_us:
            count = max(int(gap // TRY_EVERY_US), 1)
            times.append(start + gap * (np.arange(count) + 0.5) / count)
    every = np.concatenate(times) if times else np.zeros(0)
    # One of each few: the place is found by the fit.
    return every[np.unique((every / TRY_EVERY_US).astype(np.int64), return_index=True)[1]].tolist()


def _rough_kink(path: _Path, t_us: float, known: Sequence[Kink]) -> Kink | None:
    """The kink at just this time, if both sides are known and it is clear."""
    near = path.near(t_us, known)
    if near is None:
        return None
    gain, values, _ = _gain(_problem(near, t_us, ROUGH_SIGMA_PX), t_us)
    if gain < path.config.least_gain / 2:
        return None
    return Kink(t_us, 0.0, values[0], values[1], values[2], gain, ROUGH_SIGMA_PX, 0.0)


def _refined_kink(path: _Path, t_us: float, others: Sequence[Kink]) -> Kink | None:
    """The kink next to this time that fits best, with the path up to its neighbours."""
    apart = path.config.apart_us
    for last in (False, True):  # the second time without the points next to the place that the first has found
        near = path.near(t_us, others)
        if near is None:
            return None
        before, after = near.t_us[near.t_us < t_us].max(), near.t_us[near.t_us > t_us].min()
        limits = min(before, t_us - apart / 2), max(after, t_us + apart / 2)
        near = _without_outliers(near, t_us)
        t_us = _cheapest(near, *limits)
        if last and limits[0] < t_us < limits[1]:
            kink = _fit(near, t_us)
            return kink if path.believes(kink) else None
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """The points, and how far from a contact they have a say."""

    points: PathPoints
    config: ContactProposalConfig
    hidden: bool = False
    """For contacts next to which the ball is not seen by two cameras."""
    alone: int = 0
    """-1 or +1: the side of a contact that one camera sees, up to another hidden contact; only points near to it count,
    and the other side tells the place. 0: both sides are seen by two cameras, if farther away."""

    def believes(self, kink: Kink) -> bool:
        """Whether it is of two flights that do meet: of two balls no common path is found."""
        config = self.config
        most_strain = MOST_HIDDEN_STRAIN if self.hidden and not self.alone else MOST_STRAIN
        if kink.sigma_px > config.tolerance_px or kink.strain > most_strain:
            return False
        if not self.hidden:
            return True
        fits = kink.sigma_px <= config.hidden_scatter_px and kink.sigma_us <= config.hidden_sigma_us
        return fits and kink.jump_mps >= config.hidden_mps

    def near(self, t_us: float, others: Sequence[Kink]) -> PathPoints | None:
        """The points round a time up to the nearest other kinks, without those next to it; None if too few."""
        config, points, t = self.config, self.points, self.points.t_us
        reach_us, gap_us = (
            (config.hidden_reach_us, config.hidden_gap_us) if self.hidden else (config.reach_us, config.gap_us)
        )
        ends = [other.t_us + config.guard_us for other in others if other.t_us < t_us]
        starts = [other.t_us - config.guard_us for other in others if other.t_us > t_us]
        first, last = np.searchsorted(t, (max([t_us - reach_us, *ends]), min([t_us + reach_us, *starts])))
        rows = np.arange(first, last)
        rows = rows[np.abs(t[rows] - t_us) > config.guard_us]
        kept = []
        for side in (-1, +1):
            own = rows[(t[rows] - t_us) * side > 0][::side]
            away_us = np.abs(t[own] - t_us)
            # Nothing from behind a gap: it may be another ball.
            broken = np.flatnonzero(np.diff(away_us, prepend=0.0) > gap_us)
            own = own[: broken[0]] if len(broken) else own
            count = np.cumsum(points.whole[own])
            if side == self.alone:
                close = own[away_us[: len(own)] <= config.reach_us]
                if not points.whole[close].sum() < config.least_points <= len(close) / 2:
                    return None
                kept.append(close)
                continue
            if not len(own) or count[-1] < config.least_points:
                return None
            # No farther than is needed: a parabola is a flight only so long.
            enough = np.flatnonzero((count >= ENOUGH) & (away_us[: len(own)] >= config.reach_us))
            kept.append(own[: enough[0]] if len(enough) else own)
        return points.rows(np.concatenate([kept[0][::-1], kept[1]]))


def _design(t_us: NDArray[np.int64], contact_us: float) -> Array:
    """(N, 5) of one place, two velocities and two accelerations."""
    since = (t_us - contact_us) * 1e-6
    before, after = np.minimum(since, 0.0), np.maximum(since, 0.0)
    return np.column_stack([np.ones(len(since)), before, after, before**2 / 2, after**2 / 2])


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """The least-squares problem of some points, but for the time of the contact."""

    points: PathPoints
    middle_m: Array
    acceleration: Array
    """(2, 3) expected before and after, m/s^2."""
    sigma_px: float

    def solve(self, contact_us: float) -> tuple[float, Array, Array]:
        """Cost in squared sigmas, values (5, 3), normal matrix (15, 15)."""
        own, basis = self.points, _design(self.points.t_us, contact_us)
        root = own.root / self.sigma_px
        design = (root[:, :, None, :] * basis[:, None, :, None]).reshape(-1, 15)
        pulled = np.matmul(root, (own.p_world_m - self.middle_m)[:, :, None]).ravel()
        right = design.T @ pulled
        right[9:] += self.acceleration.ravel() / SIGMA_ACCELERATION**2
        matrix = design.T @ design
        matrix[np.arange(3, 9), np.arange(3, 9)] += 1 / SIGMA_VELOCITY**2
        matrix[np.arange(9, 15), np.arange(9, 15)] += 1 / SIGMA_ACCELERATION**2
        values = np.linalg.solve(matrix, right)
        off = design @ values - pulled
        pull = (values[9:] - self.acceleration.ravel()) / SIGMA_ACCELERATION
        return float(off @ off + pull @ pull), values.reshape(5, 3), matrix


def _problem(points: PathPoints, contact_us: float, sigma_px: float) -> _Problem:
    sides = (points.t_us < contact_us, points.t_us > contact_us)
    expected = []
    for side in sides:
        known = side & points.whole if (side & points.whole).sum() >= 2 else side
        t = points.t_us[known] * 1e-6
        v = np.polyfit(t - t.mean(), points.p_world_m[known], 1)[0]
        expected.append(np.array([0, 0, -GRAVITY_MPS2]) - DRAG_PER_M * np.linalg.norm(v) * v)
    return _Problem(points, points.p_world_m.mean(axis=0), np.array(expected), sigma_px)


def _misses_px(problem: _Problem, contact_us: float) -> Array:
    """(N,) distance of each point from the fitted path, px."""
    _, values, _ = problem.solve(contact_us)
    own = problem.points
    off = _design(own.t_us, contact_us) @ values - (own.p_world_m - problem.middle_m)
    return np.linalg.norm(np.matmul(own.root, off[:, :, None])[:, :, 0], axis=1)


def _sigma_px(problem: _Problem, contact_us: float) -> float:
    """Robust scatter of a coordinate about the path."""
    # The length of three equal Gaussian coordinates has the median 1.54 standard deviations.
    return max(float(np.median(_misses_px(problem, contact_us))) / 1.54, LEAST_SIGMA_PX)


def _without_outliers(points: PathPoints, contact_us: float) -> PathPoints:
    """The points without those far from the path that the others make; all, if that is more than a third of a side."""
    problem = _problem(points, contact_us, ROUGH_SIGMA_PX)
    misses = _misses_px(problem, contact_us)
    kept = misses < max(5 * float(np.median(misses)) / 1.54, 0.5)
    sides = points.t_us < contact_us, points.t_us > contact_us
    enough = all((kept & side).sum() >= 4 and 3 * kept[side].sum() >= 2 * side.sum() for side in sides)
    return points.rows(kept) if enough else points


def _cheapest(points: PathPoints, low_us: float, high_us: float) -> float:
    """The time between two of which the kink fits best, by a grid and golden sections."""
    middle = (low_us + high_us) / 2
    problem = _problem(points, middle, ROUGH_SIGMA_PX)
    grid = np.linspace(low_us, high_us, 13)
    costs = [problem.solve(float(t_us))[0] for t_us in grid]
    best = int(np.argmin(costs))
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, 12)])
    ratio = (np.sqrt(5) - 1) / 2
    for _ in range(MOST_SEARCHES):
        inner = high - ratio * (high - low), low + ratio * (high - low)
        if problem.solve(inner[0])[0] < problem.solve(inner[1])[0]:
            high = inner[1]
        else:
            low = inner[0]
    return (low + high) / 2


def _gain(problem: _Problem, contact_us: float) -> tuple[float, Array, float]:
    """Change of velocity in standard deviations of it, values (5, 3), cost."""
    cost, values, matrix = problem.solve(contact_us)
    covariance = np.linalg.inv(matrix).reshape(5, 3, 5, 3)
    turn = values[2] - values[1]
    scatter = covariance[1, :, 1] + covariance[2, :, 2] - covariance[1, :, 2] - covariance[2, :, 1]
    return float(np.sqrt(max(turn @ np.linalg.solve(scatter, turn), 0.0))), values, cost


def _fit(points: PathPoints, contact_us: float) -> Kink:
    """The kink at this time with its uncertainty."""
    sigma_px = _sigma_px(_problem(points, contact_us, ROUGH_SIGMA_PX), contact_us)
    problem = _problem(points, contact_us, sigma_px)
    gain, values, cost = _gain(problem, contact_us)
    strain = float(np.abs(values[3:] - problem.acceleration).max()) / SIGMA_ACCELERATION
    # A cost of squared standard deviations rises by 1 at one of them from its lowest place.
    step_us = 200.0
    sides = [problem.solve(contact_us + shift)[0] for shift in (-step_us, step_us)]
    curvature = (sides[0] - 2 * cost + sides[1]) / step_us**2
    sigma_us = float(np.sqrt(2 / curvature)) if curvature > 0 else float(np.ptp(points.t_us))
    sigma_us = float(np.hypot(sigma_us, SYSTEMATIC_US))
    return Kink(contact_us, sigma_us, values[0] + problem.middle_m, values[1], values[2], gain, sigma_px, strain)
