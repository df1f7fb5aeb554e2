"""Ground truth of the ball over time: in the world, in the picture of one camera, and when it bounces and is hit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

LARGEST_GAP_US: Final = 20_000
"""Samples further apart say nothing about what was between them."""
LARGEST_PX: Final = 1e5
LARGEST_M: Final = 1e4
"""What is farther away, or faster in m/s, is no ball."""
SLOWEST_MPS: Final = 0.2
"""A velocity that turns by less than this each way is the top of a flight, or noise."""


@dataclass(frozen=True, slots=True, eq=False)
class BallTruth:
    """N samples of the ball in the world, t_us ascending."""

    t_us: NDArray[np.int64]
    p_world_m: NDArray[np.float64]
    """(N, 3)"""
    v_world_mps: NDArray[np.float64]
    """(N, 3)"""
    spin_radps: NDArray[np.float64]
    """(N, 3), world axes."""
    visible: NDArray[np.bool_]
    """False where there is no ball in play."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelTruth:
    """N samples of the ball's outline in one camera, t_us ascending; nan where it is not visible."""

    t_us: NDArray[np.int64]
    u_px: NDArray[np.float64]
    v_px: NDArray[np.float64]
    r_px: NDArray[np.float64]
    visible: NDArray[np.bool_]
    """The centre lies on the sensor and nothing hides it."""

    def at(self, t_us: ArrayLike) -> PixelTruth:
        """The truth at other times, linear between samples; not visible outside them or beside an invisible one."""
        t = np.atleast_1d(np.asarray(t_us, np.int64))
        if not len(self.t_us):
            nothing = np.full(len(t), np.nan)
            return PixelTruth(t, nothing, nothing, nothing, np.zeros(len(t), np.bool_))
        after = np.clip(np.searchsorted(self.t_us, t, side="left"), 0, len(self.t_us) - 1)
        before = np.where(self.t_us[after] == t, after, np.maximum(after - 1, 0))
        inside = (self.t_us[0] <= t) & (t <= self.t_us[-1])
        visible = inside & self.visible[before] & self.visible[after]
        span = self.t_us[after] - self.t_us[before]
        weight = np.where(span > 0, (t - self.t_us[before]) / np.maximum(span, 1), 0.0)
        with np.errstate(invalid="ignore"):  # where it is not visible, columns of a file may hold anything
            u, v, r = (
                np.where(visible, column[before] * (1 - weight) + column[after] * weight, np.nan)
                for column in (self.u_px, self.v_px, self.r_px)
            )
        return PixelTruth(t, u, v, r, visible)


def credible_pixels(truth: PixelTruth) -> PixelTruth:
    """Pixel truth, marked not visible where a position is not finite or far outside any picture; no radii below 0."""
    with np.errstate(invalid="ignore"):
        near = (np.abs(truth.u_px) < LARGEST_PX) & (np.abs(truth.v_px) < LARGEST_PX)
        radius = np.isnan(truth.r_px) | ((truth.r_px >= 0) & (truth.r_px < LARGEST_PX))
    if not bool(np.any(truth.visible & ~(near & radius))):
        return truth
    r_px, visible = np.where(radius, truth.r_px, np.nan), truth.visible & near
    return PixelTruth(truth.t_us, truth.u_px, truth.v_px, _closed(r_px), _closed(visible))


def credible_ball(ball: BallTruth) -> BallTruth:
    """Ball truth, marked not visible where position or velocity are absurd or not finite."""
    with np.errstate(invalid="ignore"):
        near = (np.abs(ball.p_world_m) < LARGEST_M).all(axis=1) & ~(np.abs(ball.v_world_mps) > LARGEST_M).any(axis=1)
    if not bool(np.any(ball.visible & ~near)):
        return ball
    return BallTruth(ball.t_us, ball.p_world_m, ball.v_world_mps, ball.spin_radps, _closed(ball.visible & near))


def _closed(column: NDArray) -> NDArray:
    column.flags.writeable = False
    return column


@dataclass(frozen=True, slots=True, eq=False)
class TurningPoints:
    """Times in microseconds, ascending."""

    bounces_us: NDArray[np.int64]
    """The ball fell and rises."""
    hits_us: NDArray[np.int64]
    """It flew along the table one way and now flies the other."""


def turning_points(ball: BallTruth) -> TurningPoints:
    """Each at the first sample after it."""
    t_us, v = ball.t_us, ball.v_world_mps
    if len(t_us) < 2:
        nothing = np.empty(0, np.int64)
        return TurningPoints(nothing, nothing)
    known = ball.visible & np.isfinite(v).all(axis=1)
    joined = known[:-1] & known[1:] & (np.diff(t_us) <= LARGEST_GAP_US)
    rises = joined & (v[:-1, 2] < -SLOWEST_MPS) & (v[1:, 2] > SLOWEST_MPS)
    turns = joined & (np.sign(v[:-1, 0]) != np.sign(v[1:, 0])) & (np.abs(v[:-1, 0]) > SLOWEST_MPS)
    turns &= np.abs(v[1:, 0]) > SLOWEST_MPS
    return TurningPoints(t_us[1:][rises & ~turns], t_us[1:][turns])


def first_seen_us(truths: Iterable[PixelTruth | None]) -> int | None:
    """When the ball is first in every picture of which the truth is known; None where it never is."""
    seen = [truth.t_us[truth.visible] for truth in truths if truth is not None]
    if not seen or any(not len(t_us) for t_us in seen):
        return None
    return int(max(t_us[0] for t_us in seen))
