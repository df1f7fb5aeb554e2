"""What to look at next: every label and every hole that something speaks against, the worst first, with the reason."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import check_settings, setting
from labels.arrays import STATES, LabelArrays
from labels.assist.propose import Proposals, residual_of_neighbours, residual_of_one_side
from labels.assist.stereo import radius_is_off
from labels.model import LabelState

Array = NDArray[np.float64]
_Note = Callable[[NDArray[np.int64], Array, list[str]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class QueueConfig:
    """What counts as how suspicious. Scores are in standard deviations of a careful label."""

    sigma_px: float = setting(0.7, 0.05, 10.0)
    """How exact a label is; the annotator's own noise, once it is measured."""
    detector_sigma_px: float = setting(1.0, 0.05, 20.0)
    """How exact the detector is."""
    max_gap_us: int = setting(20_000, 100, 1_000_000)
    """Labels farther apart say nothing about each other."""
    contradiction: float = setting(20.0, 1.0, 100.0)
    """Score of a ball where detector or neighbours see none, and the other way round."""
    least_score: float = setting(3.0, 0.0, 100.0)
    """What is less suspicious is not queued."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class QueueItem:
    """One time to look at."""

    t_us: int
    score: float
    reason: str


def review_queue(
    labels: LabelArrays,
    *,
    proposals: Proposals | None = None,
    stereo_residual_px: Array | None = None,
    expected_r_px: Array | None = None,
    frames_us: ArrayLike | None = None,
    rejected_us: Sequence[int] = (),
    config: QueueConfig | None = None,
) -> tuple[QueueItem, ...]:
    """Times in order of suspicion: the first is where a look would change a score most.

    Stored labels that other cameras contradict come before all others, in position or in radius: two cameras do not err
    alike. A position at a bounce is
    on the path before it or on that behind it, and is not suspicious.

    A proposal that nobody has judged counts like a label: one off the path of all others is probably wrong, and costs
    a score twice, as a false ball and as a miss; where the path of the proposals has a hole, it costs it once.
    Proposals at `rejected_us` are judged.

    Args:
        labels: of one camera.
        proposals: of a detector, for the same camera.
        stereo_residual_px: (N,) of each label with the other camera's; nan: none.
        expected_r_px: (N,) radius of each label's ball where the cameras have it; nan: not known.
        frames_us: (F,) all times that are to be labelled; unchecked ones between checked ones are queued as gaps.
        rejected_us: times of proposals that a person refused.
        config: weights and limits.
    """
    config = config or QueueConfig()
    items: dict[int, QueueItem] = {}

    def note(t_us: NDArray[np.int64], scores: Array, reasons: list[str]) -> None:
        for t, score, reason in zip(t_us.tolist(), scores.tolist(), reasons, strict=True):
            if score >= config.least_score and (t not in items or items[t].score < score):
                items[t] = QueueItem(t, score, reason)

    _from_neighbours(labels, config, note)
    _from_states(labels, config, note)
    if proposals is not None:
        _from_detector(labels, proposals, config, note)
        _from_unjudged(labels, proposals, np.asarray(rejected_us, np.int64), config, note)
    # Scores are in standard deviations, so that the sources below compare.
    contradicted: frozenset[int] = frozenset()
    if stereo_residual_px is not None:
        scores = np.nan_to_num(stereo_residual_px / config.sigma_px)
        contradicted = frozenset(labels.t_us[scores >= config.least_score].tolist())
        note(labels.t_us, scores, [f"the cameras disagree by {residual:.1f} px" for residual in stereo_residual_px])
    if expected_r_px is not None:
        off_px = np.abs(labels.r_px - expected_r_px)
        # Of cameras that disagree the ball is at a wrong depth, and so is its radius.
        off = radius_is_off(labels.r_px, expected_r_px) & ~np.isin(labels.t_us, list(contradicted))
        contradicted |= frozenset(labels.t_us[off].tolist())
        sizes = zip(labels.r_px.tolist(), expected_r_px.tolist(), strict=True)
        reasons = [f"radius {r_px:.1f} px, the cameras expect {expected:.1f} px" for r_px, expected in sizes]
        # A radius that is clearly off is queued, even if by few standard deviations: of a small ball.
        note(labels.t_us, np.where(off, np.maximum(off_px / config.sigma_px, config.least_score), 0.0), reasons)
    if frames_us is not None:
        _from_gaps(labels, np.asarray(frames_us, np.int64), config, note)
    order = sorted(items.values(), key=lambda item: (item.t_us not in contradicted, -item.score, item.t_us))
    return tuple(order)


def _from_neighbours(labels: LabelArrays, config: QueueConfig, note: _Note) -> None:
    part = labels.rows(labels.seen)
    residual = residual_of_neighbours(part.t_us, part.x_px, part.y_px, max_gap_us=config.max_gap_us)
    reasons = [f"Label is {value:.1f} px off the neighbours' path" for value in residual]
    scores = np.nan_to_num(residual / config.sigma_px)
    note(part.t_us, _without_bounces(part.t_us, part.x_px, part.y_px, scores, config.sigma_px, config), reasons)


def _without_bounces(
    t_us: NDArray[np.int64], x_px: Array, y_px: Array, scores: Array, sigma_px: float, config: QueueConfig
) -> Array:
    """The scores (N,), 0 where a position off the path of its neighbours is on that of one side: a bounce, or a hit."""
    scores = scores.copy()
    for row in np.flatnonzero(scores >= config.least_score).tolist():
        one_side_px = residual_of_one_side(t_us, x_px, y_px, row, max_gap_us=config.max_gap_us)
        if one_side_px / sigma_px < config.least_score:
            scores[row] = 0.0
    return scores


def _from_states(labels: LabelArrays, config: QueueConfig, note: _Note) -> None:
    """A ball that is there for one label only, or away for one only, between neighbours that agree with each other."""
    if len(labels) < 3:
        return
    seen, t = labels.seen, labels.t_us
    close = (t[2:] - t[:-2]) <= 2 * config.max_gap_us
    odd = close & (seen[:-2] == seen[2:]) & (seen[1:-1] != seen[2:])
    alone = ["a ball at this time only" if here else "no ball at this time only" for here in seen[1:-1]]
    note(t[1:-1], np.where(odd, config.contradiction, 0.0), alone)


def _from_detector(labels: LabelArrays, proposals: Proposals, config: QueueConfig, note: _Note) -> None:
    found = proposals.at(labels.t_us)
    has, seen = np.isfinite(found.x_px), labels.seen
    distance = np.hypot(found.x_px - labels.x_px, found.y_px - labels.y_px)
    sigma = np.hypot(config.sigma_px, config.detector_sigma_px)
    note(
        labels.t_us,
        np.where(has & seen, np.nan_to_num(distance / sigma), 0.0),
        [f"{value:.1f} px from what the detector found" for value in distance],
    )
    absent = labels.state == STATES.index(LabelState.NO_BALL)
    empty = ["the detector sees a ball where the label says there is none"] * len(labels)
    note(labels.t_us, np.where(has & absent, config.contradiction * 0.9, 0.0), empty)
    # Detectors miss balls now and then, so silence weighs less than a contradiction.
    silent = ["the detector finds no ball here"] * len(labels)
    note(labels.t_us, np.where(seen & ~has, max(config.least_score, 0.2 * config.contradiction), 0.0), silent)


def _from_unjudged(
    labels: LabelArrays, proposals: Proposals, rejected_us: NDArray[np.int64], config: QueueConfig, note: _Note
) -> None:
    open_us = ~np.isin(proposals.t_us, labels.t_us) & ~np.isin(proposals.t_us, rejected_us)
    known = labels.rows(labels.seen)
    t_us = np.concatenate([known.t_us, proposals.t_us[open_us]])
    order = np.argsort(t_us, kind="stable")
    x = np.concatenate([known.x_px, proposals.x_px[open_us]])[order]
    y = np.concatenate([known.y_px, proposals.y_px[open_us]])[order]
    t_us, proposed = t_us[order], order >= len(known)
    residual = residual_of_neighbours(t_us, x, y, max_gap_us=config.max_gap_us)
    sigma = np.hypot(config.sigma_px, config.detector_sigma_px)
    scores = _without_bounces(t_us, x, y, np.nan_to_num(residual / sigma), sigma, config)
    scores = np.minimum(scores, 0.8 * config.contradiction)
    reasons = [
        f"Proposal is {value:.1f} px off the neighbours' path. Bounce? Shift Enter" for value in residual[proposed]
    ]
    note(t_us[proposed], scores[proposed], reasons)
    step_us = np.diff(t_us)
    hole = (step_us > 1.5 * proposals.window_us) & (step_us <= config.max_gap_us) & proposed[:-1] & proposed[1:]
    inside_us = t_us[:-1][hole] + proposals.window_us
    hole_score = np.full(len(inside_us), 0.4 * config.contradiction)
    note(inside_us, hole_score, ["the detector has lost the ball here for a moment"] * len(inside_us))


def _from_gaps(labels: LabelArrays, frames_us: NDArray[np.int64], config: QueueConfig, note: _Note) -> None:
    if not len(labels):
        return
    unchecked = frames_us[~np.isin(frames_us, labels.t_us)]
    after = np.searchsorted(labels.t_us, unchecked)
    between = (after > 0) & (after < len(labels))
    unchecked, after = unchecked[between], after[between]
    flanked = labels.seen[after - 1] & labels.seen[after]
    note(unchecked, np.where(flanked, config.least_score, 0.0), ["nobody has looked here"] * len(unchecked))
