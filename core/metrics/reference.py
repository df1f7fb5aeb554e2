"""Reference for a comparison of methods: the truth, labels, or the answers of one method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.metrics.grid_score import GRID_US, askable
from core.metrics.run import WindowAnswers
from core.recordings import PixelTruth

ReferenceKind = Literal["truth", "labels", "method"]
LABEL_GAP_US: Final = 20_000
"""Between labels that are no farther apart the ball is on the line between them: gravity bends the path of one 2.5 m
away by 0.2 px meanwhile (focal length 1000 px)."""
LABEL_NEAR_US: Final = 1_000
"""An isolated label is the reference for answers within this time."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelReference:
    """Reference positions of the ball: known positions, times known to be without a ball, and unknown times."""

    kind: ReferenceKind
    name: str
    """Name of the reference as shown."""
    places: PixelTruth
    """Ascending samples."""
    asked_us: NDArray[np.int64]
    """(A,) ascending times at which a detector should have a ball."""

    def at(self, t_us: NDArray[np.int64]) -> tuple[PixelTruth, NDArray[np.bool_]]:
        """Positions at times (N,), and whether each is known."""
        there = self.places.at(t_us)
        if not len(self.places.t_us):
            return there, np.zeros(len(t_us), np.bool_)
        times = self.places.t_us
        inside = (times[0] <= t_us) & (t_us <= times[-1])
        if self.kind != "labels":
            return there, inside
        after = np.clip(np.searchsorted(times, t_us), 0, len(times) - 1)
        before = np.maximum(after - 1, 0)
        between = inside & ((times[after] - times[before] <= LABEL_GAP_US) | (times[after] == t_us))
        nearest = np.where(np.abs(times[after] - t_us) < np.abs(t_us - times[before]), after, before)
        beside = ~between & (np.abs(times[nearest] - t_us) <= LABEL_NEAR_US)
        u_px, v_px, r_px = (
            np.where(beside, own[nearest], np.where(between, column, np.nan))
            for own, column in (
                (self.places.u_px, there.u_px),
                (self.places.v_px, there.v_px),
                (self.places.r_px, there.r_px),
            )
        )
        visible = np.where(beside, self.places.visible[nearest], between & there.visible)
        return PixelTruth(there.t_us, u_px, v_px, r_px, visible), between | beside


def truth_reference(truth: PixelTruth, sensor: SensorSize) -> PixelReference:
    """Reference from the truth, queried every millisecond at which the whole disc has been in view for a while, see
    `askable`.
    """
    grid = np.arange(truth.t_us[0], truth.t_us[-1], GRID_US) if len(truth.t_us) else np.empty(0, np.int64)
    return PixelReference("truth", "the truth", truth, grid[askable(grid, truth, sensor)])


def labels_reference(places: PixelTruth, name: str) -> PixelReference:
    """Reference from labels that state a ball or none; each ball is queried."""
    return PixelReference("labels", name, places, places.t_us[places.visible])


def method_reference(answers: WindowAnswers, name: str) -> PixelReference:
    """Reference from the answers of a method; no answer means no ball."""
    found = answers.detected
    late_us = int(np.median((answers.end_us - answers.t_us)[found])) if found.any() else 0
    t_us = np.where(found, answers.t_us, answers.end_us - late_us)
    order = np.argsort(t_us, kind="stable")
    places = PixelTruth(t_us[order], answers.u_px[order], answers.v_px[order], answers.r_px[order], found[order])
    return PixelReference("method", name, places, places.t_us[places.visible])
