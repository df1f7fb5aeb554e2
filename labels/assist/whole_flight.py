"""All proposals of one free flight at once: those of two or more cameras that one ball explains, and the others.

From a few instants round the cursor outwards: a flight is fitted, proposals a little beyond its ends are held against
it, those that agree make it longer, until a bounce, a hit or the end of the proposals.
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
from labels.arrays import STATES, LabelArrays
from labels.assist.flight import FittedFlight, fit_flight
from labels.assist.propose import Proposals
from labels.model import LabelState, PositionSource

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
GRAVITY: Final = np.array([0.0, 0.0, -GRAVITY_MPS2])
MAX_SLACK: Final = 3.0
"""By how much more a proposal beyond the ends may be off, at most, for the flight to be made longer."""
SEED_PAIRS: Final = 24
"""Instants nearest to the cursor of which the first guess is made."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeFlightConfig:
    """What counts as one flight."""

    reach_us: int = setting(1_500_000, 100_000, 5_000_000)
    """No flight is longer to either side of the cursor."""
    seed_us: int = setting(60_000, 5_000, 500_000)
    """The first guess is made of instants so near to the cursor."""
    piece_us: int = setting(24_000, 2_000, 200_000)
    """By how much a flight is made longer at a time, at least."""
    gap_us: int = setting(80_000, 5_000, 500_000)
    """A flight goes on behind something that hides the ball for so long."""
    tolerance_px: float = setting(2.5, 0.5, 20.0)
    """A proposal farther from the flight never belongs to it."""
    sigmas: float = setting(4.0, 2.0, 10.0)
    """Nor one that is so many standard deviations of the others away."""
    least: int = setting(8, 5, 100)
    """Proposals that a flight needs in each of two cameras."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """A proposal within the time of a flight that is not on it."""

    t_us: int
    off_px: float


@dataclass(frozen=True, slots=True, eq=False)
class WholeFlight:
    """A flight and what it says of the proposals of each camera, in the order in which they were given."""

    flight: FittedFlight
    start_us: int
    end_us: int
    """From the first to the last proposal that agrees."""
    agreed: tuple[Proposals, ...]
    doubted: tuple[tuple[Doubt, ...], ...]


def whole_flight(
    cameras: Sequence[Camera],
    proposals: Sequence[Proposals],
    t_us: int,
    *,
    config: WholeFlightConfig | None = None,
) -> WholeFlight | None:
    """The flight at or next to `t_us`; None where the proposals there are not of one ball in free flight.

    `cameras` and their `proposals` are of two or more; two of them have to agree, whatever the others found.
    """
    config = config or WholeFlightConfig()
    near = t_us - config.reach_us, t_us + config.reach_us
    views = tuple(_View(camera, part.between(*near)) for camera, part in zip(cameras, proposals, strict=True))
    seeds = (_seed(views, row, t_us, config) for row in range(len(views) - 1))
    span = next((seed for seed in seeds if seed is not None), None)
    if span is None:
        return None
    flight = _fit(views, span)
    open_ends = [-1, +1]
    while flight is not None and open_ends:
        for side in tuple(open_ends):
            longer = _longer(views, flight, span, side, config)
            if longer is None:
                open_ends.remove(side)
            else:
                span = longer
        if open_ends:
            flight = _fit(views, span)
    for _ in range(2):  # what agreed with the flight of before may not agree with the better one
        if flight is None:
            return None
        _agree(views, flight, span, config)
        flight = _fit(views, span)
    if flight is None:
        return None
    _agree(views, flight, span, config)
    if sum(int(view.agreed.sum()) >= config.least for view in views) < 2:
        return None
    times = np.concatenate([view.part.t_us[view.agreed] for view in views])
    start_us, end_us = int(times.min()), int(times.max())
    agreed = tuple(view.taken() for view in views)
    doubted = tuple(view.doubts(flight, start_us, end_us) for view in views)
    return WholeFlight(flight, start_us, end_us, agreed, doubted)


class _View:
    """The proposals of one camera, and which of them belong to the flight so far."""

    def __init__(self, camera: Camera, part: Proposals) -> None:
        self.camera = camera
        self.part = part
        self.uv = np.column_stack([part.x_px, part.y_px])
        self.agreed: Rows = np.zeros(len(part), np.bool_)

    def off_px(self, flight: FittedFlight, rows: Rows) -> Array:
        """(n,) how far those rows are from the flight."""
        seen = flight.seen_by(self.camera, self.part.t_us[rows])
        return np.nan_to_num(np.hypot(*(self.uv[rows] - seen[:, :2]).T), nan=np.inf)

    def between(self, start_us: int, end_us: int) -> Rows:
        """Rows with `start_us <= t <= end_us`."""
        return (start_us <= self.part.t_us) & (self.part.t_us <= end_us)

    def keys(self) -> LabelArrays:
        """What is agreed, as a fit takes it."""
        rows = self.agreed
        count = int(rows.sum())
        state = np.full(count, STATES.index(LabelState.VISIBLE), np.uint8)
        source = np.full(count, tuple(PositionSource).index(PositionSource.ACCEPTED), np.uint8)
        x_px, y_px = self.uv[rows].T
        return LabelArrays(self.part.t_us[rows], x_px, y_px, self.part.r_px[rows], state, source)

    def taken(self) -> Proposals:
        """The proposals that agree."""
        return self.part.rows(self.agreed)

    def doubts(self, flight: FittedFlight, start_us: int, end_us: int) -> tuple[Doubt, ...]:
        """The proposals in [start_us, end_us) that do not agree with the flight."""
        rows = self.between(start_us, end_us) & ~self.agreed
        off_px = self.off_px(flight, rows)
        return tuple(Doubt(t, off) for t, off in zip(self.part.t_us[rows].tolist(), off_px.tolist(), strict=True))


_Views = tuple[_View, ...]
_Span = tuple[int, int]


def _seed(views: _Views, anchor: int, t_us: int, config: WholeFlightConfig) -> _Span | None:
    """The instants round the cursor that most agree on one throw: each two of them are tried as its beginning.

    They are those of the proposals of the camera `anchor`, at which the others' are interpolated.
    """
    own_us = views[anchor].part.t_us
    parts = [view.part if row == anchor else view.part.at(own_us) for row, view in enumerate(views)]
    uvs = np.stack([np.column_stack([part.x_px, part.y_px]) for part in parts], axis=1)
    near = np.abs(own_us - t_us) <= config.seed_us
    points, uvs = _points(views, uvs, near, config)
    rows = np.flatnonzero(np.isfinite(points).all(axis=1) & near)
    rows = np.sort(rows[np.argsort(np.abs(own_us[rows] - t_us), kind="stable")[:SEED_PAIRS]])
    if len(rows) < config.least:
        return None
    t, p, uv = (own_us[rows] - t_us) * 1e-6, points[rows], uvs[rows]
    # At least three instants apart: nearer ones do not determine a velocity.
    i, j = np.triu_indices(len(rows), 3)
    took = (t[j] - t[i])[:, None]
    # The parabola through both places.
    v = (p[j] - p[i]) / took - 0.5 * GRAVITY * took
    since = (t[None, :] - t[i][:, None])[..., None]
    flown = p[i][:, None] + v[:, None] * since + 0.5 * GRAVITY * since**2
    off_px = []
    for view, own in zip(views, uv.transpose(1, 0, 2), strict=True):
        seen = view.camera.project(flown.reshape(-1, 3)).reshape(*flown.shape[:2], 2)
        off_px.append(np.linalg.norm(np.nan_to_num(seen - own, nan=1e3), axis=-1))
    fits = np.stack(off_px) < config.tolerance_px
    best = fits[:, np.argmax((fits.sum(axis=0) >= 2).sum(axis=1))]
    on_throw = best.sum(axis=0) >= 2
    if on_throw.sum() < config.least:
        return None
    for view, fit in zip(views, best, strict=True):
        view.agreed = np.isin(view.part.t_us, own_us[rows[on_throw & fit]])
    return int(own_us[rows[on_throw]][0]), int(own_us[rows[on_throw]][-1])


def _points(views: _Views, uvs: Array, wanted: Rows, config: WholeFlightConfig) -> tuple[Array, Array]:
    """The points (N, 3) of positions (N, C, 2), and the positions that they are made of; nan where these disagree.

    Of three cameras or more, what one found elsewhere than the others is left out; only `wanted` rows are looked at.
    """
    rig = StereoRig({str(row): view.camera for row, view in enumerate(views)})
    if len(views) == 2:
        found = rig.triangulate(uvs)
        return np.where((found.residuals_px < config.tolerance_px)[:, None], found.ps_world_m, np.nan), uvs
    points, used = np.full((len(uvs), 3), np.nan), np.full(uvs.shape, np.nan)
    for row in np.flatnonzero(wanted & (np.isfinite(uvs[:, :, 0]).sum(axis=1) >= 2)):
        found = rig.triangulate_one(uvs[row])
        if found is not None and found.residual_px < config.tolerance_px:
            points[row] = found.p_world_m
            for camera in map(int, found.cameras):
                used[row, camera] = uvs[row, camera]
    return points, used


def _fit(views: _Views, span: _Span) -> FittedFlight | None:
    for view in views:
        view.agreed &= view.between(*span)
    return fit_flight([view.camera for view in views], [view.keys() for view in views])


def _agree(views: _Views, flight: FittedFlight, span: _Span, config: WholeFlightConfig) -> None:
    """Judge anew everything within the span: nearer than the tolerance, and than the others' scatter allows."""
    for view in views:
        rows = view.between(*span)
        off_px = view.off_px(flight, rows)
        inner = off_px[off_px < config.tolerance_px]
        # Of two equal Gaussian coordinates the median distance is 1.18 standard deviations.
        usual_px = float(np.median(inner)) / 1.18 if len(inner) else 0.0
        view.agreed = rows.copy()
        view.agreed[rows] = off_px < min(config.tolerance_px, max(config.sigmas * usual_px, 0.5))


def _longer(views: _Views, flight: FittedFlight, span: _Span, side: int, config: WholeFlightConfig) -> _Span | None:
    """The span with one more piece on a side; None where the flight ends there."""
    edge = span[side > 0]
    if len(views) > 2:  # one that found something else all the time neither shortens the flight nor makes it longer
        views = tuple(view for view in views if 2 * view.agreed.sum() >= view.between(*span).sum() > 0)
        if len(views) < 2:
            return None
    times = np.concatenate([view.part.t_us for view in views])
    beyond = times[(times - edge) * side > 0]
    if not len(beyond):
        return None
    nearest = int(beyond.min() if side > 0 else beyond.max())
    if abs(nearest - edge) > config.gap_us:
        return None
    piece_us = max(config.piece_us, (span[1] - span[0]) // 2)  # the longer it is, the better it is known
    limits = sorted((nearest, nearest + side * piece_us))
    rows = [view.between(*limits) for view in views]
    when = np.concatenate([view.part.t_us[own] for view, own in zip(views, rows, strict=True)])
    off_px = np.concatenate([view.off_px(flight, own) for view, own in zip(views, rows, strict=True)])
    # The farther beyond what is known, the less exactly it is; in the end everything is judged alike.
    fine = off_px < config.tolerance_px * np.clip(np.abs(when - edge) / config.piece_us, 1.0, MAX_SLACK)
    if 2 * fine.sum() < len(fine):
        # Perhaps it ends within the piece: as far as nothing but agreement comes.
        wrong = when[~fine] if side > 0 else -when[~fine]
        fine &= (when if side > 0 else -when) < np.min(wrong)
        if not fine.any():
            return None
    for view, own, kept in zip(views, rows, np.split(fine, np.cumsum([own.sum() for own in rows[:-1]])), strict=True):
        view.agreed[own] |= kept
    reached = int(when[fine].max() if side > 0 else when[fine].min())
    return (span[0], reached) if side > 0 else (reached, span[1])
