"""Contacts proposed from what detectors found in two or more cameras: where the ball's path in space has a kink.

The positions become points in space, each with the precision that its cameras give it. Round a contact at time tc the
path is two parabolas that meet there: p(t) = p0 + v (t - tc) + a (t - tc)^2 / 2, with a velocity and an acceleration of
its own on either side. For a given tc that is a linear least-squares problem; tc is where its cost is lowest. Air drag
and spin are in the accelerations, which stay near gravity and the drag of a ball of that speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, StereoRig
from core.config import check_settings, setting
from core.table import GRAVITY_MPS2
from labels.assist.flight import DRAG_PER_M
from labels.assist.propose import Proposals
from labels.contacts import kind_at
from labels.model import ContactKind, ContactLabel, PositionSource, Provenance

Array = NDArray[np.float64]
SIGMA_ACCELERATION: Final = 10.0
"""m/s^2 between a real flight and one with gravity and drag alone: the force of a fast spin."""
LEAST_SIGMA_PX: Final = 0.03
"""Points that fit better than this do so by chance."""
SYSTEMATIC_US: Final = 100.0
"""What the scatter of the points does not tell, of windows and delays: the root mean square error of the five bounces
of a simulated rally (`simulate --scene rally --serves 1 --speed 5 --seed 4901`), whose scatter says 10 to 20 us."""
ROUGH_SIGMA_PX: Final = 0.3
"""Scatter of a coordinate, until it is measured."""
TRY_EVERY_US: Final = 3_000
"""A kink so near to a tried time is seen."""
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

    def rows(self, rows: NDArray[np.bool_]) -> PathPoints:
        """A subset in the same order."""
        return PathPoints(self.t_us[rows], self.p_world_m[rows], self.root[rows])


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

    @property
    def jump_mps(self) -> float:
        """Change of velocity."""
        return float(np.linalg.norm(self.v_after_mps - self.v_before_mps))


def propose_contacts(
    cameras: Sequence[Camera], proposals: Sequence[Proposals], config: ContactProposalConfig | None = None
) -> tuple[ContactLabel, ...]:
    """Bounces, hits and net touches in what detectors found in two or more calibrated cameras, by time.

    The cameras' world has to be that of the table: it tells a bounce from a hit.
    """
    config = config or ContactProposalConfig()
    points = points_in_space(cameras, proposals, config.tolerance_px)
    detector = next((part.detector for part in proposals), "")
    contacts = []
    for kink in find_kinks(points, config):
        kind = kind_at(kink.p_world_m, kink.v_before_mps, kink.v_after_mps)
        least = config.hit_mps if kind is ContactKind.HIT else config.bounce_mps
        if kind is None or kink.jump_mps < least or kink.t_us < 0:
            continue
        made = Provenance(source=PositionSource.ACCEPTED, detector=detector)
        t_us, sigma_us = round(kink.t_us), round(kink.sigma_us, 1)
        contacts.append(ContactLabel(t_us=t_us, kind=kind, sigma_us=sigma_us, provenance=made))
    return tuple(contacts)


def points_in_space(cameras: Sequence[Camera], proposals: Sequence[Proposals], tolerance_px: float) -> PathPoints:
    """The points on which two or more cameras agree, and how exact each is."""
    every = np.unique(np.concatenate([part.t_us for part in proposals] or [np.zeros(0, np.int64)]))
    at = [part.at(every) for part in proposals]
    views = np.stack([np.column_stack([part.x_px, part.y_px]) for part in at], axis=1) if at else np.empty((0, 0, 2))
    seen = np.isfinite(views[:, :, 0]).sum(axis=1) >= 2
    every, views = every[seen], views[seen]
    if not len(every):
        return PathPoints(every, np.empty((0, 3)), np.empty((0, 3, 3)))
    rig = StereoRig({str(row): camera for row, camera in enumerate(cameras)})
    found = rig.triangulate(views)
    fine = np.isfinite(found.ps_world_m).all(axis=1) & (found.residuals_px < tolerance_px)
    precision = np.linalg.inv(found.covariances_m2[fine]) * rig.config.sigma_px**2
    root = np.asarray(np.linalg.cholesky(precision).transpose(0, 2, 1), np.float64)
    return PathPoints(every[fine], found.ps_world_m[fine], root)


def find_kinks(points: PathPoints, config: ContactProposalConfig) -> tuple[Kink, ...]:
    """Where the path turns, by time: the clearest first, each fitted to the path up to its neighbours."""
    rough = [_rough_kink(points, float(t_us), config) for t_us in _times_to_try(points, config)]
    peaks = _peaks([kink for kink in rough if kink is not None], config)
    chosen: list[Kink] = []
    for peak in sorted(peaks, key=lambda kink: -kink.gain):
        _add_kink(chosen, _refined_kink(points, peak.t_us, [kink.t_us for kink in chosen], config), config)
    final: list[Kink] = []
    for kink in chosen:  # anew: a weaker neighbour was not known yet
        others = [other.t_us for other in chosen if other is not kink]
        _add_kink(final, _refined_kink(points, kink.t_us, others, config), config)
    return tuple(sorted(final, key=lambda kink: kink.t_us))


def _add_kink(kinks: list[Kink], kink: Kink | None, config: ContactProposalConfig) -> None:
    """Add it if it is clear, and none of the others."""
    if kink is None or kink.gain < config.least_gain:
        return
    if all(abs(kink.t_us - other.t_us) >= config.apart_us for other in kinks):
        kinks.append(kink)


def _peaks(kinks: list[Kink], config: ContactProposalConfig) -> list[Kink]:
    """Those that are clearer than all others so near; by time."""
    times, gains = np.array([kink.t_us for kink in kinks]), np.array([kink.gain for kink in kinks])
    first = np.searchsorted(times, times - config.apart_us / 2)
    last = np.searchsorted(times, times + config.apart_us / 2, side="right")
    return [kink for row, kink in enumerate(kinks) if gains[row] >= gains[first[row] : last[row]].max()]


def _times_to_try(points: PathPoints, config: ContactProposalConfig) -> NDArray[np.float64]:
    """The middles between neighbours that belong together; several where the ball was hidden."""
    t_us = points.t_us.astype(np.float64)
    gaps = np.diff(t_us)
    times = []
    for start, gap in zip(t_us[:-1], gaps, strict=True):
        if gap <= config.gap_us:
            count = max(int(gap // TRY_EVERY_US), 1)
            times.append(start + gap * (np.arange(count) + 0.5) / count)
    every = np.concatenate(times) if times else np.zeros(0)
    # One of each few: the place is found by the fit.
    return every[np.unique((every / TRY_EVERY_US).astype(np.int64), return_index=True)[1]]


def _rough_kink(points: PathPoints, t_us: float, config: ContactProposalConfig) -> Kink | None:
    """The kink at just this time, if both sides are known and it is clear."""
    near = _near(points, t_us, t_us - config.reach_us, t_us + config.reach_us, config)
    if near is None:
        return None
    gain, values, _ = _gain(_problem(near, t_us, ROUGH_SIGMA_PX), t_us)
    return Kink(t_us, 0.0, values[0], values[1], values[2], gain) if gain >= config.least_gain / 2 else None


def _refined_kink(
    points: PathPoints, t_us: float, all_us: Sequence[float], config: ContactProposalConfig
) -> Kink | None:
    """The kink next to this time that fits best, with the path up to its neighbours."""
    guard, apart = config.guard_us, config.apart_us
    low = max((other + guard for other in all_us if other < t_us), default=-np.inf)
    high = min((other - guard for other in all_us if other > t_us), default=np.inf)
    for last in (False, True):  # the second time without the points next to the place that the first has found
        near = _near(points, t_us, max(low, t_us - config.reach_us), min(high, t_us + config.reach_us), config)
        if near is None:
            return None
        before, after = near.t_us[near.t_us < t_us].max(), near.t_us[near.t_us > t_us].min()
        limits = min(before, t_us - apart / 2), max(after, t_us + apart / 2)
        near = _without_outliers(near, t_us)
        t_us = _cheapest(near, *limits)
        if last and limits[0] < t_us < limits[1]:
            return _fit(near, t_us)
    return None


def _near(
    points: PathPoints, t_us: float, start_us: float, end_us: float, config: ContactProposalConfig
) -> PathPoints | None:
    """The points of the path round a time, without those next to it; None if a side has too few of them."""
    t = points.t_us
    first, last = np.searchsorted(t, (start_us, end_us))
    rows = np.zeros(len(t), np.bool_)
    rows[first:last] = True
    rows &= np.abs(t - t_us) > config.guard_us
    for side in (-1, +1):  # nothing from behind a gap: it may be another ball
        own = np.flatnonzero(rows & ((t - t_us) * side > 0))[::side]
        steps = np.abs(np.diff(np.concatenate([[t_us], t[own].astype(np.float64)])))
        broken = np.flatnonzero(steps > config.gap_us)
        if len(broken):
            rows[own[broken[0] :]] = False
            own = own[: broken[0]]
        if len(own) < config.least_points:
            return None
    return points.rows(rows)


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
        matrix[np.arange(9, 15), np.arange(9, 15)] += 1 / SIGMA_ACCELERATION**2
        values = np.linalg.solve(matrix, right)
        off = design @ values - pulled
        pull = (values[9:] - self.acceleration.ravel()) / SIGMA_ACCELERATION
        return float(off @ off + pull @ pull), values.reshape(5, 3), matrix


def _problem(points: PathPoints, contact_us: float, sigma_px: float) -> _Problem:
    sides = (points.t_us < contact_us, points.t_us > contact_us)
    expected = []
    for side in sides:
        t = points.t_us[side] * 1e-6
        v = np.polyfit(t - t.mean(), points.p_world_m[side], 1)[0]
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
    """The points without those far from the path that the others make."""
    problem = _problem(points, contact_us, ROUGH_SIGMA_PX)
    misses = _misses_px(problem, contact_us)
    kept = misses < max(5 * float(np.median(misses)) / 1.54, 0.5)
    both = all((kept & side).sum() >= 4 for side in (points.t_us < contact_us, points.t_us > contact_us))
    return points.rows(kept) if both else points


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
    problem = _problem(points, contact_us, ROUGH_SIGMA_PX)
    problem = _problem(points, contact_us, _sigma_px(problem, contact_us))
    gain, values, cost = _gain(problem, contact_us)
    # A cost of squared standard deviations rises by 1 at one of them from its lowest place.
    step_us = 200.0
    sides = [problem.solve(contact_us + shift)[0] for shift in (-step_us, step_us)]
    curvature = (sides[0] - 2 * cost + sides[1]) / step_us**2
    sigma_us = float(np.sqrt(2 / curvature)) if curvature > 0 else float(np.ptp(points.t_us))
    sigma_us = float(np.hypot(sigma_us, SYSTEMATIC_US))
    return Kink(contact_us, sigma_us, values[0] + problem.middle_m, values[1], values[2], gain)
