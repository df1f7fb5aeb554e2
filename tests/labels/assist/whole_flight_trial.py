"""Trial of taking whole flights: a person who looks at flights and doubts, at half a second a decision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.labels.assistance import FRAME_US, HUMAN_SIGMA_PX, make_serves
from core.recordings import PixelTruth
from labels.assist.propose import Proposals
from labels.assist.whole_flight import whole_flight

Array = NDArray[np.float64]
DECISION_S: Final = 0.5
LOOK_AT_FLIGHT: Final = 4
"""Decisions' worth of time for one look along a flight before it is taken."""
WRONG_PX: Final = 2.0
"""A centre farther off than this is wrong."""
DETECTOR_SIGMA_PX: Final = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class FlightTrial:
    """What a person made of a recording in the time given."""

    seconds: float
    """That were needed; never more than were given."""
    planted: int
    """Wrong proposals."""
    centres: int
    errors_px: Array
    """(centres,) of the accepted ones."""
    doubted: int
    """Proposals that the person was asked about."""

    @property
    def wrong(self) -> float:
        """Share of the accepted centres that are wrong."""
        return float((self.errors_px > WRONG_PX).mean())


def try_whole_flights(
    serves: int, rng: np.random.Generator, *, given_s: float = 300.0, wrong: float = 0.05
) -> FlightTrial:
    """Go along the recording flight by flight, take each with one key, and judge what is doubted, until time is up.

    Proposals miss 5 % of the instants and are 0.3 px exact, but for the planted share: single ones that are 5 to 30 px
    off, runs of ten that go along beside the ball, and runs of ten that stand still somewhere, in one camera each.
    Whoever is asked about a proposal sees by the truth whether it is right.
    """
    scene = make_serves(serves, rng)
    (left, right), (here, there) = scene.cameras.values(), scene.truth.values()
    made = [_proposals(truth, rng, wrong) for truth in (here, there)]
    proposals = made[0][0], made[1][0]
    spent = 0
    errors: list[Array] = []
    doubted = 0
    t_us, end_us = -1, round(scene.path.end_s * 1e6)
    while t_us < end_us and spent * DECISION_S < given_s:
        ahead = proposals[0].t_us[proposals[0].t_us > t_us]
        if not len(ahead):
            break
        t_us = int(ahead[0])
        found = whole_flight((left, right), proposals, t_us)
        if found is None or found.end_us <= t_us:
            continue  # the next proposal may begin one; looking for it is the program's work
        spent += LOOK_AT_FLIGHT
        for truth, agreed, doubts in zip((here, there), found.agreed, found.doubted, strict=True):
            errors.append(_errors(truth, agreed))
            room = max(0, int(given_s / DECISION_S) - spent)
            spent += min(len(doubts), room)
            doubted += len(doubts)
            errors.append(np.abs(rng.normal(0, HUMAN_SIGMA_PX, (min(len(doubts), room), 2))).max(axis=1))
        t_us = found.end_us
    all_errors = np.concatenate(errors)
    return FlightTrial(spent * DECISION_S, made[0][1] + made[1][1], len(all_errors), all_errors, doubted)


def _errors(truth: PixelTruth, part: Proposals) -> Array:
    at = truth.at(part.t_us)
    return np.where(at.visible, np.hypot(part.x_px - at.u_px, part.y_px - at.v_px), np.inf)


def _proposals(truth: PixelTruth, rng: np.random.Generator, wrong: float) -> tuple[Proposals, int]:
    """As a detector makes them, and how many were planted."""
    rows = np.flatnonzero(truth.visible & (rng.random(len(truth.t_us)) < 0.95))
    x = truth.u_px[rows] + rng.normal(0, DETECTOR_SIGMA_PX, len(rows))
    y = truth.v_px[rows] + rng.normal(0, DETECTOR_SIGMA_PX, len(rows))
    planted = np.zeros(len(rows), np.bool_)
    while planted.sum() < wrong * len(rows):
        kind, first = rng.integers(3), int(rng.integers(len(rows)))
        run = slice(first, first + (1 if kind == 0 else 10))
        angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(5, 30)
        if kind < 2:
            x[run], y[run] = x[run] + size * np.cos(angle), y[run] + size * np.sin(angle)
        else:
            x[run], y[run] = rng.uniform(0, 1279), rng.uniform(0, 719)
        planted[run] = True
    covariance = np.tile([DETECTOR_SIGMA_PX**2, 0.0, DETECTOR_SIGMA_PX**2], (len(rows), 1))
    made = Proposals(truth.t_us[rows], x, y, truth.r_px[rows], covariance, FRAME_US, "made up")
    return made, int(planted.sum())
