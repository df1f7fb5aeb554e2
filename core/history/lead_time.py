"""How good predictions of the hitting plane were, by how early they came; for rallies whose truth is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.recordings import BallTruth, Recording
from core.trajectory.prediction import HitPlane

Array = NDArray[np.float64]
BIN_MS: Final = 25.0
LONGEST_MS: Final = 500.0
"""Width of the bins of `LeadTimeErrors.medians`, and the end of the last one."""
FEWEST: Final = 3
"""Predictions that a bin must hold to be shown."""
STRUCK_WITHIN_M: Final = 0.06
"""A racket meets the ball about this near to the plane."""
ONE_BALL_US: Final = 400_000
"""Predictions of a crossing farther away than this belong to another ball."""


@dataclass(frozen=True, slots=True, eq=False)
class LeadTimeErrors:
    """One row a prediction."""

    lead_ms: Array
    """From the prediction to the true crossing of the hitting plane."""
    error_mm: Array
    """In the plane."""
    after_bounce: NDArray[np.bool_]

    def medians(self) -> tuple[Array, Array, Array]:
        """Middles of bins (B,), and the median error before and after the bounce (B,); nan where there are too few."""
        edges = np.arange(0.0, LONGEST_MS + BIN_MS, BIN_MS)
        bins = np.digitize(self.lead_ms, edges) - 1
        columns = []
        for after in (False, True):
            column = np.full(len(edges) - 1, np.nan)
            for number in range(len(column)):
                inside = self.error_mm[(bins == number) & (self.after_bounce == after)]
                if len(inside) >= FEWEST:
                    column[number] = np.median(inside)
            columns.append(column)
        return edges[:-1] + BIN_MS / 2, columns[0], columns[1]


LeadTimesRequest = tuple[Recording, Sequence[tuple[int, HitPlane]]]


def compute_lead_times(request: LeadTimesRequest) -> LeadTimeErrors | None:
    """For a recording and what was predicted in it; None if it does not know the truth."""
    recording, predicted = request
    truth = recording.ball
    return None if truth is None else lead_time_errors(predicted, truth)


def lead_time_errors(predicted: Sequence[tuple[int, HitPlane]], truth: BallTruth) -> LeadTimeErrors:
    """Errors of predictions (time in microseconds, crossing) against the true crossings of the same plane."""
    rows: list[tuple[float, float, bool]] = []
    crossings: dict[float, tuple[NDArray[np.int64], Array]] = {}
    for t_us, hit in predicted:
        plane_m = round(float(hit.p_world_m[0]), 4)
        if plane_m not in crossings:
            crossings[plane_m] = true_crossings(truth, plane_m)
        times_us, ps = crossings[plane_m]
        near = np.flatnonzero(np.abs(times_us - hit.t_s * 1e6) < ONE_BALL_US)
        if len(near):
            best = near[np.argmin(np.abs(times_us[near] - hit.t_s * 1e6))]
            error_m = float(np.linalg.norm(ps[best][1:] - hit.p_world_m[1:]))
            rows.append((float(times_us[best] - t_us) / 1e3, 1e3 * error_m, hit.stage == "post"))
    columns = np.array(rows, np.float64).reshape(-1, 3)
    return LeadTimeErrors(columns[:, 0], columns[:, 1], columns[:, 2].astype(np.bool_))


def true_crossings(truth: BallTruth, plane_x_m: float) -> tuple[NDArray[np.int64], Array]:
    """Times (N,) and places (N, 3) at which the ball came through the plane x towards the robot.

    A ball that is struck at the plane turns there; where it would have come through is read from its last velocity.
    """
    x, vx = truth.p_world_m[:, 0], truth.v_world_mps[:, 0]
    seen = truth.visible[:-1] & truth.visible[1:]
    through = (x[:-1] > plane_x_m) & (x[1:] <= plane_x_m)
    struck = (vx[:-1] < 0) & (vx[1:] >= 0) & (x[1:] > plane_x_m) & (np.abs(x[:-1] - plane_x_m) < STRUCK_WITHIN_M)
    here = np.flatnonzero(seen & (through | struck) & (vx[:-1] < 0))
    wait_s = (plane_x_m - x[here]) / vx[here]
    ps = truth.p_world_m[here] + wait_s[:, None] * truth.v_world_mps[here]
    return (truth.t_us[here] + 1e6 * wait_s).astype(np.int64), ps
