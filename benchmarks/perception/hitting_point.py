"""The chain over a recording: points in space, and the hitting points that it says 100 ms before the ball is there."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.loaded_camera import LoadedCamera
from core.cameras import Camera
from core.chain.chain import RallyChain
from core.chain.config import ChainConfig
from core.chain.follow import true_positions
from core.detection.window import windows_side_by_side
from core.recordings import BallTruth
from core.trajectory import Prediction

Array = NDArray[np.float64]
LEAD_US: Final = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class PlaneCrossing:
    """A ball that came to the hitting plane."""

    start_us: int
    """Since then it had been flying towards it: what was predicted before is of another flight."""
    t_us: int
    p_world_m: Array
    """(3,)"""


@dataclass(frozen=True, slots=True, eq=False)
class ChainErrors:
    """How far off the chain was."""

    point_mm: Array
    """(N,) of the points at times when there was a ball."""
    points_without_ball: int
    hits: int
    hit_mm: list[float]
    """Along the hitting plane, of the balls that a prediction was there for."""


def plane_crossings(ball: BallTruth, hit_x_m: float) -> list[PlaneCrossing]:
    """Every time that the ball flies through the plane towards the robot's side, linear between the samples."""
    x, flying = ball.p_world_m[:, 0], ball.visible & (ball.v_world_mps[:, 0] < 0)
    with np.errstate(invalid="ignore"):
        through = flying[:-1] & flying[1:] & (x[:-1] > hit_x_m) & (x[1:] <= hit_x_m)
    found: list[PlaneCrossing] = []
    for row in np.flatnonzero(through).tolist():
        still = np.flatnonzero(~flying[: row + 1])
        start = int(still[-1]) + 1 if len(still) else 0
        share = (x[row] - hit_x_m) / (x[row] - x[row + 1])
        t_us = ball.t_us[row] + share * (ball.t_us[row + 1] - ball.t_us[row])
        p = ball.p_world_m[row] + share * (ball.p_world_m[row + 1] - ball.p_world_m[row])
        found.append(PlaneCrossing(int(ball.t_us[start]), round(float(t_us)), p))
    return found


def space_errors(
    loaded: Mapping[str, LoadedCamera], cameras: Mapping[str, Camera], ball: BallTruth, chain: ChainConfig
) -> ChainErrors:
    """Follow the ball with the chain, all cameras window by window, and compare with where it was."""
    follower = RallyChain(cameras, chain)
    end_us = 1000 * min(len(camera.counts_per_ms()) for camera in loaded.values())
    times: list[int] = []
    points: list[Array] = []
    ends: list[int] = []
    said: list[Prediction | None] = []
    for windows in windows_side_by_side(loaded, 0, end_us, chain.detector.window.window_us):
        state = follower.step(windows)
        ends.append(state.t_us)
        said.append(state.prediction)
        if state.point is not None:
            times.append(state.point.t_us)
            points.append(state.point.p_world_m)
    off_m = np.linalg.norm(np.array(points).reshape(-1, 3) - true_positions(ball, np.array(times, np.int64)), axis=1)
    known = np.isfinite(off_m)
    crossings = plane_crossings(ball, chain.predictor.hit_x_m)
    errors = [hit_error_mm(crossing, ends, said) for crossing in crossings]
    told = [error for error in errors if error is not None]
    return ChainErrors(1e3 * off_m[known], int((~known).sum()), len(crossings), told)


def hit_error_mm(crossing: PlaneCrossing, ends_us: list[int], said: list[Prediction | None]) -> float | None:
    """Error of the prediction 100 ms before the hit, mm; None if there was none."""
    step = bisect_right(ends_us, crossing.t_us - LEAD_US) - 1
    newest = said[step] if step >= 0 else None
    if newest is None or newest.t_us < crossing.start_us or newest.hit_plane is None:
        return None
    off = newest.hit_plane.p_world_m - crossing.p_world_m
    return 1e3 * float(np.hypot(off[1], off[2]))
