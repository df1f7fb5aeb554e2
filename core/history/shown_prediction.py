"""A prediction as it is shown: its flight up to the place where the ball is to be hit, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.control.controller import RacketDecision
from core.chain.control.hit_choice import HitChoice, plane_explanation
from core.history.rally_picture import UncertaintyEllipse
from core.trajectory import Prediction
from core.trajectory.prediction import HitPlane

Array = NDArray[np.float64]

SAME_PLACE_M: Final = 1e-4
"""A recording tells where the racket was sent only to rounding."""
PATH_POINTS: Final = 48
"""Most points of a path; the scene resamples shorter ones to as many, so that its handle is reused."""
TUBE_POINTS: Final = 20


@dataclass(frozen=True, slots=True, eq=False)
class ShownPrediction:
    """A prediction to show."""

    t_us: int
    path: Array
    """(N, 3)."""
    bounce: Array | None
    hit: HitPlane | None
    """Where the ball is to be hit: as chosen, or at the hitting plane."""
    prediction: Prediction
    """Its hitting plane is where the ball is to be hit."""
    choice: HitChoice | None = None
    """Where else it could be hit; None at the paper's plane."""
    no_stroke: str = ""
    """Why no stroke can return the ball, in words; empty if one can."""

    @property
    def end_us(self) -> float:
        """Predicted hit time; without one, the time of the prediction."""
        return float(self.t_us) if self.hit is None else self.hit.t_s * 1e6

    def sigmas(self) -> tuple[Array, Array]:
        """(N, 3) points of the path and (N, 3) their standard deviations."""
        t_s = self.prediction.curve_t_s
        return self.prediction.positions(t_s[_even_rows(len(t_s), TUBE_POINTS)])


def shown_prediction(
    prediction: Prediction, decision: RacketDecision | None, choice: HitChoice | None
) -> ShownPrediction:
    """What is shown of a prediction; the racket is sent as `decision` says, to the place of the `choice` if any."""
    shown = meet_where_sent(prediction, decision)
    path = shown.curve_ps_world_m
    rows = _even_rows(len(path), PATH_POINTS)
    bounce = shown.bounces[0].p_world_m if shown.bounces else None
    hit, no_stroke = shown.hit_plane, "" if choice is None else choice.explanation
    if choice is None and hit is not None and decision is not None:
        no_stroke = plane_explanation(hit)
    return ShownPrediction(shown.t_us, path[rows], bounce, hit, shown, choice, no_stroke)


def meet_where_sent(prediction: Prediction, decision: RacketDecision | None) -> Prediction:
    """The prediction whose hitting plane is where the racket is sent to meet the ball, before or behind the paper's."""
    plane = prediction.hit_plane
    if decision is None or not np.isfinite(decision.state[0]) or decision.target.t_s * 1e6 < prediction.t_us:
        return prediction
    x_m = float(decision.state[0])
    if plane is not None and abs(float(plane.p_world_m[0]) - x_m) < SAME_PLACE_M:
        return prediction
    hit = prediction.crossings([x_m])[0]
    return prediction if hit is None else replace(prediction, hit_plane=hit)


def spreads_of(prediction: Prediction) -> tuple[UncertaintyEllipse, ...]:
    """One-sigma ellipses of the expected next bounce (horizontal) and of the hit (in the hitting plane)."""
    found: list[UncertaintyEllipse] = []
    if prediction.bounces:
        bounce = prediction.bounces[0]
        found.append(
            UncertaintyEllipse(
                bounce.p_world_m, np.array([[bounce.sigma_m[0], 0.0, 0.0], [0.0, bounce.sigma_m[1], 0.0]])
            )
        )
    hit = prediction.hit_plane
    if hit is not None:
        variances, directions = np.linalg.eigh(hit.covariance[1:3, 1:3])
        lengths = np.sqrt(np.maximum(variances, 0.0))
        axes = np.column_stack([np.zeros(2), (directions * lengths).T])
        found.append(UncertaintyEllipse(hit.p_world_m, axes))
    return tuple(found)


def places_of(expected: ShownPrediction | None, *, possible: bool) -> Array:
    """(N, 3) places that were looked at and not chosen, where a stroke can return the ball, or where none can."""
    choice = None if expected is None else expected.choice
    others = () if choice is None else (one for one in choice.candidates if one is not choice.chosen)
    return np.array([one.hit.p_world_m for one in others if (not one.why_not) == possible]).reshape(-1, 3)


def _even_rows(length: int, most: int) -> NDArray[np.int64]:
    """Indices of at most this many evenly spread rows, both ends included."""
    return np.unique(np.linspace(0, length - 1, most).astype(np.int64))
